"""Pose fixes: what recognised landmarks say about where the robot is, and whether to believe it.

A wrong fix feeds itself. So one is believed only if it fits what the robot knows of its own doubt, in place and in
heading, if nothing else that looks the same can be meant, and if it breaks nothing that other landmarks agree on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phalanx.arrays import F64x1, F64x2
from phalanx.config.mission import MissionConfig
from phalanx.config.parameter import made_once
from phalanx.mission.angles import sin_cos, wrap_rad
from phalanx.mission.observable import HALF_TURN_TYPES, Experience, Landmark, number_or_nan
from phalanx.mission.pose.belief import Belief, Wheels
from phalanx.mission.pose.spread import Sight, Sighting, corrected, doubt_of, misfit, not_surer, pose_spread

from .chart import Chart, max_misfit, rotation_between

Pose = tuple[float, float, float]
Match = tuple[Landmark, Landmark]  # as it was seen, and as it truly is
# A robot that may be turned by more than this takes the sides of a thing for one another.
LOST_RAD = math.radians(45)
# So far a robot may be off, of its own doubt, when it takes a thing for the only one: an error of more has to meet
# a thing that looks the same just there.
ALONE_SIGMAS = 2.5
# Of all that is seen again so many landmarks, the nearest, say as much as all.
AGAIN_MOST = 6
# A pose whose doubt has grown by so much since it was as sure as it gets is worth a correction.
GROWN = 1.5


@dataclass(frozen=True, slots=True)
class Fix:
    """The robot's pose, corrected."""

    x_m: float  # map frame
    y_m: float  # likewise
    heading_rad: float  # likewise
    moved_m: float  # between the estimate and the fix: the drift since the last one
    turned_rad: float
    sightings: tuple[Sighting, ...]  # what it follows from; each as the pose after those before puts it


@made_once
def sight_of(config: MissionConfig) -> Sight:
    """How exactly landmarks are seen."""
    return Sight(config.sight_m, config.sight_per_m, math.radians(config.sight_deg))


@made_once
def wheels_of(config: MissionConfig) -> Wheels:
    """How wrong odometry may be."""
    return Wheels(
        config.odometry_way,
        config.odometry_turn,
        math.radians(config.odometry_curve_deg),
        config.odometry_way_m,
        math.radians(config.odometry_turn_deg),
        math.radians(config.odometry_per_m_deg),
    )


def floor_of(config: MissionConfig) -> tuple[float, float]:
    """Metres and radians that no pose is surer than."""
    return config.sure_m, math.radians(config.sure_deg)


def initial_belief(config: MissionConfig, pose: Pose) -> Belief:
    """Return the belief of a robot that was put at a pose; of its odometry it knows nothing yet."""
    (place_m, turn_rad), wheels = floor_of(config), wheels_of(config)
    sure = (place_m, place_m, turn_rad, wheels.way, wheels.turn, wheels.curve)
    return Belief(np.array([*pose, 0.0, 0.0, 0.0]), np.diag([value * value for value in sure]))


def fixed(config: MissionConfig, belief: Belief, fix: Fix) -> Belief:
    """The belief after a fix."""
    (place_m, turn_rad), (_, cosine), (x, y, _) = floor_of(config), sin_cos(fix.turned_rad), belief.pose
    far_m2 = max((each.seen_x_m - x) ** 2 + (each.seen_y_m - y) ** 2 for each in fix.sightings)
    # The filter takes an arc for its tangent: of 25 degrees, 4 m away, that is 0.4 m.
    bent_m = math.sqrt(far_m2) * (1.0 - cosine)
    return belief.corrected(fix.sightings, sight_of(config), (max(place_m, bent_m), turn_rad))


def length_m(x_m: float, y_m: float) -> float:
    """Of a vector, by a root: the last bit of `math.hypot` is not the same in every Python."""
    return math.sqrt(x_m * x_m + y_m * y_m)


def distance_m(seen: Experience, landmark: Landmark) -> float:
    """From the robot to a landmark."""
    return length_m(landmark.x_m - seen.x_m, landmark.y_m - seen.y_m)


def allowed_m(config: MissionConfig, travelled_m: float, doubt_m: float = 0.0) -> float:
    """How far a robot can have drifted over so many metres since its last fix, or by what it knows of its doubt."""
    return max(config.drift_base_m + config.drift_per_m * max(0.0, travelled_m), config.sigmas * doubt_m)


def pose_doubt_m(seen: Experience) -> float:
    """Standard deviation of where the robot is, along the worse axis."""
    return math.sqrt(max(seen.spread[0], seen.spread[3]))


def is_there(config: MissionConfig, seen: Experience, x_m: float, y_m: float) -> bool:
    """Return whether the robot is at a place, however its doubt has it."""
    away_m = length_m(x_m - seen.x_m, y_m - seen.y_m)
    return away_m + ALONE_SIGMAS * pose_doubt_m(seen) <= config.place_m


def doubt_m(config: MissionConfig, seen: Experience, landmark: Landmark) -> float:
    """Standard deviation of where a landmark is that is seen, along its worst direction."""
    spread = pose_spread(seen.spread)
    return doubt_of(spread, landmark.x_m - seen.x_m, landmark.y_m - seen.y_m, sight_of(config))[2]


def sighting(observed: Landmark, truth: Landmark, x_m: float, y_m: float, turned_rad: float = 0.0) -> Sighting:
    """Return the sighting that matches `observed` to `truth`.

    Args:
        x_m, y_m: where the pose now puts what was observed.
        turned_rad: from the heading with which it was observed to that of the pose now.
    """
    turns = number_or_nan(truth.orientation_rad), number_or_nan(observed.orientation_rad)
    turn = rotation_between(*turns, truth.type in HALF_TURN_TYPES)
    turn = turn if math.isnan(turn) else wrap_rad(turn - turned_rad)
    return Sighting(float(x_m), float(y_m), float(truth.x_m), float(truth.y_m), turn)


def fits(config: MissionConfig, spread: F64x2, x_m: float, y_m: float, match: Sighting) -> bool:
    """Return whether what was seen from a pose so unsure may be what it is matched with."""
    return bool(misfit(spread, x_m, y_m, match, sight_of(config)) <= max_misfit(match.turn_rad))


def has_no_lookalike(config: MissionConfig, seen: Experience, pair: Match, mean: F64x1, spread: F64x2) -> bool:
    """Return whether no other look-alike can be meant: it lies beyond the robot's uncertainty.

    If another one were seen, it would be within the doubt of that one, and that is `apart_m` from here.

    Args:
        mean, spread: of the robot's pose, as `fuse_matches` has it.
    """
    observed, truth = pair
    x, y = moved_to_pose(seen, observed, mean)
    doubt = doubt_of(spread, x - float(mean[0]), y - float(mean[1]), sight_of(config))[2]
    return length_m(x - truth.x_m, y - truth.y_m) + ALONE_SIGMAS * doubt < truth.apart_m


def unambiguous(config: MissionConfig, seen: Experience, matches: Sequence[Match]) -> list[Match]:
    """Those of matches that agree which can mean nothing else: each alone, or with a pose that those correct."""
    if not matches or config.sigmas * math.sqrt(seen.spread[-1]) > LOST_RAD:
        return []
    mean, spread, _ = fuse_matches(config, seen, ())
    certain = [pair for pair in matches if has_no_lookalike(config, seen, pair, mean, spread)]
    if certain:
        mean, spread, _ = fuse_matches(config, seen, certain)
    return [
        pair for pair in matches if pair in certain or (certain and has_no_lookalike(config, seen, pair, mean, spread))
    ]


def is_ambiguous(config: MissionConfig, seen: Experience, observed: Landmark, truth: Landmark) -> bool:
    """Return whether another landmark of the same scan may as well be the one that was recognised."""
    spread = pose_spread(seen.spread)
    for other in seen.landmarks:
        if other is observed or other.type != truth.type or other.text != truth.text:
            continue
        if length_m(other.x_m - observed.x_m, other.y_m - observed.y_m) <= config.agree_m / 2:
            continue
        if fits(config, spread, seen.x_m, seen.y_m, sighting(other, truth, other.x_m, other.y_m)):
            return True
    return False


def agreeing(config: MissionConfig, seen: Experience, matches: Sequence[Match]) -> list[Match]:
    """Those of the matches that one pose explains; none of them unless most do.

    What does not fit the rest is left out, the worst first: a corner drawn elsewhere, a thing taken for another.
    """
    kept = list(matches)
    while kept:
        mean, spread, _ = fuse_matches(config, seen, kept)
        apart = [misfit_of(config, seen, pair, mean, spread) for pair in kept]
        if len(kept) == 1 or max(apart) <= 1.0:
            break
        kept.pop(apart.index(max(apart)))
    return kept if 2 * len(kept) > len(matches) else []


def misfit_of(config: MissionConfig, seen: Experience, pair: Match, mean: F64x1, spread: F64x2) -> float:
    """How badly a match fits another pose than that of the experience; more than 1 is too badly."""
    match = _from_pose(seen, pair, mean)
    return float(misfit(spread, float(mean[0]), float(mean[1]), match, sight_of(config))) / max_misfit(match.turn_rad)


def fix_from(config: MissionConfig, seen: Experience, matches: Sequence[Match]) -> Fix:
    """The pose that matches tell, taken one after the other."""
    mean, _, sightings = fuse_matches(config, seen, matches)
    x, y, heading = mean.tolist()
    moved_m = length_m(x - seen.x_m, y - seen.y_m)
    return Fix(x, y, heading, moved_m, wrap_rad(heading - seen.heading_rad), tuple(sightings))


def fuse_matches(
    config: MissionConfig, seen: Experience, matches: Sequence[Match]
) -> tuple[F64x1, F64x2, list[Sighting]]:
    """(mean, spread, sightings) of the pose after matches, each as the pose after those before puts it."""
    mean, spread = np.array([seen.x_m, seen.y_m, seen.heading_rad], np.float64), pose_spread(seen.spread)
    sightings = []
    for pair in matches:
        match = _from_pose(seen, pair, mean)
        sightings.append(match)
        mean, spread = corrected(mean, spread, match, sight_of(config))
        spread = not_surer(spread, *floor_of(config))
    return mean, spread, sightings


def _from_pose(seen: Experience, pair: Match, mean: F64x1) -> Sighting:
    """Return a match, moved to the robot's present pose."""
    observed, truth = pair
    return sighting(observed, truth, *moved_to_pose(seen, observed, mean), wrap_rad(float(mean[2]) - seen.heading_rad))


def moved_to_pose(seen: Experience, landmark: Landmark, mean: F64x1) -> tuple[float, float]:
    """Return a landmark, moved to the robot's other pose."""
    sine, cosine = sin_cos(float(mean[2]) - seen.heading_rad)
    dx, dy = float(landmark.x_m - seen.x_m), float(landmark.y_m - seen.y_m)
    return float(mean[0]) + (cosine * dx - sine * dy), float(mean[1]) + (sine * dx + cosine * dy)


def is_sure(config: MissionConfig, seen: Experience) -> bool:
    """Return whether the pose is about as sure as one gets, and a correction would say nothing."""
    (xx, _, _, yy, _, tt), (place_m, turn_rad) = seen.spread, floor_of(config)
    most = GROWN * GROWN
    return max(xx, yy) <= most * place_m * place_m and tt <= most * turn_rad * turn_rad


def known_in(config: MissionConfig, seen: Experience, known: Chart) -> list[Match]:
    """The nearest landmarks in sight that may be known ones, each of them one only."""
    matches: list[Match] = []
    for landmark, candidate_matches in may_be_known(config, seen, known):
        # Two known things that may be this one say nothing.
        if len(candidate_matches) == 1 and not is_ambiguous(config, seen, landmark, candidate_matches[0]):
            matches.append((landmark, candidate_matches[0]))
        if len(matches) == AGAIN_MOST:
            break
    return matches


def may_be_known(config: MissionConfig, seen: Experience, known: Chart) -> list[tuple[Landmark, list[Landmark]]]:
    """The landmarks in sight that may be known ones, the nearest first, each with those."""
    pairs = zip(seen.landmarks, known.fitting(seen, sight_of(config), config.tolerance_m), strict=True)
    # Two nodes may be one thing, and then it is no other.
    found = [
        (landmark, list(dict.fromkeys(known.landmarks[j] for j in numbers))) for landmark, numbers in pairs if numbers
    ]
    return sorted(found, key=lambda each: distance_m(seen, each[0]))
