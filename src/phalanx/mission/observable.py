"""Define observables and their canonical bytes, the only thing that is ever hashed.

A node of a mission is a conjunction of observables. Their bytes are integers with tags and lengths, never formatted
floats or bare concatenations: "1" + "12" would equal "11" + "2". All measured values are quantised into cells. The
compiler chooses the offset of the cells so that the encoded value lies in the middle of its cell.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.config.mission import CodingConfig
from phalanx.errors import UsageError

from .angles import TWO_PI, wrap_rad
from .walk.cells import numbers_of

LANDMARK_TYPES = ("doorway", "corner_convex", "concave_left", "concave_right", "room", "qr")
# A doorway looks the same from both sides.
HALF_TURN_TYPES = ("doorway",)
_KINDS = {name: kind for kind, name in enumerate(LANDMARK_TYPES)}
MM_PER_M = 1000
OFFSET_RAD = 1e-4  # unit of an orientation's offset
OFFSET_M2 = 1e-2  # unit of an area's offset
APART_M, APART_MAX = 0.1, 255  # unit of Offset.apart, and its value for "no look-alike"
VALUE_MAX = 1e6
LONGEST_S = 1e12  # beyond any plausible clock
# Distance to the next look-alike that is assumed if it is unknown.
DEFAULT_APART_M = 3.0
# Default covariance of a pose: 12 cm and 2.5 degrees, less than `place_m`, or no robot without its own could start.
DEFAULT_COVARIANCE = (0.0144, 0.0, 0.0, 0.0144, 0.0, 0.0019)


@dataclass(frozen=True, slots=True)
class Landmark:
    """A fixed landmark of a building.

    Args:
        type: one of LANDMARK_TYPES. "corner_convex" is the corner of a room. "concave" is the paper's word for a reflex
            corner (jambs, pillars, wall ends), with one landmark for each visible wall: "concave_left" is the left end
            of the wall as seen by the robot, "concave_right" the right end.
        x_m, y_m: map frame; of an observed landmark, computed from the robot's estimated pose.
        orientation_rad: map frame, or None; that of a doorway counts modulo half a turn.
        area_m2: area of a room's triangle, or None.
        text: text of a QR code, or None.
        apart_m: distance to the next landmark that looks the same, for landmarks of a map.
    Raises: UsageError: unknown type, or a number out of range.
    Source: Encoded graphs §IV-A, §V-B, Eq. 1-3.
    """

    type: str
    x_m: float
    y_m: float
    orientation_rad: float | None = None
    area_m2: float | None = None
    text: str | None = None
    apart_m: float = field(default=DEFAULT_APART_M, compare=False)

    def __post_init__(self) -> None:
        if self.type not in LANDMARK_TYPES:
            raise UsageError(f"there is no landmark type {self.type!r}", f"use one of {', '.join(LANDMARK_TYPES)}")
        turn, area = self.orientation_rad or 0.0, self.area_m2 or 0.0
        if not (
            abs(self.x_m) < VALUE_MAX and abs(self.y_m) < VALUE_MAX and abs(turn) < VALUE_MAX and abs(area) < VALUE_MAX
        ):
            raise UsageError(f"a {self.type} at {self.x_m}, {self.y_m}", "use metres and radians, below a million")


class ScanLandmarks(Sequence[Landmark]):
    """Landmarks of a scan as kernel arrays; `Landmark` objects are made on demand.

    Args:
        rows: (k, 5) from `rows_of`; none has a text.
    """

    def __init__(self, rows: NDArray[np.float64]) -> None:
        self.rows = rows

    @cached_property
    def landmarks(self) -> tuple[Landmark, ...]:
        """Return all landmarks, the same objects each time."""
        return tuple(
            Landmark(LANDMARK_TYPES[int(kind)], x, y, number_or_none(turn), number_or_none(area))
            for kind, x, y, turn, area in self.rows.tolist()
        )

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Landmark]:
        return iter(self.landmarks)

    def __getitem__(self, i: Any) -> Any:
        return self.landmarks[i]


@dataclass(frozen=True, slots=True)
class Position:
    """The robot is at a position, map frame. Raises: UsageError: a number out of range."""

    x_m: float
    y_m: float

    def __post_init__(self) -> None:
        if not (abs(self.x_m) < VALUE_MAX and abs(self.y_m) < VALUE_MAX):
            raise UsageError(f"a position at {self.x_m}, {self.y_m}", "use metres, below a million")


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor reads exactly these bytes: a text, the name of a colour."""

    value: bytes


@dataclass(frozen=True, slots=True)
class Action:
    """An action that the robot can perform."""

    name: str  # name in the robot's list of actions
    # Sorted by name; numbers are rounded to thousandths when they are encoded
    args: tuple[tuple[str, float | str], ...] = ()


@dataclass(frozen=True, slots=True)
class Time:
    """The mission's clock is in the time window of `t_s`; the file has its length. Raises: UsageError."""

    t_s: float

    def __post_init__(self) -> None:
        if not 0 <= self.t_s < LONGEST_S:
            raise UsageError(f"a time of {self.t_s} s", "use seconds on the mission's clock, 0 or later")


@dataclass(frozen=True, slots=True)
class Message:
    """An encoded message was received, from a controller or another robot."""

    value: bytes


@dataclass(frozen=True, slots=True)
class Direction:
    """A sector of the full turn, counted counter-clockwise from the map's x axis."""

    sector: int
    of: int


@dataclass(frozen=True, slots=True)
class Previous:
    """The hash of the previous node, for chained nodes."""

    secret: bytes


Observable = Landmark | Position | Sensor | Action | Direction | Time | Message | Previous


# Upper triangle of a (3, 3) covariance, row by row.
Covariance = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Experience:
    """All observables that a robot has at one moment.

    Args:
        t_s: time on the mission's clock, monotonic.
        x_m, y_m, heading_rad: estimated pose of the robot, map frame: the last fix plus odometry.
        travelled_m: path length by odometry since the start.
        landmarks: landmarks in sight, transformed into the map frame with the estimated pose.
        sensors: other sensor readings, as bytes.
        actions: actions that the robot can perform or has just performed; the search tries all.
        messages: encoded messages received since the last experience.
        blocked: the instructed way is blocked.
        spread: upper triangle of the covariance of x, y and heading, row by row.
    """

    t_s: float
    x_m: float
    y_m: float
    heading_rad: float
    travelled_m: float = 0.0
    landmarks: Sequence[Landmark] = ()
    sensors: tuple[bytes, ...] = ()
    actions: tuple[Action, ...] = ()
    messages: tuple[bytes, ...] = ()
    blocked: bool = False
    spread: Covariance = DEFAULT_COVARIANCE


class Offset(NamedTuple):
    """Offset of the cells for one alias of a node, in stored integers.

    x and y are in mm, the orientation in 1e-4 rad, the area in 0.01 m2, each within ± half a cell. `apart` is the
    distance to the next landmark that looks the same, in 0.1 m rounded down; APART_MAX also means that there is none.
    """

    x: int = 0
    y: int = 0
    orientation: int = 0
    area: int = 0
    apart: int = APART_MAX

    @property
    def natural(self) -> tuple[float, float, float, float]:
        """Return the offset in metres, metres, radians, square metres."""
        return self.x / MM_PER_M, self.y / MM_PER_M, self.orientation * OFFSET_RAD, self.area * OFFSET_M2

    @property
    def apart_m(self) -> float:
        """Return the distance in m within which nothing looks the same; infinite for APART_MAX."""
        return math.inf if self.apart == APART_MAX else self.apart * APART_M


class Cell(NamedTuple):
    """A quantised measurement; bin is -1 without an orientation, area is -1 without an area."""

    x: int
    y: int
    bin: int = -1
    area: int = -1


def cell_of(coding: CodingConfig, offset: Offset, x_m: float, y_m: float, thing: Landmark | None = None) -> Cell:
    """Return the cell of a position, with the bins of the orientation and area of `thing` if it has them.

    Source: Encoded graphs §IV-A; docs/spec/mission.md (round((x - offset) / delta)).
    """
    turn, area, bins = math.nan, math.nan, 1
    if thing is not None:
        turn, area = number_or_nan(thing.orientation_rad), number_or_nan(thing.area_m2)
        bins = bins_of(coding, thing.type)
    return Cell(*numbers_of(float(x_m), float(y_m), turn, area, offset.natural, steps_of(coding), bins))


def rows_of(landmarks: Sequence[Landmark]) -> NDArray[np.float64]:
    """Return landmarks as a kernel array: (k, 5) kind, x, y, orientation and area, NaN for None."""
    if isinstance(landmarks, ScanLandmarks):
        return landmarks.rows
    rows = [(_KINDS[it.type], it.x_m, it.y_m, it.orientation_rad, it.area_m2) for it in landmarks]
    return np.array(rows, np.float64).reshape(-1, 5)


def number_or_nan(value: float | None) -> float:
    """Return a float for kernels, with NaN for None."""
    return math.nan if value is None else float(value)


def number_or_none(value: float) -> float | None:
    """Return None for NaN, other values unchanged."""
    return None if math.isnan(value) else value


def steps_of(coding: CodingConfig) -> tuple[float, float, float, float]:
    """Return the size of a cell: metres, metres, radians, square metres."""
    delta_m = coding.delta_mm / MM_PER_M
    return delta_m, delta_m, coding.bin_rad, coding.area_m2


def bins_of(coding: CodingConfig, landmark_type: str) -> int:
    """Return the number of orientation bins: half as many for landmarks whose front and back look alike."""
    return coding.heading_bins // 2 if landmark_type in HALF_TURN_TYPES else coding.heading_bins


def offset_of(coding: CodingConfig, thing: Landmark | Position) -> Offset:
    """Return the offset that puts `thing` in the middle of its cell, to the mm, 1e-4 rad and 0.01 m2."""

    def rest(value: float, step: float, unit: float) -> int:
        return round((value - round(value / step) * step) / unit)

    delta_m = coding.delta_mm / MM_PER_M
    x, y = rest(thing.x_m, delta_m, 1 / MM_PER_M), rest(thing.y_m, delta_m, 1 / MM_PER_M)
    if isinstance(thing, Position):
        return Offset(x, y)
    return Offset(
        x,
        y,
        0 if thing.orientation_rad is None else rest(thing.orientation_rad, coding.bin_rad, OFFSET_RAD),
        0 if thing.area_m2 is None else rest(thing.area_m2, coding.area_m2, OFFSET_M2),
        math.floor(min(thing.apart_m / APART_M + 1e-9, APART_MAX)),
    )


def middle_of(coding: CodingConfig, offset: Offset, cell: Cell) -> tuple[float, float, float | None]:
    """Return (x_m, y_m, orientation_rad or None) of the middle of a cell: the true place of a match."""
    x_m = (cell.x * coding.delta_mm + offset.x) / MM_PER_M
    y_m = (cell.y * coding.delta_mm + offset.y) / MM_PER_M
    if cell.bin < 0:
        return x_m, y_m, None
    return x_m, y_m, wrap_rad(cell.bin * coding.bin_rad + offset.orientation * OFFSET_RAD)


def sector_of(direction_rad: float, sectors: int) -> int:
    """Return the sector of a direction; sector 0 is centred on the map's x axis."""
    return round(direction_rad / TWO_PI * sectors) % sectors


def window_of(coding: CodingConfig, t_s: float) -> int:
    """Return the number of the time window of `t_s`."""
    return math.floor(t_s * MM_PER_M / coding.window_ms)
