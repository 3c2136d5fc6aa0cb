"""Pose fixes: what a recognised landmark says about where the robot is, and whether to believe it.

A wrong fix feeds itself, so one is refused that moves the robot further than it can have drifted, or that breaks what
other landmarks in the same scan agree on.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from phalanx.config.mission import MissionConfig
from phalanx.mission.angles import SMALL_RAD, turn_about, wrap_rad
from phalanx.mission.observable import HALF_TURN_TYPES, Experience, Landmark


@dataclass(frozen=True, slots=True)
class Fix:
    """The robot's pose, corrected."""

    x_m: float  # map frame
    y_m: float  # likewise
    heading_rad: float  # likewise
    moved_m: float  # between the estimate and the fix: the drift since the last one
    turned_rad: float

    def apply(self, seen: Experience, landmark: Landmark) -> tuple[float, float]:
        """Where a landmark of the same scan lies, seen from the corrected pose."""
        x, y = turn_about(*_point(landmark), *_point(seen), self.turned_rad)
        return x + (self.x_m - seen.x_m), y + (self.y_m - seen.y_m)


def _point(thing: Landmark | Experience) -> tuple[float, float]:
    return float(thing.x_m), float(thing.y_m)


def distance_m(seen: Experience, landmark: Landmark) -> float:
    """From the robot to a landmark."""
    dx, dy = landmark.x_m - seen.x_m, landmark.y_m - seen.y_m
    return math.sqrt(dx * dx + dy * dy)


def turn_between(truth: Landmark, observed: Landmark) -> float | None:
    """By how much the observed orientation must be turned to be the true one, or None without one."""
    if truth.orientation_rad is None or observed.orientation_rad is None:
        return None
    turn = wrap_rad(truth.orientation_rad - observed.orientation_rad)
    if truth.type in HALF_TURN_TYPES:
        turn -= math.pi * math.floor(turn / math.pi + 0.5)
    return turn


def fix_from(seen: Experience, observed: Landmark, truth: Landmark, turn_rad: float = 0.0) -> Fix:
    """The pose from which `observed` would have been seen where `truth` is.

    Args:
        observed: as the estimated pose puts it.
        turn_rad: by which the search turned the heading; the landmark's orientation, if it has one, says it better.
    """
    turn = turn_between(truth, observed)
    if turn is None or abs(turn) > SMALL_RAD:
        turn = turn_rad
    x, y = turn_about(*_point(observed), *_point(seen), turn)
    dx, dy = truth.x_m - x, truth.y_m - y
    return Fix(seen.x_m + dx, seen.y_m + dy, wrap_rad(seen.heading_rad + turn), math.sqrt(dx * dx + dy * dy), turn)


def allowed_m(config: MissionConfig, travelled_m: float) -> float:
    """How far a robot can have drifted over so many metres since its last fix."""
    return config.drift_base_m + config.drift_per_m * max(0.0, travelled_m)


def nearest(
    known: Iterable[Landmark], landmark: Landmark, x_m: float, y_m: float, within_m: float
) -> tuple[float, Landmark] | None:
    """(distance, landmark) of the known one of the same type and text that is nearest to a point, if within reach."""
    best: tuple[float, Landmark] | None = None
    for other in known:
        dx = other.x_m - x_m
        # Nearly all end here, and a robot asks thousands of times a second.
        if not -within_m <= dx <= within_m or other.type != landmark.type or other.text != landmark.text:
            continue
        dy = other.y_m - y_m
        away = math.sqrt(dx * dx + dy * dy)
        if away <= within_m and (best is None or away < best[0]):
            best = away, other
    return best


def explains(config: MissionConfig, known: Iterable[Landmark], landmark: Landmark) -> bool:
    """Whether a landmark is one that is known: near it, and turned the same way."""
    match = nearest(known, landmark, landmark.x_m, landmark.y_m, config.agree_m)
    if match is None:
        return False
    turn = turn_between(match[1], landmark)
    return turn is None or abs(turn) <= math.radians(config.heading_tolerance_deg)


def agreement(
    config: MissionConfig, seen: Experience, fix: Fix, used: Landmark, known: tuple[Landmark, ...]
) -> tuple[int, int]:
    """(landmarks that agree with a fix, landmarks that agreed before and would not any more)."""
    agree = broken = 0
    for landmark in seen.landmarks:
        if landmark is used:
            continue
        if nearest(known, landmark, *fix.apply(seen, landmark), config.agree_m):
            agree += 1
        elif nearest(known, landmark, landmark.x_m, landmark.y_m, config.agree_m):
            broken += 1
    return agree, broken


def seen_again(config: MissionConfig, seen: Experience, known: tuple[Landmark, ...], travelled_m: float) -> Fix | None:
    """A fix from the nearest landmark that the robot has decoded before and now sees again, or None."""
    for landmark in sorted(seen.landmarks, key=lambda landmark: distance_m(seen, landmark)):
        match = nearest(known, landmark, landmark.x_m, landmark.y_m, config.tolerance_m)
        if match is None:
            continue
        turn = turn_between(match[1], landmark)
        if turn is not None and abs(turn) > math.radians(config.heading_tolerance_deg):
            continue
        fix = fix_from(seen, landmark, match[1])
        if fix.moved_m > allowed_m(config, travelled_m):
            continue
        agree, broken = agreement(config, seen, fix, landmark, known)
        if broken <= agree:
            return fix
    return None
