"""Three robots in the words of PyDotBot, as its controller would tell them to a page.

PyDotBot itself needs radio adapters and, since 0.30, a second process; what a page can see of it is small enough to
say again here. It is said from its sources: 0.28 (fractions of the area's side, lower-case addresses, "reload" after
every change) and 0.30 (millimetres, upper-case addresses, the change itself after every change, request 1).
"""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

AREA_MM = 2000
TOP_SPEED_MM_S = 300  # at 100 % on both wheels
TRACK_MM = 75
DRIVE_TIMEOUT_S = 0.3  # the robots' firmware stops by itself; a lost last command must not drive one into the wall
HISTORY = 1000

RELOAD, UPDATE, NEW_DOTBOT = 1, 2, 4
DOTBOTS, MAP_SIZE = 0, 1

STARTS = [
    ("badcafe111111111", 500.0, 500.0, 0),
    ("deadbeef22222222", 1500.0, 500.0, 90),
    ("b0b0f00d33333333", 1000.0, 1500.0, 180),
]
LATECOMER = ("badc0de444444444", 1000.0, 1000.0, 270)


@dataclass
class Robot:
    address: str
    x_mm: float
    y_mm: float
    direction_deg: float
    wheels: tuple[float, float] = (0.0, 0.0)  # left, right, in percent
    driven_at: float = 0.0
    rgb_led: dict[str, int] | None = None
    move_raw: dict[str, int] | None = None
    waypoints: list[dict[str, float]] = field(default_factory=list)  # as published: its first is where it started
    threshold: int | None = None
    route_mm: list[tuple[float, float]] = field(default_factory=list)  # what is left of them
    history: list[dict[str, float]] = field(default_factory=list)
    battery_v: float = 2.9


def whole(value: Any) -> int:
    """The integer that PyDotBot's models make of a value; raises as they do where there is a fraction."""
    if value != int(value):
        raise ValueError(f"{value!r} is not a whole number")
    return int(value)


class Fleet:
    """What PyDotBot's controller knows, and what it publishes when something changes."""

    def __init__(self, *, millimetres: bool) -> None:
        self.millimetres = millimetres
        self.robots: dict[str, Robot] = {}
        for start in STARTS:
            self._add(*start)

    # -- what comes in

    def answer(self, payload: Any) -> dict[str, Any] | None:
        """The reply to one request, or None where PyDotBot only logs a warning."""
        if payload.get("request") == DOTBOTS:
            return {"request": DOTBOTS, "data": [self._robot(r) for _, r in sorted(self.robots.items())]}
        if payload.get("request") == MAP_SIZE and self.millimetres:
            return {"request": MAP_SIZE, "data": {"width": AREA_MM, "height": AREA_MM}}
        return None

    def command(self, address: str, name: str, payload: Any) -> dict[str, Any] | None:
        """Carries out one command; returns the notification that PyDotBot publishes after it."""
        robot = self.robots.get(address)
        if robot is None:
            return None
        if name == "move_raw":
            robot.move_raw = {k: whole(payload[k]) for k in ("left_x", "left_y", "right_x", "right_y")}
            robot.wheels = tuple(max(-100.0, min(100.0, robot.move_raw[k])) for k in ("left_y", "right_y"))
            robot.driven_at, robot.route_mm = time.monotonic(), []
            return None
        if name == "rgb_led":
            robot.rgb_led = {k: whole(payload[k]) for k in ("red", "green", "blue")}
            return self._changed(robot, rgb_led=robot.rgb_led)
        if name == "waypoints":
            # 0.28 refuses a waypoint without z; 0.30 has forgotten it.
            axes = ("x", "y") if self.millimetres else ("x", "y", "z")
            points = [{axis: float(point[axis]) for axis in axes} for point in payload["waypoints"]]
            robot.threshold = whole(payload["threshold"])
            robot.route_mm = [(p["x"] * self._mm_per_unit, p["y"] * self._mm_per_unit) for p in points]
            robot.waypoints = [self._position(robot), *points]
            return self._changed(robot, lh2_waypoints=robot.waypoints, waypoints_threshold=robot.threshold)
        if name == "clear_position_history":
            robot.history = []
            return self._changed(robot, position_history=[])
        return None

    def join(self) -> dict[str, Any]:
        """A fourth robot arrives. 0.30 means to send it along, but attaches data to every notification except this."""
        self._add(*LATECOMER)
        return {"cmd": NEW_DOTBOT if self.millimetres else RELOAD}

    # -- what happens by itself

    def step(self, dt_s: float) -> None:
        """Moves every robot for dt_s."""
        now = time.monotonic()
        for robot in self.robots.values():
            if robot.route_mm:
                self._steer(robot)
            elif now - robot.driven_at > DRIVE_TIMEOUT_S:
                robot.wheels = (0.0, 0.0)
            left, right = (w / 100 * TOP_SPEED_MM_S for w in robot.wheels)
            turn = math.degrees((left - right) / TRACK_MM * dt_s)
            robot.direction_deg = (robot.direction_deg + turn) % 360
            ahead, heading = (left + right) / 2 * dt_s, math.radians(robot.direction_deg)
            robot.x_mm = max(0.0, min(AREA_MM, robot.x_mm - ahead * math.sin(heading)))
            robot.y_mm = max(0.0, min(AREA_MM, robot.y_mm + ahead * math.cos(heading)))
            robot.battery_v = max(1.8, robot.battery_v - dt_s * 1e-4)

    def updates(self) -> Iterator[dict[str, Any]]:
        """One notification for every robot, as each of its advertisements makes PyDotBot publish."""
        for robot in list(self.robots.values()):
            robot.history = [*robot.history, self._position(robot)][-HISTORY:]
            if self.millimetres:
                # 0.30 overwrites the short update that it has just made with the whole robot, history and all.
                yield {"cmd": UPDATE, "data": self._robot(robot)}
            else:
                yield {
                    "cmd": UPDATE,
                    "data": {
                        "address": robot.address,
                        "direction": int(robot.direction_deg),
                        "lh2_position": self._position(robot),
                        "battery": round(robot.battery_v, 3),
                    },
                }

    # -- inside

    @property
    def _mm_per_unit(self) -> float:
        return 1.0 if self.millimetres else float(AREA_MM)

    def _add(self, address: str, x_mm: float, y_mm: float, direction_deg: float) -> None:
        address = address.upper() if self.millimetres else address
        self.robots[address] = Robot(address, x_mm, y_mm, direction_deg)

    def _steer(self, robot: Robot) -> None:
        x_mm, y_mm = robot.route_mm[0]
        dx, dy = x_mm - robot.x_mm, y_mm - robot.y_mm
        # 0.28 keeps the threshold in thousandths of the side, whatever the side is.
        within_mm = (robot.threshold or 0) * self._mm_per_unit / (1 if self.millimetres else 1000)
        if math.hypot(dx, dy) <= max(within_mm, 5.0):
            robot.route_mm.pop(0)
            robot.wheels = (0.0, 0.0)
            return
        error = (math.degrees(math.atan2(-dx, dy)) - robot.direction_deg + 180) % 360 - 180
        turn = max(-40.0, min(40.0, error))
        ahead = 60.0 if abs(error) < 60 else 0.0
        robot.wheels = (ahead + turn, ahead - turn)

    def _position(self, robot: Robot) -> dict[str, float]:
        if self.millimetres:
            return {"x": round(robot.x_mm), "y": round(robot.y_mm)}
        return {"x": round(robot.x_mm / AREA_MM, 6), "y": round(robot.y_mm / AREA_MM, 6), "z": 0.0}

    def _changed(self, robot: Robot, **change: Any) -> dict[str, Any]:
        if not self.millimetres:
            return {"cmd": RELOAD}
        return {"cmd": UPDATE, "data": {"address": robot.address, **change}}

    def _robot(self, robot: Robot) -> dict[str, Any]:
        # model_dump(exclude_none=True): what is unknown is absent, not null.
        whole = {
            "address": robot.address,
            "application": 0,
            "swarm": "0000",
            "status": 0,
            "mode": int(bool(robot.route_mm)) if self.millimetres else 0,  # 0.28 never sets it
            "last_seen": time.time(),
            "direction": int(robot.direction_deg),
            "move_raw": robot.move_raw,
            "rgb_led": robot.rgb_led,
            "lh2_position": self._position(robot),
            "waypoints": robot.waypoints,
            "waypoints_threshold": robot.threshold or (100 if self.millimetres else 40),
            "position_history": robot.history,
            "calibrated": 0xFF if self.millimetres else True,
            "battery": round(robot.battery_v, 3),
        }
        return {key: value for key, value in whole.items() if value is not None}
