"""Scans of a 2-D lidar, in ROS's conventions.

Metres and radians, x forward, counter-clockwise. A miss (nothing within `range_max_m`) is +inf; a beam without a
reading (dropped, too close, broken) is NaN. The difference matters, since a miss shows that the space is free.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import BOOLx1, F64x1, I64x1
from phalanx.config.lidar import ExtractionConfig, LidarConfig
from phalanx.config.parameter import made_once
from phalanx.errors import UsageError
from phalanx.kernel import kernel
from phalanx.mission.angles import TWO_PI, sin_cos

BEAMS_MAX = 8192
FARTHEST_M = 65_534


@kernel
def clip_ranges(ranges: F64x1, least_m: float, most_m: float) -> None:
    """Replace ranges above the maximum by +inf and ranges below the minimum by NaN, in place."""
    for k in range(len(ranges)):
        if ranges[k] > most_m:
            ranges[k] = np.inf
        elif ranges[k] < least_m:
            ranges[k] = np.nan


@dataclass(frozen=True, slots=True, eq=False)
class LaserScan:
    """A scan, checked on creation.

    Raises: UsageError: a value is out of range, except the ranges: invalid ranges become NaN.
    Source: sensor_msgs/LaserScan, REP 117.
    """

    ranges_m: NDArray[np.float64]  # (n,), n of 2..8192; finite and within the limits, +inf or NaN
    angle_min_rad: float  # bearing of the first beam, robot frame
    angle_increment_rad: float  # angle between two beams; positive, at most one turn in all
    range_min_m: float = 0.02  # limits of valid ranges
    range_max_m: float = 30.0

    def __post_init__(self) -> None:
        ranges = np.array(self.ranges_m, np.float64)
        if ranges.ndim != 1 or not 2 <= len(ranges) <= BEAMS_MAX:
            raise UsageError(f"a scan of shape {ranges.shape}", f"use 2 to {BEAMS_MAX} beams")
        turn = self.angle_increment_rad * len(ranges)
        if not (self.angle_increment_rad > 0 and turn <= TWO_PI * 1.01 and abs(self.angle_min_rad) <= TWO_PI):
            raise UsageError(
                f"{len(ranges)} beams from {self.angle_min_rad} rad in steps of {self.angle_increment_rad} rad",
                "use counter-clockwise beams, at most one turn",
            )
        if not 0 <= self.range_min_m < self.range_max_m <= FARTHEST_M:
            raise UsageError(
                f"scan with ranges from {self.range_min_m} to {self.range_max_m} m",
                "use 0 <= range_min_m < range_max_m",
            )
        clip_ranges(ranges, float(self.range_min_m), float(self.range_max_m))
        ranges.setflags(write=False)
        object.__setattr__(self, "ranges_m", ranges)

    @classmethod
    def of(cls, ranges_m: NDArray[np.float64], lidar: LidarConfig) -> Self:
        """Return a scan without checks, for ranges that are clipped already and a checked configuration.

        The array becomes read-only.
        """
        scan, put = object.__new__(cls), object.__setattr__
        ranges_m.setflags(write=False)
        put(scan, "ranges_m", ranges_m)
        put(scan, "angle_min_rad", lidar.angle_min_rad)
        put(scan, "angle_increment_rad", lidar.angle_increment_rad)
        put(scan, "range_min_m", lidar.range_min_m)
        put(scan, "range_max_m", lidar.range_max_m)
        return scan

    @property
    def beams(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (cosines, sines) of the beams' bearings, each (n,)."""
        return beam_table(self.angle_min_rad, self.angle_increment_rad, len(self.ranges_m))

    @property
    def full_turn(self) -> bool:
        """Return True if the beams cover a full turn, so that the last is next to the first."""
        return self.angle_increment_rad * (len(self.ranges_m) + 0.5) > TWO_PI


@lru_cache(maxsize=64)
def beam_table(first_rad: float, step_rad: float, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (cosines, sines) of the bearings of `count` beams."""
    cosines, sines = np.empty(count), np.empty(count)
    for i in range(count):
        sines[i], cosines[i] = sin_cos(first_rad + i * step_rad)
    cosines.setflags(write=False)
    sines.setflags(write=False)
    return cosines, sines


class View(NamedTuple):
    """A scan and its hit points, for kernels."""

    ranges: F64x1  # (b,), range of each beam; NaN without a reading, infinite for a miss
    cosines: F64x1  # (b,), of the bearings
    sines: F64x1  # likewise
    full_turn: bool  # the last beam is next to the first
    range_max_m: float  # maximum range
    x: F64x1  # (p,), hit points in the order of the beams
    y: F64x1  # likewise
    beam: I64x1  # (p,), beam of each point
    new_run: BOOLx1  # (p,), True if the point is on another surface than the point before


class Limits(NamedTuple):
    """`ExtractionConfig` for kernels: lengths and areas, and sines, cosines and slopes of the angles."""

    split_m: float
    line_m: float
    wall_min_m: float
    wall_min_points: float
    corner_sine: float
    corner_gap_m: float
    jump_m: float
    graze_slope: float
    graze_sine: float
    edge_error_m: float
    door_min_m: float
    door_max_m: float
    bend_cosine: float
    door_depth_m: float
    door_clear_m: float
    room_min_m2: float


@made_once
def limits_of(config: ExtractionConfig) -> Limits:
    """Return the limits of a configuration."""
    corner_sine, _ = sin_cos(config.corner_min_rad)
    graze_sine, graze_cosine = sin_cos(config.graze_rad)
    _, bend_cosine = sin_cos(config.door_bend_rad)
    return Limits(
        corner_sine=corner_sine,
        graze_slope=graze_cosine / graze_sine,
        graze_sine=graze_sine,
        bend_cosine=bend_cosine,
        **{name: float(getattr(config, name)) for name in Limits._fields if hasattr(config, name)},
    )
