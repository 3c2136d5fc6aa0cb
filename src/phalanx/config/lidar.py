"""Parameters of the lidar, and of what is made of its scans."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from phalanx.errors import UsageError

from .parameter import check_limits, check_within, within

EXACT_M = 0.01  # the noise of a range up to which all that is made of scans is measured
STRAIGHT_M = 0.015  # and the one up to which the shortest walls are straight enough
LIKE = "like 270 or 270,1080,30,0.01: up to 360 degrees, beams, metres of range and of noise"


def _turn(word: str) -> float:
    if not 1 <= float(word) <= 360:
        raise ValueError(word)
    return math.radians(float(word))


# What a command line says of a lidar, in this order.
PARSED: dict[str, Callable[[str], Any]] = {
    "fov_rad": _turn,
    "beams": int,
    "range_max_m": float,
    "noise_m": float,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarConfig:
    """A 2-D lidar; the paper's field of view and beams.

    Raises: UsageError: a value is out of range.
    Source: Encoded graphs §V-A (270 degrees, 1080 samples); the rest: data sheet of a Hokuyo UTM-30LX.
    """

    beams: int = within(1080, 2, 8192)  # in one sweep
    fov_rad: float = within(1.5 * math.pi, 0.01, 2 * math.pi)  # the field of view, centred on forward
    range_min_m: float = within(0.1, 0, 10)  # nearer it says nothing
    range_max_m: float = within(30.0, 0.1, 60)  # farther it misses
    noise_m: float = within(0.01, 0, 1)  # standard deviation of a range
    drop_out: float = within(0.002, 0, 1)  # share of beams that say nothing

    def __post_init__(self) -> None:
        check_limits(self)
        check_within("range_max_m", self.range_max_m, self.range_min_m + 0.1, 60)

    @classmethod
    def parse(cls, text: str) -> LidarConfig:
        """The lidar that a command line asks for: DEGREES[,BEAMS[,RANGE_M[,NOISE_M]]]; of the rest the default.

        Raises: UsageError: it is not written so, or no lidar is like that.
        """
        words = text.split(",")
        try:
            said = {name: PARSED[name](word) for name, word in zip(list(PARSED)[: len(words)], words, strict=True)}
        except ValueError as error:  # also of too many words
            raise UsageError(f"lidar {text!r}", LIKE) from error
        return cls(**said)

    @property
    def angle_min_rad(self) -> float:
        """Bearing of the first beam."""
        return -0.5 * self.fov_rad

    @property
    def angle_increment_rad(self) -> float:
        """From one beam to the next: each beam has an equal share of the field of view."""
        return self.fov_rad / self.beams


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtractionConfig:
    """Thresholds that decide what counts as a wall, a corner and a doorway in a scan.

    Raises: UsageError: a value is out of range.
    Source: Encoded graphs §V-A (1.2 m, 2.5 m); the rest: measured, docs/adr/0019.
    """

    door_min_m: float = within(1.2, 0.2, 10)  # jambs are so far apart; real doors are 0.8 to 1.0 m
    door_max_m: float = within(2.5, 0.2, 10)
    door_bend_rad: float = within(math.radians(15), 1e-3, 1.5)  # of the walls beside a doorway from its line, at most
    door_depth_m: float = within(0.5, 1e-3, 1.5)  # thickest wall whose middle is found
    # Nothing is hit so far behind a doorway; less is an alcove, or a door that is shut.
    door_clear_m: float = within(0.5, 1e-3, 1.5)
    split_m: float = within(0.05, 1e-3, 1.5)  # points farther from a wall's chord split it in two
    line_m: float = within(0.04, 1e-3, 1.5)  # a point belongs to a wall's line within so much
    wall_min_m: float = within(0.35, 1e-3, 1.5)  # shortest wall
    wall_min_points: int = within(6, 3, 1000)  # fewest points of one
    corner_min_rad: float = within(math.radians(30), 1e-3, 1.5)  # walls that meet at less are one bent wall
    corner_gap_m: float = within(0.15, 1e-3, 1.5)  # both walls of a corner reach so near to it
    # Smallest step of the range from one beam to the next that is an edge, beside what a wall at `graze_rad` steps.
    jump_m: float = within(0.06, 1e-3, 1.5)
    graze_rad: float = within(math.radians(7), 0.01, 0.7)  # an edge of a wall seen at less is not trusted
    edge_error_m: float = within(0.15, 1e-3, 1.5)  # nor one between two beams so far apart along the wall
    feature_range_m: float = within(30.0, 0.1, 60)  # what is farther from the robot is not used
    room_min_m2: float = within(1.0, 0.01, 1e4)  # smallest triangle of three corners

    def __post_init__(self) -> None:
        check_limits(self)
        check_within("door_max_m", self.door_max_m, self.door_min_m, 10)

    def for_noise(self, noise_m: float) -> ExtractionConfig:
        """These settings, wide enough for a sensor whose ranges deviate by so much; as they are up to 1 cm.

        The direction of a wall of n points over l metres deviates by sqrt(12 / n) / l of that: longer walls, and of
        more points, keep it at what robots believe of it (`MissionConfig.sight_deg`).
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
