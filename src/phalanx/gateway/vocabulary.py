"""PyDotBot's message formats: parse commands into checked values, and encode robots as PyDotBot does.

Only this file contains the names of fields (docs/spec/vocabulary.md). Invalid values of peers raise `BadPayload`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import islice
from typing import Any

from phalanx.errors import BadPayload
from phalanx.robot import Led, Point, Robot

APPLICATION = "0"
REQUEST_ROBOTS = 0
REQUEST_AREA = 1
REQUEST_WALLS = 2
REQUEST_LIT = 3
# Names of these requests in sessions.
REQUEST_NAMES = {REQUEST_ROBOTS: "robots", REQUEST_AREA: "area", REQUEST_WALLS: "walls", REQUEST_LIT: "lit"}
WHEEL_LIMIT = 128  # range of a signed byte
MAX_WAYPOINTS = 64
THRESHOLD_MM = (1, 1000)
QUIET_AFTER_S = 5.0
LOST_AFTER_S = 60.0
POINT_BYTES = 34  # length of a point in a trail, as JSON


class Notice(IntEnum):
    """The field `cmd` of a notification."""

    RELOAD = 1
    UPDATE = 2
    NEW_ROBOT = 4
    FRAME = 16


class Status(IntEnum):
    """How recently a robot was heard."""

    ACTIVE = 0
    INACTIVE = 1
    LOST = 2


@dataclass(frozen=True, slots=True)
class MoveRaw:
    """Speeds of the wheels, -100 to 100 percent."""

    left_pct: int
    right_pct: int


@dataclass(frozen=True, slots=True)
class Waypoints:
    """A route; () stops the robot."""

    points: tuple[Point, ...]
    threshold_mm: float


def parse_move_raw(payload: Any) -> MoveRaw:
    """Parse the wheel speeds of a joystick. Raises: BadPayload."""
    left, right = (_number(payload, key, -WHEEL_LIMIT, WHEEL_LIMIT) for key in ("left_y", "right_y"))
    left_pct, right_pct = (max(-100, min(100, round(value))) for value in (left, right))
    return MoveRaw(left_pct, right_pct)


def parse_rgb_led(payload: Any) -> Led:
    """Parse a colour. Raises: BadPayload."""
    red, green, blue = (round(_number(payload, key, 0, 255)) for key in ("red", "green", "blue"))
    return Led(red, green, blue)


def parse_waypoints(payload: Any, area_mm: tuple[int, int], longest: int = MAX_WAYPOINTS) -> Waypoints:
    """Parse a route of at most `longest` points inside the area. Raises: BadPayload."""
    threshold = _number(payload, "threshold", *THRESHOLD_MM)
    points = payload["waypoints"] if isinstance(payload.get("waypoints"), list) else None
    if points is None or len(points) > longest:
        raise BadPayload(f"'waypoints' is a list of at most {longest}")
    width, height = area_mm
    return Waypoints(tuple(Point(_number(p, "x", 0, width), _number(p, "y", 0, height)) for p in points), threshold)


def _number(payload: Any, key: str, low: float, high: float) -> float:
    value = payload.get(key) if isinstance(payload, dict) else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise BadPayload(f"{key!r} is a number")
    # This form rejects NaN; 1e999 in JSON becomes infinity.
    if not low <= value <= high:
        raise BadPayload(f"{key!r} is {low}..{high}")
    return value


def status(robot: Robot, now_s: float) -> Status:
    """Return whether the robot is active, quiet or lost."""
    silent_s = now_s - robot.heard_at_s
    if silent_s >= LOST_AFTER_S:
        return Status.LOST
    return Status.INACTIVE if silent_s >= QUIET_AFTER_S else Status.ACTIVE


def robot_json(robot: Robot, now_s: float, history: int | None = None) -> dict[str, Any]:
    """Return a robot as in answers to request 0; `history` limits the trail to its newest points."""
    length = len(robot.history)
    trail = list(islice(robot.history, max(0, length - history) if history is not None else 0, None))
    return {
        "address": robot.address,
        "name": robot.name,
        "application": int(APPLICATION),
        "swarm": "0000",
        "status": int(status(robot, now_s)),
        "mode": int(bool(robot.route)),
        "last_seen": round(robot.heard_at_s, 3),
        "direction": robot.direction_deg,
        "lh2_position": _tell_place(robot.at),
        "rgb_led": tell_led(robot.led),
        "waypoints": tell_places(robot.route),
        "waypoints_threshold": round(robot.threshold_mm),
        "position_history": tell_places(trail),
        "calibrated": 1,
        "battery": round(robot.battery_v, 3),
    }


def robots_json(robots: Sequence[Robot], now_s: float, wish_bytes: int, limit_bytes: int) -> list[dict[str, Any]]:
    """Return the whole answer to request 0, for pages of PyDotBot.

    Trails are cut to their newest points so that it is no longer than `wish_bytes`, if that is enough; above
    `limit_bytes` routes are left out, and in the end robots.
    """
    told = [robot_json(robot, now_s, 0) for robot in robots]
    size = _size(told)
    points = max((len(robot.history) for robot in robots), default=0)
    if points and robots:
        # Cut before building: a thousand points for each of a hundred robots would block the gateway for a while.
        points = min(points, max(0, wish_bytes - size) // (len(robots) * POINT_BYTES))
        told = [robot_json(robot, now_s, points) for robot in robots]
        size = _size(told)
    if size > limit_bytes:
        told = [robot | {"waypoints": []} for robot in told]
    while _size(told) > limit_bytes:
        told = told[: len(told) // 2]
    return told


def _size(told: list[dict[str, Any]]) -> int:
    return len(json.dumps(told, separators=(",", ":")))


def tell_led(led: Led) -> dict[str, int]:
    """Return a colour as JSON-ready types."""
    return {"red": led.red, "green": led.green, "blue": led.blue}


def tell_update(robot: Robot) -> dict[str, Any]:
    """Return one robot's movement, for pages of PyDotBot."""
    return {
        "address": robot.address,
        "direction": robot.direction_deg,
        "lh2_position": _tell_place(robot.at),
        "battery": round(robot.battery_v, 3),
    }


def _tell_place(place: Point) -> dict[str, float] | None:
    # NaN from a driver means an unknown place. It is not JSON, and would make the whole list invalid.
    if not (math.isfinite(place.x_mm) and math.isfinite(place.y_mm)):
        return None
    return {"x": round(place.x_mm, 1), "y": round(place.y_mm, 1), "z": 0}


def tell_places(places: Iterable[Point]) -> list[dict[str, float]]:
    """Return the points of a trail, or of a route, whose first point is the robot's place when it started."""
    return [told for place in places if (told := _tell_place(place))]
