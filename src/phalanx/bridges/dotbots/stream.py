"""Parser of the state stream of PyDotBot's controller: validates messages and keeps the robots' states.

Only this file parses the stream, protocol 2 of PyDotBot 0.33. Values are complete and in range, or `BadPayload` is
raised; the reader of the socket limits the length.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

from phalanx.errors import BadPayload
from phalanx.robot import Led, Point, Robot

PROTOCOL = 2
ADDRESS = re.compile(r"[0-9A-F]{16}")
MOST_ROBOTS = 2000  # the limit of the visitors' page
TRAIL_POINTS = 200  # requested and stored; the controller has 1000 of each
MOST_POINTS = 1000
ANY_AREA_MM = (2000, 2000)  # PyDotBot's default for a site without an extent
LARGEST_AREA_MM = FAR_MM = 1_000_000
NOWHERE = Point(math.nan, math.nan)
UNSAID_LED = Led(128, 128, 128)  # the controller sends a colour only after it was set
UNSAID_THRESHOLD_MM = 100
DOTBOT, FOLLOWING = 0, 1  # application, mode
# Least silence of a robot that is active, inactive or lost, as our pages distinguish them.
SILENT_S = (0.0, 5.0, 60.0)


@dataclass(frozen=True, slots=True)
class Dotbot:
    """State of one robot."""

    words: Mapping[str, Any]  # fields by name, checked
    robot: Robot
    active: bool  # heard recently, according to the controller


class _Known:
    """Robots with complete states."""

    def __init__(self) -> None:
        self.here: dict[str, Dotbot] = {}
        self.others: set[str] = set()  # boats, and all others that are no DotBots
        self._names: dict[str, str] = {}  # short name -> address

    def add(self, address: str, words: dict[str, Any], now_s: float) -> None:
        if _whole(words.get("application"), 0, 255) != DOTBOT:
            self.others.add(address)
        else:
            short = address[-4:]
            name = short if self._names.setdefault(short, address) == address else address
            nobody = Robot(address, name, NOWHERE, 0, 0.0, UNSAID_LED, (), 0.0, now_s, ())
            self.here[address] = _changed(Dotbot({}, nobody, True), {"status": 0} | words, now_s)
        if len(self.here) + len(self.others) > MOST_ROBOTS:
            raise BadPayload(f"more than {MOST_ROBOTS} robots")


class Fleet:
    """Robots of one connection; None until the first snapshot is complete. Source: PyDotBot 0.33, dotbot/stream.py."""

    def __init__(self) -> None:
        self.robots: Mapping[str, Dotbot] | None = None
        self._known = _Known()
        self._coming: _Known | None = None  # of an incomplete snapshot

    def hear(self, text: str, now_s: float) -> int | None:
        """Process a message; return the number to acknowledge, if it has one. Raises: BadPayload."""
        try:
            said = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise BadPayload("no JSON") from error
        kind = said.get("type") if isinstance(said, dict) else None
        if kind == "hello":
            if (protocol := _whole(said.get("protocol"), 0, 1000)) != PROTOCOL:
                raise BadPayload(f"protocol {protocol} of the stream, not {PROTOCOL}")
            return None
        if kind not in ("snapshot", "delta", "event"):
            raise BadPayload("no message of the stream")
        number = _whole(said.get("seq"), 0, 2**63)
        if kind == "snapshot":
            self._hear_part(said, now_s)
        elif kind == "delta":
            self._hear_changes(said, now_s)
        return number

    def _hear_part(self, said: dict[str, Any], now_s: float) -> None:
        parts = _whole(said.get("parts"), 1, MOST_ROBOTS)
        if (part := _whole(said.get("part"), 1, parts)) == 1:
            self._coming = _Known()
        if self._coming is None:
            raise BadPayload("a part before the first")
        for robot in _list(said.get("robots"), MOST_ROBOTS):  # validate at once instead of storing up to 4 MiB
            self._coming.add(_address(_object(robot).get("address")), robot, now_s)
        if part == parts:
            self._known, self._coming = self._coming, None
            self._publish()

    def _hear_changes(self, said: dict[str, Any], now_s: float) -> None:
        known = self._known
        for address, patch in _object(said.get("robots")).items():
            _address(address)
            if patch is None:
                known.here.pop(address, None)
                known.others.discard(address)
            elif "address" in _object(patch):
                known.add(address, patch, now_s)
            elif address in known.here:
                known.here[address] = _changed(known.here[address], patch, now_s)
            elif address not in known.others:
                raise BadPayload("a change of an unknown robot")
        self._publish()

    def _publish(self) -> None:
        self.robots = MappingProxyType(dict(self._known.here))


def area_of(site: bytes) -> tuple[int, int]:
    """Return width and height of a site, mm, from the controller's answer. Raises: BadPayload."""
    try:
        extent = _object(json.loads(site)).get("extent_mm")
    except (ValueError, RecursionError) as error:
        raise BadPayload("no JSON") from error
    if extent is None:
        return ANY_AREA_MM
    sides = _list(extent, 2)
    if len(sides) != 2:
        raise BadPayload("an extent has two sides")
    return _whole(sides[0], 1, LARGEST_AREA_MM), _whole(sides[1], 1, LARGEST_AREA_MM)


def _changed(before: Dotbot, patch: dict[str, Any], now_s: float) -> Dotbot:
    """Apply an RFC 7396 merge patch to the fields that we use; null removes a value."""
    said = {name: None if patch[name] is None else form(patch[name]) for name, form in _FORMS.items() if name in patch}
    words = {**before.words, **{name: value for name, value in said.items() if not name.startswith("trail")}}
    robot, trail = before.robot, before.robot.history
    if "trail" in said or "trail_reset" in said:
        trail = said.get("trail") or ()
    # Unchanged tuples keep their identity: state updates compare them ten times a second.
    if more := said.get("trail_append"):
        trail = (*trail, *more)
    status = words.get("status") or 0
    return Dotbot(
        words,
        robot._replace(
            at=_at(words),
            direction_deg=(words.get("direction") or 0) % 360,
            battery_v=words.get("battery") or 0.0,
            led=words.get("rgb_led") or UNSAID_LED,
            route=(words.get("waypoints") or ()) if words.get("mode") == FOLLOWING else (),
            threshold_mm=float(words.get("waypoints_threshold") or UNSAID_THRESHOLD_MM),
            heard_at_s=now_s - SILENT_S[status] if said.get("status") is not None else robot.heard_at_s,
            history=trail[-TRAIL_POINTS:] if len(trail) > TRAIL_POINTS else trail,
        ),
        status == 0,
    )


def _at(words: Mapping[str, Any]) -> Point:
    """Return the middle of the axle, which waypoints steer, else the lighthouse's position. Source: PyDotBot 0.33."""
    return words.get("axle_position") or words.get("pose") or words.get("lh2_position") or NOWHERE


def _address(value: Any) -> str:
    if not (isinstance(value, str) and ADDRESS.fullmatch(value)):
        raise BadPayload("an address is 16 upper-case hexadecimal digits")
    return value


def _object(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise BadPayload("not an object")
    return value


def _list(value: Any, longest: int) -> list[Any]:
    if not isinstance(value, list) or len(value) > longest:
        raise BadPayload(f"not a list of at most {longest}")
    return value


def _number(value: Any, low: float, high: float) -> float:
    # Written so that NaN fails.
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise BadPayload(f"not a number of {low}..{high}")
    return value


def _whole(value: Any, low: int, high: int) -> int:
    if isinstance(value, float):
        raise BadPayload("not a whole number")
    return int(_number(value, low, high))


def _place(value: Any) -> Point:
    x, y = (_number(_object(value).get(key), -math.inf, math.inf) for key in ("x", "y"))
    # A robot with uncalibrated lighthouses sends arbitrary numbers: it has no position; others are unaffected.
    return Point(float(x), float(y)) if max(abs(x), abs(y)) <= FAR_MM else NOWHERE


def _pose(value: Any) -> Point | None:
    return None if _object(value).get("heading_source") == "none" else _place(value)


def _places(value: Any) -> tuple[Point, ...]:
    return tuple(_place(point) for point in _list(value, MOST_POINTS))


def _led(value: Any) -> Led:
    return Led(*(_whole(_object(value).get(key), 0, 255) for key in ("red", "green", "blue")))


_FORMS: dict[str, Callable[[Any], Any]] = {
    "status": partial(_whole, low=0, high=2),
    "mode": partial(_whole, low=0, high=255),
    "direction": partial(_whole, low=-36000, high=36000),
    "lh2_position": _place,
    "axle_position": _place,
    "pose": _pose,
    "rgb_led": _led,
    "waypoints": _places,
    "waypoints_threshold": partial(_whole, low=0, high=65535),
    "battery": partial(_number, low=0, high=100),
    "trail": _places,
    "trail_append": _places,
    "trail_reset": bool,
}
