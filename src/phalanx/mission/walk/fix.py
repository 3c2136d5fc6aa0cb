"""Pose fixes: compute the robot's pose from recognised landmarks, and decide whether to trust the result.

A wrong fix leads to further wrong fixes. So a match is accepted only if it fits the covariance of the pose, if no other
landmark that looks the same can be meant, and if other landmarks in sight agree.
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
from phalanx.mission.pose.belief import Belief, OdometryErrors
from phalanx.mission.pose.spread import Sight, Sighting, corrected, misfit, place_deviations, pose_spread, with_floor

from .chart import Chart, max_misfit, rotation_between

Pose = tuple[float, float, float]
Match = tuple[Landmark, Landmark]  # (as seen, at its true place)
# With a larger uncertainty of its heading a robot may confuse the sides of an object.
LOST_RAD = math.radians(45)
# Standard deviations by which the pose may be off when a landmark is taken for the only one of its kind in reach. A
# larger error is harmful only if a look-alike stands at just that place.
ALONE_SIGMAS = 2.5
# Most known landmarks to use for a fix, nearest first: more do not improve it.
AGAIN_MOST = 6
# Correct the pose when a standard deviation has grown to this multiple of its minimum.
GROWN = 1.5


@dataclass(frozen=True, slots=True)
class Fix:
    """A corrected pose of the robot."""

    x_m: float  # map frame
    y_m: float  # likewise
    heading_rad: float  # likewise
    moved_m: float  # distance from the estimate to the fix: the drift since the last fix
    turned_rad: float
    sightings: tuple[Sighting, ...]  # matches it is computed from; each uses the pose after the previous ones


@made_once
def sight_of(config: MissionConfig) -> Sight:
    """Return the standard deviations of observed landmarks."""
    return Sight(config.sight_m, config.sight_per_m, math.radians(config.sight_deg))


@made_once
def odometry_errors_of(config: MissionConfig) -> OdometryErrors:
    """Return the standard deviations of odometry errors."""
    return OdometryErrors(
        config.odometry_way,
        config.odometry_turn,
        math.radians(config.odometry_curve_deg),
        config.odometry_way_m,
        math.radians(config.odometry_turn_deg),
        math.radians(config.odometry_per_m_deg),
    )


def floor_of(config: MissionConfig) -> tuple[float, float]:
    """Return the smallest standard deviations of a pose, in metres and radians."""
    return config.sure_m, math.radians(config.sure_deg)


def initial_belief(config: MissionConfig, pose: Pose) -> Belief:
    """Return the belief of a robot placed at a pose, with unknown odometry errors."""
    (place_m, turn_rad), wheels = floor_of(config), odometry_errors_of(config)
    sure = (place_m, place_m, turn_rad, wheels.way, wheels.turn, wheels.curve)
    return Belief(np.array([*pose, 0.0, 0.0, 0.0]), np.diag([value * value for value in sure]))


def fixed(config: MissionConfig, belief: Belief, fix: Fix) -> Belief:
    """Return the belief after a fix."""
    (place_m, turn_rad), (_, cosine), (x, y, _) = floor_of(config), sin_cos(fix.turned_rad), belief.pose
    far_m2 = max((each.seen_x_m - x) ** 2 + (each.seen_y_m - y) ** 2 for each in fix.sightings)
    # The filter linearises the turn, replacing an arc by its tangent: at 25 degrees and 4 m the error is 0.4 m.
    bent_m = math.sqrt(far_m2) * (1.0 - cosine)
    return belief.corrected(fix.sightings, sight_of(config), (max(place_m, bent_m), turn_rad))


def length_m(x_m: float, y_m: float) -> float:
    """Return the length of a vector by `sqrt`: the last bit of `math.hypot` differs between versions of Python."""
    return math.sqrt(x_m * x_m + y_m * y_m)


def distance_m(seen: Experience, landmark: Landmark) -> float:
    """Return the distance from the robot to a landmark."""
    return length_m(landmark.x_m - seen.x_m, landmark.y_m - seen.y_m)


def allowed_m(config: MissionConfig, travelled_m: float, doubt_m: float = 0.0) -> float:
    """Return the largest plausible drift since the last fix, `travelled_m` ago, or by the pose's standard deviation."""
    return max(config.drift_base_m + config.drift_per_m * max(0.0, travelled_m), config.sigmas * doubt_m)


def pose_doubt_m(seen: Experience) -> float:
    """Return the standard deviation of the robot's position, along the worse axis."""
    return math.sqrt(max(seen.spread[0], seen.spread[3]))


def is_there(config: MissionConfig, seen: Experience, x_m: float, y_m: float) -> bool:
    """Return True if the robot is at a place even with the uncertainty of its position."""
    away_m = length_m(x_m - seen.x_m, y_m - seen.y_m)
    return away_m + ALONE_SIGMAS * pose_doubt_m(seen) <= config.place_m


def doubt_m(config: MissionConfig, seen: Experience, landmark: Landmark) -> float:
    """Return the standard deviation of the place of a seen landmark, along the worst direction."""
    spread = pose_spread(seen.spread)
    return place_deviations(spread, landmark.x_m - seen.x_m, landmark.y_m - seen.y_m, sight_of(config))[2]


def sighting(observed: Landmark, truth: Landmark, x_m: float, y_m: float, turned_rad: float = 0.0) -> Sighting:
    """Return the sighting that matches `observed` to `truth`.

    Args:
        x_m, y_m: place of the observed landmark, computed from the present pose.
        turned_rad: turn from the heading of the observation to that of the present pose.
    """
    turns = number_or_nan(truth.orientation_rad), number_or_nan(observed.orientation_rad)
    turn = rotation_between(*turns, truth.type in HALF_TURN_TYPES)
    turn = turn if math.isnan(turn) else wrap_rad(turn - turned_rad)
    return Sighting(float(x_m), float(y_m), float(truth.x_m), float(truth.y_m), turn)


def fits(config: MissionConfig, spread: F64x2, x_m: float, y_m: float, match: Sighting) -> bool:
    """Return True if a match is plausible with the covariance of the pose."""
    return bool(misfit(spread, x_m, y_m, match, sight_of(config)) <= max_misfit(match.turn_rad))


def has_no_lookalike(config: MissionConfig, seen: Experience, pair: Match, mean: F64x1, spread: F64x2) -> bool:
    """Return True if the nearest look-alike of a match is out of reach of the pose's uncertainty.

    The look-alike is `apart_m` from the matched landmark. If it had been seen instead, the observation would be within
    the uncertainty of its place.

    Args:
        mean, spread: mean and covariance of the pose, from `fuse_matches`.
    """
    observed, truth = pair
    x, y = moved_to_pose(seen, observed, mean)
    doubt = place_deviations(spread, x - float(mean[0]), y - float(mean[1]), sight_of(config))[2]
    return length_m(x - truth.x_m, y - truth.y_m) + ALONE_SIGMAS * doubt < truth.apart_m


def unambiguous(config: MissionConfig, seen: Experience, matches: Sequence[Match]) -> list[Match]:
    """Return the matches without a possible look-alike.

    A match counts if it has none by itself, or none with the pose that the former matches correct.

    Args:
        matches: matches that agree.
    """
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
    """Return True if another landmark in the same scan fits the recognised one as well."""
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
    """Return the matches that agree on one pose, or [] if they are not the majority.

    Outliers are removed, the worst first: a corner at a wrong place in the map, a landmark mistaken for another.
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
    """Return the misfit of a match for a given pose, as a share of the allowed misfit; above 1 it does not fit."""
    match = _from_pose(seen, pair, mean)
    return float(misfit(spread, float(mean[0]), float(mean[1]), match, sight_of(config))) / max_misfit(match.turn_rad)


def fix_from(config: MissionConfig, seen: Experience, matches: Sequence[Match]) -> Fix:
    """Return the pose corrected by the matches, one after the other."""
    mean, _, sightings = fuse_matches(config, seen, matches)
    x, y, heading = mean.tolist()
    moved_m = length_m(x - seen.x_m, y - seen.y_m)
    return Fix(x, y, heading, moved_m, wrap_rad(heading - seen.heading_rad), tuple(sightings))


def fuse_matches(
    config: MissionConfig, seen: Experience, matches: Sequence[Match]
) -> tuple[F64x1, F64x2, list[Sighting]]:
    """Return (mean, covariance, sightings) after all matches; each sighting uses the pose after the previous ones."""
    mean, spread = np.array([seen.x_m, seen.y_m, seen.heading_rad], np.float64), pose_spread(seen.spread)
    sightings = []
    for pair in matches:
        match = _from_pose(seen, pair, mean)
        sightings.append(match)
        mean, spread = corrected(mean, spread, match, sight_of(config))
        spread = with_floor(spread, *floor_of(config))
    return mean, spread, sightings


def _from_pose(seen: Experience, pair: Match, mean: F64x1) -> Sighting:
    """Return the sighting of a match, computed from the pose `mean`."""
    observed, truth = pair
    return sighting(observed, truth, *moved_to_pose(seen, observed, mean), wrap_rad(float(mean[2]) - seen.heading_rad))


def moved_to_pose(seen: Experience, landmark: Landmark, mean: F64x1) -> tuple[float, float]:
    """Return the place of an observed landmark if the robot is at the pose `mean`."""
    sine, cosine = sin_cos(float(mean[2]) - seen.heading_rad)
    dx, dy = float(landmark.x_m - seen.x_m), float(landmark.y_m - seen.y_m)
    return float(mean[0]) + (cosine * dx - sine * dy), float(mean[1]) + (sine * dx + cosine * dy)


def is_sure(config: MissionConfig, seen: Experience) -> bool:
    """Return True if the covariance is near its minimum, so that a correction is useless."""
    (xx, _, _, yy, _, tt), (place_m, turn_rad) = seen.spread, floor_of(config)
    most = GROWN * GROWN
    return max(xx, yy) <= most * place_m * place_m and tt <= most * turn_rad * turn_rad


def known_in(config: MissionConfig, seen: Experience, known: Chart) -> list[Match]:
    """Return matches of the nearest landmarks in sight, each of which fits a single known landmark."""
    matches: list[Match] = []
    for landmark, candidate_matches in may_be_known(config, seen, known):
        # A landmark that fits two known ones is no evidence.
        if len(candidate_matches) == 1 and not is_ambiguous(config, seen, landmark, candidate_matches[0]):
            matches.append((landmark, candidate_matches[0]))
        if len(matches) == AGAIN_MOST:
            break
    return matches


def may_be_known(config: MissionConfig, seen: Experience, known: Chart) -> list[tuple[Landmark, list[Landmark]]]:
    """Return the landmarks in sight that may be known ones, nearest first, each with all known ones that fit."""
    pairs = zip(seen.landmarks, known.fitting(seen, sight_of(config), config.tolerance_m), strict=True)
    # Two nodes may have the same landmark: count it once.
    found = [
        (landmark, list(dict.fromkeys(known.landmarks[j] for j in numbers))) for landmark, numbers in pairs if numbers
    ]
    return sorted(found, key=lambda each: distance_m(seen, each[0]))
