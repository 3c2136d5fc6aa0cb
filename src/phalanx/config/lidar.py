"""Parameters of the lidar, and of the extraction of landmarks from its scans."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from phalanx.errors import UsageError

from .parameter import check_limits, check_within, within

EXACT_M = 0.01  # range noise up to which the accuracy of landmarks was measured
STRAIGHT_M = 0.015  # range noise up to which the shortest walls are straight enough
LIKE = "like 270 or 270,1080,30,0.01: up to 360 degrees, beams, metres of range and of noise"


def _turn(word: str) -> float:
    if not 1 <= float(word) <= 360:
        raise ValueError(word)
    return math.radians(float(word))


# Values of a lidar on a command line, in this order.
PARSED: dict[str, Callable[[str], Any]] = {
    "fov_rad": _turn,
    "beams": int,
    "range_max_m": float,
    "noise_m": float,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarConfig:
    """A 2-D lidar; field of view and beams are the paper's by default.

    Raises: UsageError: a value is out of range.
    Source: Encoded graphs §V-A (270 degrees, 1080 samples); the rest: data sheet of a Hokuyo UTM-30LX.
    """

    beams: int = within(1080, 2, 8192)  # in one sweep
    fov_rad: float = within(1.5 * math.pi, 0.01, 2 * math.pi)  # the field of view, centred on forward
    range_min_m: float = within(0.1, 0, 10)  # no return from nearer objects
    range_max_m: float = within(30.0, 0.1, 60)  # no return from farther objects
    noise_m: float = within(0.01, 0, 1)  # standard deviation of a range
    drop_out: float = within(0.002, 0, 1)  # share of beams without a return

    def __post_init__(self) -> None:
        check_limits(self)
        check_within("range_max_m", self.range_max_m, self.range_min_m + 0.1, 60)

    @classmethod
    def parse(cls, text: str) -> LidarConfig:
        """Parse a command line's DEGREES[,BEAMS[,RANGE_M[,NOISE_M]]]; the other parameters have their defaults.

        Raises: UsageError: the text has another form, or a value is out of range.
        """
        words = text.split(",")
        try:
            values = {name: PARSED[name](word) for name, word in zip(list(PARSED)[: len(words)], words, strict=True)}
        except ValueError as error:  # also of too many words
            raise UsageError(f"invalid lidar {text!r}", LIKE) from error
        return cls(**values)

    @property
    def angle_min_rad(self) -> float:
        """Return the bearing of the first beam."""
        return -0.5 * self.fov_rad

    @property
    def angle_increment_rad(self) -> float:
        """Return the angle between adjacent beams: each has an equal share of the field of view."""
        return self.fov_rad / self.beams


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtractionConfig:
    """Thresholds that decide what counts as a wall, a corner and a doorway in a scan.

    Raises: UsageError: a value is out of range.
    Source: Encoded graphs §V-A (1.2 m, 2.5 m); the rest: measured, docs/adr/0019.
    """

    door_min_m: float = within(1.2, 0.2, 10)  # smallest distance of jambs; real doors are 0.8 to 1.0 m
    door_max_m: float = within(2.5, 0.2, 10)  # largest distance of jambs
    door_bend_rad: float = within(math.radians(15), 1e-3, 1.5)  # largest angle of walls to the line of their doorway
    door_depth_m: float = within(0.5, 1e-3, 1.5)  # thickest wall in whose middle a doorway is placed
    # Free depth behind a doorway; with less it is an alcove or a closed door.
    door_clear_m: float = within(0.5, 1e-3, 1.5)
    split_m: float = within(0.05, 1e-3, 1.5)  # a point farther from a wall's chord splits the wall in two
    line_m: float = within(0.04, 1e-3, 1.5)  # largest distance of a point from its wall's line
    wall_min_m: float = within(0.35, 1e-3, 1.5)  # shortest wall
    wall_min_points: int = within(6, 3, 1000)  # fewest points of a wall
    corner_min_rad: float = within(math.radians(30), 1e-3, 1.5)  # walls at a smaller angle are one bent wall
    corner_gap_m: float = within(0.15, 1e-3, 1.5)  # largest gap between a corner and the end of its walls
    # Smallest range step between adjacent beams that is an edge, on top of the step of a wall at `graze_rad`.
    jump_m: float = within(0.06, 1e-3, 1.5)
    graze_rad: float = within(math.radians(7), 0.01, 0.7)  # edges of walls at a smaller grazing angle are ignored
    edge_error_m: float = within(0.15, 1e-3, 1.5)  # edges between beams farther apart on the wall are ignored
    feature_range_m: float = within(30.0, 0.1, 60)  # farther features are ignored
    room_min_m2: float = within(1.0, 0.01, 1e4)  # smallest triangle of three corners

    def __post_init__(self) -> None:
        check_limits(self)
        check_within("door_max_m", self.door_max_m, self.door_min_m, 10)

    def for_noise(self, noise_m: float) -> ExtractionConfig:
        """Return thresholds for a sensor with this range noise; up to 1 cm they are unchanged.

        The error of the direction of a wall with n points over l metres is sqrt(12 / n) / l times the noise. Longer
        walls with more points keep it at the value that robots assume (`MissionConfig.sight_deg`).
        """
        longer = max(1.0, noise_m / STRAIGHT_M) ** (1 / 2)
        return replace(
            self,
            wall_min_m=max(self.wall_min_m, min(1.5, longer * self.wall_min_m)),
            wall_min_points=math.ceil(longer * self.wall_min_points),
            split_m=max(self.split_m, 4.5 * noise_m),
            line_m=max(self.line_m, 3.5 * noise_m),
            jump_m=max(self.jump_m, 5.0 * noise_m),
        )
