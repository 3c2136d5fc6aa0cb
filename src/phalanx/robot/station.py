"""The station that sends signed orders of a gateway and its operator, and the swarm of robots that obey it.

It broadcasts the gateway's beacon and the operator's stop, and sends visitors' orders to single robots, all signed. Its
rate is limited to the capacity of the channel and of the robots' logs, whatever visitors do: of several queued orders
of one kind for one robot, it sends only the newest. The caller provides the radio and the clock: a simulation or a
gateway.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Protocol

from phalanx.errors import UsageError
from phalanx.wire.driven import EVERYBODY
from phalanx.wire.table import ENTRY_HEADER_BYTES

from .controllers import orders
from .roster import Member, Roster
from .signer import Signer
from .swarm import Led, Point

# Bytes of orders per second that a robot's log has room for.
ORDER_BYTES_PER_S = 700
# Orders per second to all robots together: a tenth of the channel.
ORDERS_PER_S = 330
BEACON_S = 1.0
# Broadcasts may be lost: a stop, or its end, is sent AT_ONCE times at intervals of AGAIN_S, then every BEACON_S.
AT_ONCE, AGAIN_S = 5, 0.1
MOTION, COLOUR = 0, 1  # kinds of orders
# Makes an order's packet from the robot's id and the signer's clock, ms.
Make = Callable[[int, int], bytes]


class Air(Protocol):
    """The radio of a station."""

    def is_busy(self) -> bool:
        """Return whether the last packet is still waiting to be sent."""

    def is_permanently_stopped(self, robot: int) -> bool:
        """Return whether the robot is known to be stopped permanently."""

    def say(self, packet: bytes, robot: int) -> None:
        """Send a packet to a robot, or to EVERYBODY."""


class Station:
    """Queue and rate limiter of orders from one base station; robots are identified by their ids.

    Attributes:
        gateway, operator: signers of its orders.
        held: whether the operator has stopped all robots; other threads may set it.
    """

    def __init__(self, gateway: Signer, operator: Signer) -> None:
        self.gateway, self.operator = gateway, operator
        self.held = False
        self._was_held = self._let_go = False
        self._at_once = 0
        self._beacon_at_s, self._operator_at_s = 0.0, math.inf
        self._may_speak_at_s = 0.0
        self._may_order_at_s: dict[int, float] = {}
        # By robot and kind, the longest waiting first.
        self._waiting: dict[tuple[int, int], Make] = {}
        self._told: dict[int, int] = {}

    def queue_order(self, robot: int, kind: int, make: Make) -> None:
        """Queue an order for the robot, replacing a queued one of the same kind; thread-safe."""
        self._waiting[robot, kind] = make

    def release(self) -> None:
        """Let robots be driven again, and broadcast that: a previous station may have stopped them."""
        self.held = False
        self._let_go = True

    def drop_pending(self) -> None:
        """Drop queued colours and ignore the log limits of robots, to send the last orders at once."""
        self._drop(COLOUR)

    @property
    def has_pending_order(self) -> bool:
        """Return whether an order is queued, or a broadcast is being repeated."""
        return bool(self._waiting or self._at_once)

    def last_order_number(self, robot: int) -> int | None:
        """Return the number of the last order sent to the robot; None while an order to move is queued."""
        return None if (robot, MOTION) in self._waiting else self._told.get(robot, 0)

    def send_due(self, air: Air, now_s: float, order_ms: int) -> float:
        """Send the next packet that is due, at most one; `order_ms` is the signers' clock.

        Returns: when to call again, s; infinity if nothing is queued.
        """
        self._receive_stop(now_s)
        if now_s >= self._may_speak_at_s and not air.is_busy() and not self._broadcast_order(air, now_s, order_ms):
            self._send_order(air, now_s, order_ms)
        pace_s = 1 / ORDERS_PER_S if self.has_pending_order else math.inf
        return now_s + pace_s

    def _receive_stop(self, now_s: float) -> None:
        held, let_go = self.held, self._let_go
        if held != self._was_held or let_go:
            if let_go:
                self._let_go = False
            self._was_held, self._at_once, self._operator_at_s = held, AT_ONCE, now_s
        if held:
            self._drop(MOTION)

    def _drop(self, kind: int) -> None:
        for key in list(self._waiting):  # a copy, as other threads may queue orders meanwhile
            if key[1] == kind:
                self._waiting.pop(key)
        # Reset the log limits: a robot that stands still has room in its log again.
        self._may_order_at_s.clear()

    def _broadcast_order(self, air: Air, now_s: float, order_ms: int) -> bool:
        if now_s >= self._operator_at_s:
            self._operator_at_s = now_s + (AGAIN_S if self._at_once else BEACON_S)
            self._at_once = max(0, self._at_once - 1)
            packet = self.operator.stop(order_ms) if self._was_held else self.operator.go(order_ms)
        elif now_s >= self._beacon_at_s:
            self._beacon_at_s = now_s + BEACON_S
            packet = self.gateway.beacon(order_ms)
        else:
            return False
        self._say(air, packet, EVERYBODY, now_s)
        return True

    def _send_order(self, air: Air, now_s: float, order_ms: int) -> None:
        for robot, kind in list(self._waiting):
            if air.is_permanently_stopped(robot):
                del self._waiting[robot, kind]
            # While `go` is being broadcast, robots that have not received it would ignore orders to move.
            elif now_s >= self._may_order_at_s.get(robot, 0.0) and not (kind == MOTION and self._at_once):
                packet = self._waiting.pop((robot, kind))(robot, order_ms)
                self._told[robot] = self.gateway.number
                self._may_order_at_s[robot] = now_s + (ENTRY_HEADER_BYTES + len(packet)) / ORDER_BYTES_PER_S
                self._say(air, packet, robot, now_s)
                return

    def _say(self, air: Air, packet: bytes, robot: int, now_s: float) -> None:
        air.say(packet, robot)
        self._may_speak_at_s = now_s + 1 / ORDERS_PER_S


class Ordered(Roster):
    """Members of a simulated or real swarm that obey one station; `ids` are the robots' ids in the members' order."""

    def __init__(self, members: Iterable[Member], ids: Sequence[int], station: Station) -> None:
        super().__init__(members)
        self._ids, self._station = ids, station

    @property
    def longest_route(self) -> int:
        """Return the largest number of points of a route."""
        return orders.WAYPOINTS_MAX

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:
        """Order a robot to turn its wheels for 300 ms, and to end its route."""
        i = self._find(address)
        self._members[i].route = ()
        left, right = max(-100, min(100, left_pct)), max(-100, min(100, right_pct))
        self._tell(i, MOTION, partial(self._station.gateway.wheels, left_pct=left, right_pct=right))

    def hold(self) -> None:
        """Stop all robots that obey until `release`: the operator's stop is broadcast first, and repeated."""
        self._station.held = True
        for each in self._members:
            each.route = ()

    def release(self) -> None:
        """Let robots be driven again."""
        self._station.release()

    def set_led(self, address: str, led: Led) -> None:
        """Order a robot to set its LED's colour."""
        self._show(self._find(address), led)

    def _show(self, i: int, led: Led) -> None:
        self._tell(i, COLOUR, partial(self._station.gateway.led, red=led.red, green=led.green, blue=led.blue))

    def _follow(self, i: int, route: Sequence[Point], threshold_mm: float, here: Point) -> None:
        """Order robot i, now at `here`, to visit these points. Raises: UsageError: more than `longest_route`."""
        if len(route) > self.longest_route:
            raise UsageError(f"route of {len(route)} points", f"use at most {self.longest_route}")
        points = [(round(point.x_mm), round(point.y_mm)) for point in route]
        near = round(min(max(threshold_mm, 1), orders.THRESHOLD_MAX_MM))
        self._tell(i, MOTION, partial(self._station.gateway.route, threshold_mm=near, points_mm=points))
        self._members[i].route = (here, *route) if route else ()
        self._members[i].threshold_mm = threshold_mm

    def _tell(self, i: int, kind: int, make: partial[bytes]) -> None:
        self._station.queue_order(self._ids[i], kind, make)
