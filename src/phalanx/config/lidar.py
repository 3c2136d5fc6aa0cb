"""Parameters of the lidar, and of what is made of its scans."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

from phalanx.errors import UsageError


def _check(config: object, limits: dict[str, tuple[float, float]]) -> None:
    for name, (low, high) in limits.items():
        value = getattr(config, name)
        if not low <= value <= high:
            raise UsageError(f"{name} is {value}", f"{low:g} to {high:g}")


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarConfig:
    """A 2-D lidar; the paper's field of view, beams and rate.

    Args:
        beams: in one sweep.
        fov_rad: the field of view, centred on forward.
        rate_hz: sweeps in a second.
        range_min_m, range_max_m: nearer it says nothing, farther it misses.
        noise_m: standard deviation of a range.
        drop_out: share of beams that say nothing.
    Raises: UsageError: a value is out of range.
    Source: Encoded graphs §V-A (270 degrees, 1080 samples, 10 Hz); the rest: data sheet of a Hokuyo UTM-30LX.
    """

    beams: int = 1080
    fov_rad: float = 1.5 * math.pi
    rate_hz: float = 10.0
    range_min_m: float = 0.1
    range_max_m: float = 30.0
    noise_m: float = 0.01
    drop_out: float = 0.002

    def __post_init__(self) -> None:
        _check(
            self,
            {
                "beams": (2, 8192),
                "fov_rad": (0.01, 2 * math.pi),
                "rate_hz": (0.1, 100),
                "range_min_m": (0, 10),
                "range_max_m": (self.range_min_m + 0.1, 60),
                "noise_m": (0, 1),
                "drop_out": (0, 1),
            },
        )

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
    """What counts as a wall, a corner and a doorway in a scan.

    Args:
        door_min_m, door_max_m: jambs are so far apart; real doors are 0.8 to 1.0 m.
        door_bend_rad: the walls on both sides of a doorway run along its line, within so much.
        door_depth_m: thickest wall whose middle is found.
        door_clear_m: nothing is hit so far behind a doorway; less is an alcove, or a door that is shut.
        split_m: points farther from a wall's chord split it in two.
        line_m: a point belongs to a wall's line within so much.
        wall_min_m: shortest wall.
        wall_min_points: fewest points of one.
        corner_min_rad: walls that meet at less are one bent wall.
        corner_gap_m: both walls of a corner reach so near to it.
        jump_m: smallest step of the range from one beam to the next that is an edge, beside what a wall seen at
            `graze_rad` steps.
        graze_rad: an edge of a wall seen at less is not trusted.
        edge_error_m: nor is one that lies between two beams so far apart along the wall.
        feature_range_m: what is farther from the robot is not used.
        room_min_m2: smallest triangle of three corners.
    Raises: UsageError: a value is out of range.
    Source: Encoded graphs §V-A (1.2 m, 2.5 m); the rest: measured, docs/adr/0019.
    """

    door_min_m: float = 1.2
    door_max_m: float = 2.5
    door_bend_rad: float = math.radians(15)
    door_depth_m: float = 0.5
    door_clear_m: float = 0.5
    split_m: float = 0.05
    line_m: float = 0.04
    wall_min_m: float = 0.35
    wall_min_points: int = 6
    corner_min_rad: float = math.radians(30)
    corner_gap_m: float = 0.15
    jump_m: float = 0.06
    graze_rad: float = math.radians(7)
    edge_error_m: float = 0.15
    feature_range_m: float = 30.0
    room_min_m2: float = 1.0

    def __post_init__(self) -> None:
        limits: dict[str, tuple[float, float]] = {
            "door_min_m": (0.2, 10),
            "door_max_m": (self.door_min_m, 10),
            "wall_min_points": (3, 1000),
            "graze_rad": (0.01, 0.7),
            "feature_range_m": (0.1, 60),
            "room_min_m2": (0.01, 1e4),
        }
        for field in fields(self):
            limits.setdefault(field.name, (1e-3, 1.5))
        _check(self, limits)

    def for_noise(self, noise_m: float) -> ExtractionConfig:
        """These settings, wide enough for a sensor whose ranges deviate by so much; as they are up to 1 cm."""
        return replace(
            self,
            split_m=max(self.split_m, 4.5 * noise_m),
            line_m=max(self.line_m, 3.5 * noise_m),
            jump_m=max(self.jump_m, 5.0 * noise_m),
        )
