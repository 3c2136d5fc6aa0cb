"""Real DotBots, or PyDotBot's simulated ones, as a `phalanx.robot.Swarm`."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Any, Self

from phalanx.errors import Held, Unknown, UsageError
from phalanx.robot import Led, Point, Robot

from .line import DotbotUrl, Line
from .told import DOTBOT

LONGEST_ROUTE = 16  # points that a DotBot's firmware keeps
OLD_S = 0.3  # a joystick's word is good for so long, and the firmware stops by itself after 0.5 s
ROUTE_OLD_S = 1.0
HOLD_AGAIN_S = 0.5


class DotbotSwarm:
    """The robots of one controller, while the context lasts; on the way in it is waited for, on the way out robots
    that are still under way by our word are stopped.

    While the controller is away robots are told where they were last, and refuse orders as unknown; a stop that was
    said meanwhile is said to them as soon as it is back.

    Raises: Unavailable: no controller within `wait_s`.
    Source: PyDotBot 0.33, dotbot/server.py.
    """

    longest_route = LONGEST_ROUTE
    unprotected = "DotBots do not audit each other: nothing stops one that lies"

    def __init__(self, url: DotbotUrl, wait_s: float) -> None:
        self._line = Line(url)
        self._wait_s = wait_s
        self._lock = threading.Lock()  # held for no longer than it takes to note an order
        self._held_at_s: float | None = None
        self._under_way: set[str] = set()

    def __enter__(self) -> Self:
        self._line.__enter__()
        try:
            self._line.wait(self._wait_s)
        except BaseException:
            self._line.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:
            for address in self._under_way:
                self._line.orders.put(address, "wheels", *_standing(address))
        self._line.__exit__()

    @property
    def area_mm(self) -> tuple[int, int]:
        """Width and height of the controller's site; 2 by 2 m, if it says none."""
        return self._line.area_mm

    def robots(self) -> Sequence[Robot]:
        """Every DotBot that the controller tells of."""
        heard_at_s = time.time() if self._line.lost_at_s is None else self._line.lost_at_s
        told = self._line.robots.values()
        return [bot.robot._replace(heard_at_s=heard_at_s) if bot.active else bot.robot for bot in told]

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:
        """Turn the wheels, for half a second at most: a DotBot wants to be told again. Raises: Held."""
        self._find(address)
        if not (left_pct or right_pct):
            with self._lock:
                self._under_way.discard(address)
                self._line.orders.put(address, "wheels", _wheels(address, 0, 0))
            return
        self._move(address, _wheels(address, left_pct, right_pct), OLD_S)

    def stop(self, address: str) -> None:
        """Stand still, and follow nothing."""
        if address not in self._line.robots:
            raise Unknown("no such robot")
        with self._lock:
            self._under_way.discard(address)
            self._line.orders.put(address, "wheels", *_standing(address))

    def hold(self) -> None:
        """All stand still until `release`: said at once, and twice a second again."""
        now_s = time.monotonic()
        with self._lock:
            if self._held_at_s is not None and now_s - self._held_at_s < HOLD_AGAIN_S:
                return
            self._held_at_s = now_s
            self._under_way.clear()
            for address in self._line.robots:
                # With the route's end each time: who says one less takes the place of what waits for the line.
                self._line.orders.put(address, "wheels", *_standing(address))

    def release(self) -> None:
        """They may be driven again."""
        self._held_at_s = None

    def set_led(self, address: str, led: Led) -> None:
        """Show a colour."""
        self._find(address)
        colour = {"red": led.red, "green": led.green, "blue": led.blue}
        self._line.orders.put(
            address, "led", _words("rgb_led", address, colour), until_s=time.monotonic() + ROUTE_OLD_S
        )

    def follow(self, address: str, route: Sequence[Point], threshold_mm: float) -> None:
        """Visit these points in order, at most 16; none stops the robot. Raises: Held, UsageError."""
        self._find(address)
        if not route:
            self.stop(address)
            return
        if len(route) > LONGEST_ROUTE:
            raise UsageError(f"a route of {len(route)} points", f"at most {LONGEST_ROUTE}")
        self._move(address, _route(address, route, threshold_mm), ROUTE_OLD_S)

    def clear_history(self, address: str) -> None:
        """The controller forgets where the robot has been."""
        self._find(address)
        self._line.trails.put(address, "trail", f"/controller/dotbots/{address}/positions")

    def _find(self, address: str) -> None:
        if address not in self._line.robots:
            raise Unknown("no such robot")
        if self._line.lost_at_s is not None:
            raise Unknown("the robots' controller is away")

    def _move(self, address: str, words: dict[str, Any], good_for_s: float) -> None:
        with self._lock:
            if self._held_at_s is not None:
                raise Held("the operator has stopped all robots")
            self._under_way.add(address)
            self._line.orders.put(address, "wheels", words, until_s=time.monotonic() + good_for_s)


def _words(command: str, address: str, data: dict[str, Any]) -> dict[str, Any]:
    return {"cmd": command, "address": address, "application": DOTBOT, "data": data}


def _wheels(address: str, left_pct: int, right_pct: int) -> dict[str, Any]:
    return _words("move_raw", address, {"left_x": 0, "left_y": left_pct, "right_x": 0, "right_y": right_pct})


def _route(address: str, route: Sequence[Point], threshold_mm: float) -> dict[str, Any]:
    points = [{"x": point.x_mm, "y": point.y_mm} for point in route]
    return _words("waypoints", address, {"threshold": round(threshold_mm), "waypoints": points})


def _standing(address: str) -> tuple[dict[str, Any], ...]:
    # The first stops wheels at once; the second is said again by the controller until the robot confirms it.
    return _wheels(address, 0, 0), _route(address, (), 0)
