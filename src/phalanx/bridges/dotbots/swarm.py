"""DotBots, real or simulated by PyDotBot, as a `phalanx.robot.Swarm`."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Any, Self

from phalanx.errors import Held, Unknown, UsageError
from phalanx.robot import Led, Point, Robot

from .line import DotbotUrl, Line
from .stream import DOTBOT

LONGEST_ROUTE = 16  # points that a DotBot's firmware stores
OLD_S = 0.3  # lifetime of a joystick command; the firmware stops by itself after 0.5 s
ROUTE_OLD_S = 1.0
HOLD_AGAIN_S = 0.5


class DotbotSwarm:
    """Robots of one controller, within a context: it connects at the beginning, and stops moving robots at the end.

    While the controller is unreachable, `robots` returns the last known states and commands raise `Unknown`. A stop
    is queued, and sent when the connection is back.

    Raises: Unavailable: no controller within `wait_s`.
    Source: PyDotBot 0.33, dotbot/server.py.
    """

    longest_route = LONGEST_ROUTE
    unprotected = "DotBots do not audit each other: nothing stops a compromised one"

    def __init__(self, url: DotbotUrl, wait_s: float) -> None:
        self._line = Line(url)
        self._wait_s = wait_s
        self._lock = threading.Lock()  # held only while a command is queued
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
        """Return width and height of the controller's site, mm; 2 by 2 m if it has none."""
        return self._line.area_mm

    def robots(self) -> Sequence[Robot]:
        """Return all DotBots that the controller lists."""
        heard_at_s = time.time() if self._line.lost_at_s is None else self._line.lost_at_s
        told = self._line.robots.values()
        return [bot.robot._replace(heard_at_s=heard_at_s) if bot.active else bot.robot for bot in told]

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:
        """Turn the wheels; a DotBot stops after 0.5 s without a new command. Raises: Held, Unknown."""
        self._find(address)
        if not (left_pct or right_pct):
            with self._lock:
                self._under_way.discard(address)
                self._line.orders.put(address, "wheels", _wheels(address, 0, 0))
            return
        self._move(address, _wheels(address, left_pct, right_pct), OLD_S)

    def stop(self, address: str) -> None:
        """Stop the robot and end its route. Raises: Unknown."""
        if address not in self._line.robots:
            raise Unknown("no such robot")
        with self._lock:
            self._under_way.discard(address)
            self._line.orders.put(address, "wheels", *_standing(address))

    def hold(self) -> None:
        """Stop all robots until `release`; repeated at most twice a second."""
        now_s = time.monotonic()
        with self._lock:
            if self._held_at_s is not None and now_s - self._held_at_s < HOLD_AGAIN_S:
                return
            self._held_at_s = now_s
            self._under_way.clear()
            for address in self._line.robots:
                # Both messages each time: a shorter list would replace a queued end of the route.
                self._line.orders.put(address, "wheels", *_standing(address))

    def release(self) -> None:
        """Allow commands again."""
        self._held_at_s = None

    def set_led(self, address: str, led: Led) -> None:
        """Set the LED's colour. Raises: Unknown."""
        self._find(address)
        colour = {"red": led.red, "green": led.green, "blue": led.blue}
        self._line.orders.put(
            address, "led", _words("rgb_led", address, colour), until_s=time.monotonic() + ROUTE_OLD_S
        )

    def follow(self, address: str, route: Sequence[Point], threshold_mm: float) -> None:
        """Visit these points in order, at most 16; an empty route stops it. Raises: Held, Unknown, UsageError."""
        self._find(address)
        if not route:
            self.stop(address)
            return
        if len(route) > LONGEST_ROUTE:
            raise UsageError(f"a route of {len(route)} points", f"at most {LONGEST_ROUTE}")
        self._move(address, _route(address, route, threshold_mm), ROUTE_OLD_S)

    def clear_history(self, address: str) -> None:
        """Delete the robot's trail in the controller. Raises: Unknown."""
        self._find(address)
        self._line.trails.put(address, "trail", f"/controller/dotbots/{address}/positions")

    def _find(self, address: str) -> None:
        if address not in self._line.robots:
            raise Unknown("no such robot")
        if self._line.lost_at_s is not None:
            raise Unknown("no connection to the DotBot controller")

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
    # The first stops the wheels at once; the controller repeats the second until the robot confirms it.
    return _wheels(address, 0, 0), _route(address, (), 0)
