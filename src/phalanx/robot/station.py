"""The station that sends signed orders of a gateway and its operator, and the swarm of robots that obey it.

It says the gateway's beacon and the operator's stop to all, and visitors' orders each to its robot, all of it signed.
It speaks no faster than the channel and a robot's log have room for, whatever visitors do: of several orders of one
kind that wait for one robot only the newest is said. Its radio and its clock are whoever's asks it to speak: those of a
simulation, or of a gateway.
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

# A robot's log has room for so many bytes of orders a second.
ORDER_BYTES_PER_S = 700
# All robots' together: a tenth of the channel.
ORDERS_PER_S = 330
BEACON_S = 1.0
# What all are told may be lost on the air: a stop, and its end, is said so often at once, and then with each beacon.
AT_ONCE, AGAIN_S = 5, 0.1
MOTION, COLOUR = 0, 1  # kinds of orders
# What makes an order's packet of the robot's id and the signer's clock, ms.
Make = Callable[[int, int], bytes]


class Air(Protocol):
    """The radio of a station."""

    def is_busy(self) -> bool:
        """Return whether the last packet still waits to go out."""

    def is_deaf(self, robot: int) -> bool:
        """Return whether the robot is known to be stopped for good."""

    def say(self, packet: bytes, robot: int) -> None:
        """Send a packet to a robot, or to EVERYBODY."""


class Station:
    """One radio that is no robot; robots go by their ids.

    Attributes:
        gateway, operator: who signs what it says.
        held: whether the operator has all robots stand still; may be set by another thread.
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

    def tell(self, robot: int, kind: int, make: Make) -> None:
        """Queue an order for the robot, in the place of one of its kind; for any thread."""
        self._waiting[robot, kind] = make

    def release(self) -> None:
        """Let robots be driven again, and tell them so: a station before this one may have had them stand."""
        self.held = False
        self._let_go = True

    def drop_pending(self) -> None:
        """Drop waiting colours, and wait for no robot's log: for the last orders."""
        self._drop(COLOUR)

    @property
    def has_pending_order(self) -> bool:
        """Return whether an order waits, or a broadcast goes on."""
        return bool(self._waiting or self._at_once)

    def told(self, robot: int) -> int | None:
        """Return the number of the last order to the robot; None if one to move still waits."""
        return None if (robot, MOTION) in self._waiting else self._told.get(robot, 0)

    def speak(self, air: Air, now_s: float, said_ms: int) -> float:
        """Send what is due, one packet at a time; `said_ms` is the signers' clock.

        Returns: when to ask again, s; never if nothing waits.
        """
        self._receive_stop(now_s)
        if now_s >= self._may_speak_at_s and not air.is_busy() and not self._broadcast_order(air, now_s, said_ms):
            self._send_order(air, now_s, said_ms)
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
        for key in list(self._waiting):  # another thread may tell something meanwhile
            if key[1] == kind:
                self._waiting.pop(key)
        # What a long route has used up of a robot's log is made good when it stands.
        self._may_order_at_s.clear()

    def _broadcast_order(self, air: Air, now_s: float, said_ms: int) -> bool:
        if now_s >= self._operator_at_s:
            self._operator_at_s = now_s + (AGAIN_S if self._at_once else BEACON_S)
            self._at_once = max(0, self._at_once - 1)
            packet = self.operator.stop(said_ms) if self._was_held else self.operator.go(said_ms)
        elif now_s >= self._beacon_at_s:
            self._beacon_at_s = now_s + BEACON_S
            packet = self.gateway.beacon(said_ms)
        else:
            return False
        self._say(air, packet, EVERYBODY, now_s)
        return True

    def _send_order(self, air: Air, now_s: float, said_ms: int) -> None:
        for robot, kind in list(self._waiting):
            if air.is_deaf(robot):
                del self._waiting[robot, kind]
            # Who has not heard yet that it may move would not obey.
            elif now_s >= self._may_order_at_s.get(robot, 0.0) and not (kind == MOTION and self._at_once):
                packet = self._waiting.pop((robot, kind))(robot, said_ms)
                self._told[robot] = self.gateway.number
                self._may_order_at_s[robot] = now_s + (ENTRY_HEADER_BYTES + len(packet)) / ORDER_BYTES_PER_S
                self._say(air, packet, robot, now_s)
                return

    def _say(self, air: Air, packet: bytes, robot: int, now_s: float) -> None:
        air.say(packet, robot)
        self._may_speak_at_s = now_s + 1 / ORDERS_PER_S


class Ordered(Roster):
    """Members of a simulated or real swarm that obey one station; `ids` has the robots' ids, by row."""

    def __init__(self, members: Iterable[Member], ids: Sequence[int], station: Station) -> None:
        super().__init__(members)
        self._ids, self._station = ids, station

    @property
    def longest_route(self) -> int:
        """Most points of a route."""
        return orders.WAYPOINTS_MAX

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:
        """Turn the wheels for 300 ms; ends waypoint following."""
        i = self._find(address)
        self._members[i].route = ()
        left, right = max(-100, min(100, left_pct)), max(-100, min(100, right_pct))
        self._tell(i, MOTION, partial(self._station.gateway.wheels, left_pct=left, right_pct=right))

    def hold(self) -> None:
        """All that do not lie stand still until `release`: the operator says so to all, before all else, and again."""
        self._station.held = True
        for each in self._members:
            each.route = ()

    def release(self) -> None:
        """They may be driven again."""
        self._station.release()

    def set_led(self, address: str, led: Led) -> None:
        """Show a colour."""
        self._show(self._find(address), led)

    def _show(self, i: int, led: Led) -> None:
        self._tell(i, COLOUR, partial(self._station.gateway.led, red=led.red, green=led.green, blue=led.blue))

    def _follow(self, i: int, route: Sequence[Point], threshold_mm: float, here: Point) -> None:
        """Robot i, which is `here`, is to visit these points. Raises: UsageError: more than `longest_route`."""
        if len(route) > self.longest_route:
            raise UsageError(f"a route of {len(route)} points", f"at most {self.longest_route}")
        points = [(round(point.x_mm), round(point.y_mm)) for point in route]
        near = round(min(max(threshold_mm, 1), orders.THRESHOLD_MAX_MM))
        self._tell(i, MOTION, partial(self._station.gateway.route, threshold_mm=near, points_mm=points))
        self._members[i].route = (here, *route) if route else ()
        self._members[i].threshold_mm = threshold_mm

    def _tell(self, i: int, kind: int, make: partial[bytes]) -> None:
        self._station.tell(self._ids[i], kind, make)
