"""Define observables and their canonical bytes, the only thing that is ever hashed.

A node of a mission is a conjunction of observables. Their bytes are integers behind tags and lengths, never formatted
floats and never bare concatenation: "1" + "12" would be "11" + "2". All values that a robot measures are put into cells
counted from an offset that the compiler chose, so that what was encoded lies in the middle of its cell.
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
APART_M, APART_MAX = 0.1, 255  # unit, and what stands for "nothing near looks the same"
VALUE_MAX = 1e6
LONGEST_S = 1e12  # no clock of ours gets there
# What nobody has told of a landmark: who does not know the building must expect its like so near.
UNTOLD_M = 3.0
# The doubt of who says nothing of it: 12 cm and 2.5 degrees. Surer than `place_m`, or such a robot would begin nowhere.
UNSURE = (0.0144, 0.0, 0.0, 0.0144, 0.0, 0.0019)


@dataclass(frozen=True, slots=True)
class Landmark:
    """Something that stays where it is.

    Args:
        type: one of LANDMARK_TYPES; "concave" is the paper's word for a reflex corner (jambs, pillars, wall ends), told
            once for each wall of it that is seen: at its left end, or at its right one, for who stands before it;
            "corner_convex" is the corner of a room.
        x_m, y_m: map frame; when observed, as the robot's estimated pose puts it.
        orientation_rad: map frame, or None; a doorway's counts modulo half a turn.
        area_m2: of a room's triangle, or None.
        text: of a QR code, or None.
        apart_m: from here to the next thing that looks the same, of one that is drawn in a map.
    Raises: UsageError: no such type, or a number that is none.
    Source: Encoded graphs §IV-A, §V-B, Eq. 1-3.
    """

    type: str
    x_m: float
    y_m: float
    orientation_rad: float | None = None
    area_m2: float | None = None
    text: str | None = None
    apart_m: float = field(default=UNTOLD_M, compare=False)

    def __post_init__(self) -> None:
        if self.type not in LANDMARK_TYPES:
            raise UsageError(f"there is no landmark type {self.type!r}", f"one of {', '.join(LANDMARK_TYPES)}")
        turn, area = self.orientation_rad or 0.0, self.area_m2 or 0.0
        if not (
            abs(self.x_m) < VALUE_MAX and abs(self.y_m) < VALUE_MAX and abs(turn) < VALUE_MAX and abs(area) < VALUE_MAX
        ):
            raise UsageError(f"a {self.type} at {self.x_m}, {self.y_m}", "metres and radians, below a million")


class InSight(Sequence[Landmark]):
    """Landmarks of a scan as kernel arrays; objects are made on demand.

    Args:
        rows: (k, 5) as `rows_of` has them; none has a text.
    """

    def __init__(self, rows: NDArray[np.float64]) -> None:
        self.rows = rows

    @cached_property
    def told(self) -> tuple[Landmark, ...]:
        """All of them; the same objects each time."""
        return tuple(
            Landmark(LANDMARK_TYPES[int(kind)], x, y, number_or_none(turn), number_or_none(area))
            for kind, x, y, turn, area in self.rows.tolist()
        )

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Landmark]:
        return iter(self.told)

    def __getitem__(self, i: Any) -> Any:
        return self.told[i]


@dataclass(frozen=True, slots=True)
class Position:
    """The robot itself is there; map frame. Raises: UsageError: a number that is none."""

    x_m: float
    y_m: float

    def __post_init__(self) -> None:
        if not (abs(self.x_m) < VALUE_MAX and abs(self.y_m) < VALUE_MAX):
            raise UsageError(f"a position at {self.x_m}, {self.y_m}", "metres, below a million")


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor says exactly this: a text, a colour's name, bytes."""

    value: bytes


@dataclass(frozen=True, slots=True)
class Action:
    """Something out of the robot's pool of actions."""

    name: str  # as the robot's pool has it
    # Sorted by name; numbers are rounded to thousandths when they are encoded
    args: tuple[tuple[str, float | str], ...] = ()


@dataclass(frozen=True, slots=True)
class Time:
    """The mission's clock is in the window around `t_s`; the window's length is in the file. Raises: UsageError."""

    t_s: float

    def __post_init__(self) -> None:
        if not 0 <= self.t_s < LONGEST_S:
            raise UsageError(f"a time of {self.t_s} s", "seconds on the mission's clock, 0 or later")


@dataclass(frozen=True, slots=True)
class Message:
    """An encoded message has come: from a controller or another robot."""

    value: bytes


@dataclass(frozen=True, slots=True)
class Direction:
    """A sector of the full turn, counted from the map's x axis, counter-clockwise."""

    sector: int
    of: int


@dataclass(frozen=True, slots=True)
class Previous:
    """Release of the previous node."""

    secret: bytes


Observable = Landmark | Position | Sensor | Action | Direction | Time | Message | Previous


# The upper triangle of one of three numbers, row by row.
Covariance = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Experience:
    """All that a robot can try at one moment.

    Args:
        t_s: the mission's clock; never runs backwards.
        x_m, y_m, heading_rad: the robot's estimated pose, map frame: odometry since the last fix.
        travelled_m: path length by odometry since the start.
        landmarks: seen at this moment, put into the map frame by the estimated pose.
        sensors: other readings, as bytes.
        actions: what the robot can do (or has just done): the pool that is searched.
        messages: encoded messages that came since the last experience.
        blocked: the way that the robot was told to take is blocked.
        spread: how sure the pose is: the upper triangle of the covariance of x, y and heading, row by row.
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
    spread: Covariance = UNSURE


class Offset(NamedTuple):
    """Offset of a cell's middle for one alias of one node; stored integers.

    x and y in mm within ± half a cell; the orientation in 1e-4 rad and the area in 0.01 m2, likewise. And how far it is
    to the next thing that looks the same, in 0.1 m rounded down, at most APART_MAX: that far and farther is far enough.
    """

    x: int = 0
    y: int = 0
    orientation: int = 0
    area: int = 0
    apart: int = APART_MAX

    @property
    def natural(self) -> tuple[float, float, float, float]:
        """In metres, metres, radians, square metres."""
        return self.x / MM_PER_M, self.y / MM_PER_M, self.orientation * OFFSET_RAD, self.area * OFFSET_M2

    @property
    def apart_m(self) -> float:
        """How far nothing looks the same, for certain."""
        return math.inf if self.apart == APART_MAX else self.apart * APART_M


class Cell(NamedTuple):
    """A measured thing in whole numbers. -1 where there is no orientation or no area."""

    x: int
    y: int
    bin: int = -1
    area: int = -1


def cell_of(coding: CodingConfig, offset: Offset, x_m: float, y_m: float, thing: Landmark | None = None) -> Cell:
    """The cell of a position, with the orientation's bin and the area's if `thing` has them.

    Source: Encoded graphs §IV-A; docs/spec/mission.md (round((x - offset) / delta)).
    """
    turn, area, bins = math.nan, math.nan, 1
    if thing is not None:
        turn, area = number_or_nan(thing.orientation_rad), number_or_nan(thing.area_m2)
        bins = bins_of(coding, thing.type)
    return Cell(*numbers_of(float(x_m), float(y_m), turn, area, offset.natural, steps_of(coding), bins))


def rows_of(landmarks: Sequence[Landmark]) -> NDArray[np.float64]:
    """(k, 5) kind, x, y, orientation and area of landmarks, NaN where there is none: as kernels take them."""
    if isinstance(landmarks, InSight):
        return landmarks.rows
    rows = [(_KINDS[it.type], it.x_m, it.y_m, it.orientation_rad, it.area_m2) for it in landmarks]
    return np.array(rows, np.float64).reshape(-1, 5)


def number_or_nan(value: float | None) -> float:
    """Return NaN for None, as kernels take it."""
    return math.nan if value is None else float(value)


def number_or_none(value: float) -> float | None:
    """Return None for NaN, as kernels give it."""
    return None if math.isnan(value) else value


def steps_of(coding: CodingConfig) -> tuple[float, float, float, float]:
    """From one cell to the next: metres, metres, radians, square metres."""
    delta_m = coding.delta_mm / MM_PER_M
    return delta_m, delta_m, coding.bin_rad, coding.area_m2


def bins_of(coding: CodingConfig, landmark_type: str) -> int:
    """How many bins an orientation can fall into: half as many where front and back look alike."""
    return coding.heading_bins // 2 if landmark_type in HALF_TURN_TYPES else coding.heading_bins


def offset_of(coding: CodingConfig, thing: Landmark | Position) -> Offset:
    """The offset that puts `thing` in the middle of its cell, to the mm, 1e-4 rad and 0.01 m2."""

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
    """(x_m, y_m, orientation_rad or None) of a cell's middle: what a match says about the world."""
    x_m = (cell.x * coding.delta_mm + offset.x) / MM_PER_M
    y_m = (cell.y * coding.delta_mm + offset.y) / MM_PER_M
    if cell.bin < 0:
        return x_m, y_m, None
    return x_m, y_m, wrap_rad(cell.bin * coding.bin_rad + offset.orientation * OFFSET_RAD)


def sector_of(direction_rad: float, sectors: int) -> int:
    """The sector that a direction lies in; sector 0 is centred on the map's x axis."""
    return round(direction_rad / TWO_PI * sectors) % sectors


def window_of(coding: CodingConfig, t_s: float) -> int:
    """The window of time that `t_s` lies in."""
    return math.floor(t_s * MM_PER_M / coding.window_ms)
