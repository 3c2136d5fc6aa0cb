"""Floor plans: the walls of a building as line segments, and the outlines of its free space.

They are read from a YAML file (docs/guides/maps.md), in metres and radians in the map frame. `gridmap` reads maps of
ROS's map_server. Files of both kinds may list beacons and other sources of sensor readings; unknown keys are ignored.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import F64x2
from phalanx.config.lidar import ExtractionConfig
from phalanx.config.parameter import check_limits, within
from phalanx.config.written import compose, words_of
from phalanx.errors import UsageError
from phalanx.kernel import kernel

from .outlines import Outline, outlines_of

FILE_MAX_BYTES = 4_000_000
# The search for outlines takes quadratic time in the number of walls.
WALLS_MAX = 2000
# Clearance around a robot's centre that the pilot needs; the survey and the audit of ways use the same value.
PASS_M = 0.25
# A code of 0.12 m was readable with 900 bytes, and not with 1300.
TEXT_MAX_BYTES = 900
READING_MAX_BYTES = 64
SOURCES_MAX = 1000
LARGEST = 1e6


@dataclass(frozen=True, slots=True)
class WallCode:
    """A square QR code on a wall."""

    text: str
    x_m: float  # centre, map frame; z above the floor
    y_m: float  # likewise
    z_m: float  # likewise
    facing_rad: float  # direction in which the code faces, away from the wall
    size_m: float = 0.12  # length of the edge, without the quiet zone


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlan:
    """A floor plan: walls, outlines, QR codes, and other data of a building."""

    name: str
    walls: NDArray[np.float64]  # (n, 4) ends of segments, metres, map frame
    outlines: tuple[Outline, ...]  # closed paths along the walls with free space on the left
    bounds: tuple[float, float, float, float]  # x and y of the lower left and the upper right corner, metres
    start: tuple[float, float, float] | None = None  # start pose of the robots: x, y, heading
    codes: tuple[WallCode, ...] = ()
    extraction: ExtractionConfig = ExtractionConfig()  # noqa: RUF009  # frozen; feature extraction in this building
    sources: tuple[Source, ...] = ()  # sources of other sensor readings
    dust: int = 0  # specks of the map that were left out
    # The walls with these specks, or None if there are none: a speck may be real, and in a doorway hides the doorway.
    drawn: NDArray[np.float64] | None = None

    def clearance_m(self, x_m: float, y_m: float) -> float:
        """Return the distance to the nearest wall; +inf without walls."""
        return clearance(self.walls, float(x_m), float(y_m))

    def inside(self, x_m: float, y_m: float) -> bool:
        """Return True if a place is within the bounds and on the free side of all outlines."""
        x0, y0, x1, y1 = self.bounds
        return x0 <= x_m <= x1 and y0 <= y_m <= y1 and all(o.has_on_free_side(x_m, y_m) for o in self.outlines)

    def sees(self, a: tuple[float, float], b: tuple[float, float]) -> bool:
        """Return True if no wall lies between two places; walls that end at one of the places do not count."""
        x, y = float(b[0]) - float(a[0]), float(b[1]) - float(a[1])
        length = math.hypot(x, y)
        if length < 1e-9:
            return True
        return not _is_crossed(self.walls, float(a[0]), float(a[1]), x, y, min(0.01 / length, 0.25))

    def is_clear(
        self, a: tuple[float, float], b: tuple[float, float], side_m: float, near_m: float, far_m: float
    ) -> bool:
        """Return True if no wall enters a rectangle on the right of the line from a to b.

        It begins `side_m` after a, ends `side_m` before b, and reaches from `near_m` to `far_m` on the right.
        """
        width = math.hypot(b[0] - a[0], b[1] - a[1])
        x, y = (b[0] - a[0]) / width, (b[1] - a[1]) / width
        to = self.walls.reshape(-1, 2, 2) - np.array(a)
        along, right = to @ np.array([x, y]), to @ np.array([y, -x])
        # Clip every wall to the rectangle (Liang and Barsky); the rest is from `first` to `last` of its length.
        first, last = np.zeros(len(to)), np.ones(len(to))
        for start, stop, low, high in (
            (along[:, 0], along[:, 1], side_m, width - side_m),
            (right[:, 0], right[:, 1], near_m, far_m),
        ):
            step = np.where(start == stop, 1e-12, stop - start)
            enter, leave = (low - start) / step, (high - start) / step
            enter, leave = np.minimum(enter, leave), np.maximum(enter, leave)
            first, last = np.maximum(first, enter), np.minimum(last, leave)
        return not bool(np.any(first < last))


@kernel
def clearance(walls: F64x2, x: float, y: float) -> float:
    """Return the distance to the nearest of the walls; +inf without walls."""
    nearest = np.inf
    for i in range(len(walls)):
        along_x, along_y = walls[i, 2] - walls[i, 0], walls[i, 3] - walls[i, 1]
        to_x, to_y = x - walls[i, 0], y - walls[i, 1]
        squared = along_x * along_x + along_y * along_y
        at = (to_x * along_x + to_y * along_y) / squared if squared > 0.0 else 0.0
        at = min(1.0, max(0.0, at))
        to_x, to_y = to_x - at * along_x, to_y - at * along_y
        nearest = min(nearest, to_x * to_x + to_y * to_y)
    return math.sqrt(nearest)


@kernel
def _is_crossed(walls: F64x2, x: float, y: float, way_x: float, way_y: float, margin: float) -> bool:
    """Return True if a wall crosses the line from x, y, ignoring a share `margin` of it at both ends."""
    for i in range(len(walls)):
        along_x, along_y = walls[i, 2] - walls[i, 0], walls[i, 3] - walls[i, 1]
        cross = way_x * along_y - way_y * along_x
        if cross == 0.0:
            continue
        to_x, to_y = walls[i, 0] - x, walls[i, 1] - y
        at_way = (to_x * along_y - to_y * along_x) / cross
        at_wall = (to_x * way_y - to_y * way_x) / cross
        if margin < at_way < 1.0 - margin and 0.0 <= at_wall <= 1.0:
            return True
    return False


def floorplan_of_yaml(data: bytes, name: str = "map") -> FloorPlan:
    """Parse a floor plan in YAML; `name` is its name if the file has none.

    Raises: UsageError: the floor plan is invalid; the message has the place.
    """
    content = read_yaml(data, name)
    walls = np.array(
        [numbers(wall, f"{name}: wall {i + 1}", 4) for i, wall in enumerate(_list(content.get("walls"), name, "walls"))]
    ).reshape(-1, 4)
    if len(walls) > WALLS_MAX:
        raise UsageError(f"{name} has {len(walls)} walls", f"use up to {WALLS_MAX}, or a map_server map")
    if len(walls) and np.any(np.hypot(walls[:, 0] - walls[:, 2], walls[:, 1] - walls[:, 3]) < 1e-3):
        raise UsageError(f"{name}: a wall has no length", "use x, y of both ends")
    start = start_pose(content, name)
    x0, y0 = numbers(content.get("origin", [0.0, 0.0]), f"{name}: origin", 2)
    if "size" in content:
        width, height = numbers(content["size"], f"{name}: size", 2)
        bounds = (x0, y0, x0 + width, y0 + height)
    elif len(walls):
        xs, ys = walls[:, ::2], walls[:, 1::2]
        bounds = (float(xs.min()), float(ys.min()), float(xs.max()), float(ys.max()))
    else:
        raise UsageError(f"{name} has neither walls nor a size", "add size: [width, height] in metres")
    codes = tuple(
        _code(code, f"{name}: code {i + 1}") for i, code in enumerate(_list(content.get("codes"), name, "codes"))
    )
    outlines = outlines_of(walls, bounds, None if start is None else start[:2])
    walls.setflags(write=False)
    return FloorPlan(
        str(content.get("name", name)), walls, outlines, bounds, start, codes, extraction_of(content, name)
    )


def read_yaml(data: bytes, name: str) -> dict[Any, Any]:
    """Return the mapping in a YAML file. Raises: UsageError: too long, or not a mapping."""
    if len(data) > FILE_MAX_BYTES:
        raise UsageError(f"{name} has {len(data)} bytes", f"use up to {FILE_MAX_BYTES}")
    hint = "phalanx docs guides/maps shows a map"
    content = words_of(compose(data, name, hint), data, name, hint)
    if not isinstance(content, dict):
        raise UsageError(f"{name} is not a map", "use a YAML mapping with walls, or with an image")
    return content


def _list(value: Any, name: str, key: str) -> list[Any]:
    if value is None:
        return []
    if not isinstance(value, list):
        raise UsageError(f"{name}: {key} is not a list")
    return value


def numbers(value: Any, where: str, count: int) -> tuple[float, ...]:
    """Return `count` numbers from a file. Raises: UsageError: the value is not a list of so many numbers."""
    if (
        not isinstance(value, list)
        or len(value) != count
        or any(isinstance(item, bool) or not isinstance(item, int | float) or not abs(item) < 1e5 for item in value)
    ):
        raise UsageError(f"{where} is {value!r:.80}", f"use a list of {count} numbers, metres and radians")
    return tuple(float(item) for item in value)


def start_pose(content: Mapping[Any, Any], name: str) -> tuple[float, float, float] | None:
    """Return the start pose x, y, heading in a map's file, or None. Raises: UsageError: it is not a pose."""
    if "start_pose" not in content:
        return None
    x, y, heading = numbers(content["start_pose"], f"{name}: start_pose", 3)
    return x, y, heading


def extraction_of(content: Mapping[Any, Any], name: str) -> ExtractionConfig:
    """Return the configuration of feature extraction in a map's file. Raises: UsageError: door_width is invalid."""
    if content.get("door_width") is None:
        return ExtractionConfig()
    least_m, most_m = numbers(content["door_width"], f"{name}: door_width", 2)
    return ExtractionConfig(door_min_m=least_m, door_max_m=most_m)


def _code(value: Any, where: str) -> WallCode:
    if not isinstance(value, dict) or not isinstance(value.get("text"), str):
        raise UsageError(f"{where} has no text", "use {text: ..., at: [x, y, z], facing: radians}")
    x, y, z = numbers(value.get("at"), f"{where}: at", 3)
    (facing,) = numbers([value.get("facing")], f"{where}: facing", 1)
    (size,) = numbers([value.get("edge", 0.12)], f"{where}: edge", 1)
    if not 0.01 <= size <= 2:
        raise UsageError(f"{where}: an edge of {size} m", "use 0.01 to 2")
    length = len(value["text"].encode(errors="replace"))
    if not 0 < length <= TEXT_MAX_BYTES:
        raise UsageError(f"{where}: a text of {length} bytes", f"use 1 to {TEXT_MAX_BYTES}, which cameras can read")
    return WallCode(value["text"], x, y, z, facing, size)


@dataclass(frozen=True, slots=True, kw_only=True)
class Beacon:
    """A radio beacon (Bluetooth, UWB), received within a range, also through walls. Source: Encoded graphs §IV-A."""

    reading: str
    x_m: float = within(0.0, -LARGEST, LARGEST)  # map frame
    y_m: float = within(0.0, -LARGEST, LARGEST)
    range_m: float = within(3.0, 0.1, 1000.0)
    noise_m: float = within(0.1, 0.0, 100.0)  # standard deviation of the measured distance

    stopped_by_walls = False

    def __post_init__(self) -> None:
        check_limits(self)

    def is_read(self, away_m: float, chance: float) -> bool:
        """Return True if the beacon is received at a distance; `chance` is a standard normal number."""
        return away_m + self.noise_m * chance <= self.range_m


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """Source of a signal that robots detect above a level; it has half its peak at `half_m`, and walls block it."""

    reading: str
    x_m: float = within(0.0, -LARGEST, LARGEST)  # map frame
    y_m: float = within(0.0, -LARGEST, LARGEST)
    peak: float = within(100.0, 0.0, LARGEST)  # in any unit, the same as of level and noise
    half_m: float = within(1.0, 0.01, 1000.0)
    over: float = within(50.0, 0.0, LARGEST)  # the level
    noise: float = within(1.0, 0.0, LARGEST)  # standard deviation of the measurement

    stopped_by_walls = True

    def __post_init__(self) -> None:
        check_limits(self)
        if self.over >= self.peak:
            raise UsageError(f"over is {self.over:g}, peak is {self.peak:g}", "use a value of over below the peak")

    def is_read(self, away_m: float, chance: float) -> bool:
        """Return True if the signal is detected at a distance; `chance` is a standard normal number."""
        halves = away_m / self.half_m
        return self.peak / (1.0 + halves * halves) + self.noise * chance >= self.over


Source = Beacon | Quantity
# Fields by their keys in the file.
_BEACON = {"id": "reading", "range": "range_m", "noise": "noise_m"}
_QUANTITY = {"reading": "reading", "peak": "peak", "half": "half_m", "over": "over", "noise": "noise"}


def sources_of(content: Mapping[Any, Any], name: str) -> tuple[Source, ...]:
    """Return the beacons and quantities in a map's file.

    Raises: UsageError: one of them is invalid; the message has the place.
    """
    sources: list[Source] = []
    kinds: tuple[tuple[str, Callable[..., Source], Mapping[str, str]], ...] = (
        ("beacons", Beacon, _BEACON),
        ("quantities", Quantity, _QUANTITY),
    )
    for key, kind, fields in kinds:
        listed = content.get(key) or []
        if not isinstance(listed, list) or len(listed) > SOURCES_MAX:
            raise UsageError(
                f"{name}: {key} is not a list, or too long",
                f"use at most {SOURCES_MAX}; phalanx docs guides/maps shows them",
            )
        sources += (_source(kind, fields, each, f"{name}: {key}, number {i}") for i, each in enumerate(listed, 1))
    return tuple(sources)


def _source(kind: Callable[..., Source], known: Mapping[str, str], content: Any, where: str) -> Source:
    given = dict(content) if isinstance(content, dict) else {}
    place = given.pop("at", None)
    values = {known.get(key, ""): value for key, value in given.items()}
    reading = values.pop("reading", None)
    is_reading = isinstance(reading, str) and 0 < len(reading.encode(errors="replace")) <= READING_MAX_BYTES
    if "" in values or not is_reading or not isinstance(place, list) or len(place) != 2:
        raise UsageError(f"{where}, is {content!r:.80}", f"use at: [x, y], {', '.join(known)}")
    try:
        return kind(reading=reading, x_m=place[0], y_m=place[1], **values)
    except UsageError as error:
        raise UsageError(f"{where}: {error}", error.hint) from error
