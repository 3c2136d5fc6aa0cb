"""A scan as the kernels that take it apart see it, and the limits by which they do: tuples, as kernels take them."""

from __future__ import annotations

from typing import NamedTuple

from phalanx.arrays import BOOLx1, F64x1, I64x1
from phalanx.config.lidar import ExtractionConfig
from phalanx.config.parameter import made_once
from phalanx.mission.angles import sin_cos


class View(NamedTuple):
    """A scan, and the points that it hits."""

    ranges: F64x1  # (b,), of each beam; NaN where it says nothing, infinite where it misses
    cosines: F64x1  # likewise
    sines: F64x1  # likewise
    full_turn: bool  # the last beam is beside the first
    range_max_m: float  # what is farther is missed
    x: F64x1  # (p,), each point and the beam that hit it; in the order of the beams
    y: F64x1  # likewise
    beam: I64x1  # likewise
    new_run: BOOLx1  # (p,), whether the surface before a point is another


class Limits(NamedTuple):
    """`ExtractionConfig` as kernels need it: its lengths and areas, and sines, cosines and slopes of its angles."""

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
    """The limits of a configuration."""
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
