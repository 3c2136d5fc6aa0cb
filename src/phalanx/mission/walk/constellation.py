"""Match several landmarks at once: one unsurveyed object may match by chance, several rarely do.

The compiler stores how far each landmark is from the next surveyed one that looks the same. Unsurveyed objects have a
configured density, `strangers_per_m2`, from which follows how often they match by chance. If the whole building is
surveyed the density is 0, and this file changes no result.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from phalanx.config.mission import MissionConfig
from phalanx.mission.observable import Experience, Landmark
from phalanx.mission.pose.spread import place_deviations

from .chart import MISFIT_2, Chart
from .fix import (
    AGAIN_MOST,
    Fix,
    Match,
    agreeing,
    fix_from,
    fuse_matches,
    is_sure,
    known_in,
    length_m,
    may_be_known,
    misfit_of,
    moved_to_pose,
    sight_of,
    unambiguous,
)

# Reject a set of matches if its expected number of chance matches exceeds this, or this times that of a rival set.
MISTAKEN = 1e-2
# Landmarks closer than this belong to one object, as two ends of a shelf, and count as one piece of evidence.
PIECE_M = 1.0
# Most pairs of a seen and a known landmark to examine, nearest first.
PAIRS_MOST = 64


def expected_chance_matches(config: MissionConfig, seen: Experience, matches: Sequence[Match]) -> float:
    """Return the expected number of sets of unsurveyed objects that would match as well; 0 if their density is 0.

    The objects are a Poisson process. Each match must fall into the gate that the matches before it leave.
    """
    often, counted = float(config.strangers_per_m2 > 0.0), list[Landmark]()
    for i, pair in enumerate(matches if often else ()):
        truth = pair[1]
        if any(length_m(truth.x_m - other.x_m, truth.y_m - other.y_m) < PIECE_M for other in counted):
            continue
        counted.append(truth)
        mean, spread, _ = fuse_matches(config, seen, matches[:i])
        x, y = moved_to_pose(seen, pair[0], mean)
        along_x, along_y, most = place_deviations(spread, x - float(mean[0]), y - float(mean[1]), sight_of(config))
        least = math.sqrt(max(0.0, along_x * along_x + along_y * along_y - most * most))
        often *= config.strangers_per_m2 * math.pi * MISFIT_2 * most * least
    return often


def constellation(config: MissionConfig, seen: Experience, pairs: Sequence[Match]) -> list[Match]:
    """Return the set of pairs that is least likely to match by chance, or [] if no set is convincing.

    Args:
        pairs: each landmark in sight with each known landmark that it may be.
    """
    pairs = pairs[:PAIRS_MOST]
    sets = [_grown(config, seen, pair, pairs) for pair in pairs]
    rated = sorted(
        zip((expected_chance_matches(config, seen, each) for each in sets), sets, strict=True), key=lambda row: row[0]
    )
    if not rated:
        return []
    often, best = rated[0]
    # Sets that share a pair give about the same pose.
    rival = next((other for other, each in rated if not any(pair in best for pair in each)), 1.0)
    return best if often <= MISTAKEN * min(1.0, rival) else []


def _grown(config: MissionConfig, seen: Experience, seed: Match, pairs: Sequence[Match]) -> list[Match]:
    """Return the seed and the pairs that fit the pose it gives, added best first."""
    kept, left = [seed], list(pairs)
    while len(kept) < AGAIN_MOST:
        observed, truth = kept[-1]
        left = [pair for pair in left if pair[0] is not observed and pair[1] is not truth]
        mean, spread, _ = fuse_matches(config, seen, kept)
        fits = [misfit_of(config, seen, pair, mean, spread) for pair in left]
        if min(fits, default=math.inf) > 1.0:
            break
        kept.append(left[fits.index(min(fits))])
    return kept


def fix_from_known(config: MissionConfig, seen: Experience, known: Chart) -> Fix | None:
    """Return a fix from the nearest landmarks that were decoded before and are in sight again, or None."""
    if is_sure(config, seen):
        return None
    matches = unambiguous(config, seen, agreeing(config, seen, known_in(config, seen, known)))
    if expected_chance_matches(config, seen, matches) > MISTAKEN:
        matches = constellation(config, seen, candidate_matches(config, seen, known))
    return fix_from(config, seen, matches) if matches else None


def candidate_matches(config: MissionConfig, seen: Experience, known: Chart) -> list[Match]:
    """Return each landmark in sight with each known landmark that it may be, nearest first."""
    return [
        (landmark, other)
        for landmark, candidate_matches in may_be_known(config, seen, known)
        for other in candidate_matches
    ]
