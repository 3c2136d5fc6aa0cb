"""Match several landmarks at once: among unsurveyed objects one may match by chance, several rarely do.

The compiler tells how far a landmark is from the next thing that looks the same, of those that it knows. Of others a
robot may know how close they stand in such a building, `strangers_per_m2`, and so how often some of them pass for all
that it takes for known. Where a whole building is drawn there are none, and nothing here changes anything.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from phalanx.config.mission import MissionConfig
from phalanx.mission.observable import Experience, Landmark
from phalanx.mission.pose.spread import doubt_of

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

# What strangers pass for more often is not believed, nor what is not so much less likely than another explanation.
MISTAKEN = 1e-2
# What is so near is of one piece, as two ends of a shelf: where the like of one stands, the like of the other does.
PIECE_M = 1.0
# Of pairs of something seen and something known so many are looked at, the nearest.
PAIRS_MOST = 64


def expected_chance_matches(config: MissionConfig, seen: Experience, matches: Sequence[Match]) -> float:
    """How many sets of things that nobody surveyed pass for all of these matches, on the average; 0 without any.

    They stand by chance (a Poisson process); each gate is what is left after the matches before.
    """
    often, told_of = float(config.strangers_per_m2 > 0.0), list[Landmark]()
    for i, pair in enumerate(matches if often else ()):
        truth = pair[1]
        if any(length_m(truth.x_m - other.x_m, truth.y_m - other.y_m) < PIECE_M for other in told_of):
            continue
        told_of.append(truth)
        mean, spread, _ = fuse_matches(config, seen, matches[:i])
        x, y = moved_to_pose(seen, pair[0], mean)
        along_x, along_y, most = doubt_of(spread, x - float(mean[0]), y - float(mean[1]), sight_of(config))
        least = math.sqrt(max(0.0, along_x * along_x + along_y * along_y - most * most))
        often *= config.strangers_per_m2 * math.pi * MISFIT_2 * most * least
    return often


def constellation(config: MissionConfig, seen: Experience, pairs: Sequence[Match]) -> list[Match]:
    """Those of the pairs that together can hardly be strangers, nor anything else that is known; none if none are.

    Args:
        pairs: each thing seen with each known one that it may be.
    """
    pairs = pairs[:PAIRS_MOST]
    sets = [_grown(config, seen, pair, pairs) for pair in pairs]
    rated = sorted(
        zip((expected_chance_matches(config, seen, each) for each in sets), sets, strict=True), key=lambda row: row[0]
    )
    if not rated:
        return []
    often, best = rated[0]
    # Sets that share a pair tell about the same pose.
    rival = next((other for other, each in rated if not any(pair in best for pair in each)), 1.0)
    return best if often <= MISTAKEN * min(1.0, rival) else []


def _grown(config: MissionConfig, seen: Experience, seed: Match, pairs: Sequence[Match]) -> list[Match]:
    """The seed, and of the pairs what fits the pose that these tell, the best first."""
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
    """A fix from the nearest landmarks that the robot has decoded before and now sees again, or None."""
    if is_sure(config, seen):
        return None
    matches = unambiguous(config, seen, agreeing(config, seen, known_in(config, seen, known)))
    if expected_chance_matches(config, seen, matches) > MISTAKEN:
        matches = constellation(config, seen, candidate_matches(config, seen, known))
    return fix_from(config, seen, matches) if matches else None


def candidate_matches(config: MissionConfig, seen: Experience, known: Chart) -> list[Match]:
    """Each landmark in sight with each known one that it may be; the nearest first."""
    return [
        (landmark, other)
        for landmark, candidate_matches in may_be_known(config, seen, known)
        for other in candidate_matches
    ]
