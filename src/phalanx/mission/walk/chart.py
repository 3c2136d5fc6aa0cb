"""Known landmarks at their true places, as arrays, to match all landmarks in sight in one kernel call."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from phalanx.arrays import F64x2, I64x2
from phalanx.kernel import kernel
from phalanx.mission.angles import PI, wrap_rad_kernel
from phalanx.mission.observable import HALF_TURN_TYPES, LANDMARK_TYPES, Experience, Landmark, rows_of
from phalanx.mission.pose.spread import Sight, Sighting, misfit, pose_spread

# Squared Mahalanobis distance that one true match in twenty exceeds, for 2 and 3 degrees of freedom.
MISFIT_2, MISFIT_3 = 6.0, 7.8
KIND, X, Y, TURN, TEXT = range(5)
# Number of the text of a landmark without a text, and of one with a text that no known landmark has.
NO_TEXT, OTHER_TEXT = -1, -2
_HALF_TURN = np.array([kind in HALF_TURN_TYPES for kind in LANDMARK_TYPES])


class Chart:
    """Known landmarks.

    Attributes:
        landmarks: at their true places.
        nodes: node of each landmark; empty if they belong to no mission.
        rows: (n, 5) from `rows_of`, with the number of the text in place of the area.
    """

    def __init__(self, landmarks: Iterable[Landmark], nodes: Iterable[int] = ()) -> None:
        self.landmarks, self.nodes = tuple(landmarks), tuple(nodes)
        texts = dict.fromkeys(known.text for known in self.landmarks if known.text is not None)
        self._texts: dict[str | None, int] = {None: NO_TEXT} | {text: i for i, text in enumerate(texts)}
        self.rows = self._of(self.landmarks)

    def _of(self, landmarks: Sequence[Landmark]) -> F64x2:
        rows = rows_of(landmarks).copy()
        rows[:, TEXT] = [self._texts.get(each.text, OTHER_TEXT) for each in landmarks]
        return rows

    def fitting(self, seen: Experience, sight: Sight, within_m: float) -> list[list[int]]:
        """Return, for each landmark in sight, the indices of the known landmarks that match it in place and heading."""
        found: list[list[int]] = [[] for _ in seen.landmarks]
        if found and self.landmarks:
            place, spread = (float(seen.x_m), float(seen.y_m)), pose_spread(seen.spread)
            for i, j in _fitting(self._of(seen.landmarks), self.rows, place, spread, sight, within_m).tolist():
                found[i].append(j)
        return found


@kernel
def rotation_between(truth_rad: float, seen_rad: float, half: bool) -> float:
    """Return the turn from the seen orientation to the true one; NaN if one of them is NaN.

    Args:
        half: orientations count modulo half a turn.
    """
    turn = wrap_rad_kernel(truth_rad - seen_rad) if not np.isnan(truth_rad - seen_rad) else np.nan
    return turn - PI * np.floor(turn / PI + 0.5) if half else turn


@kernel
def max_misfit(turn_rad: float) -> float:
    """Return the largest misfit of a match, given the turn from the seen orientation to the true one."""
    return MISFIT_2 if np.isnan(turn_rad) else MISFIT_3


@kernel
def _fitting(
    seen: F64x2, known: F64x2, place: tuple[float, float], spread: F64x2, sight: Sight, within_m: float
) -> I64x2:
    """Return (m, 2) pairs of row indices: a landmark seen, and a known landmark that it may be."""
    pairs = np.empty((len(seen) * len(known), 2), np.int64)
    count = 0
    for i in range(len(seen)):
        for j in range(len(known)):
            if known[j, TEXT] == seen[i, TEXT] and may_match(seen, i, known, j, place, spread, sight, within_m):
                pairs[count, 0], pairs[count, 1] = i, j
                count += 1
    return pairs[:count]


@kernel
def may_match(
    seen: F64x2,
    i: int,
    known: F64x2,
    j: int,
    place: tuple[float, float],
    spread: F64x2,
    sight: Sight,
    within_m: float,
) -> bool:
    """Return True if a landmark seen may be a known one by type, place and orientation; texts are not compared."""
    dx, dy = known[j, X] - seen[i, X], known[j, Y] - seen[i, Y]
    # Rejects nearly all pairs.
    if not -within_m <= dx <= within_m or known[j, KIND] != seen[i, KIND]:
        return False
    if dx * dx + dy * dy > within_m * within_m:
        return False
    turn = rotation_between(known[j, TURN], seen[i, TURN], _HALF_TURN[int(seen[i, KIND])])
    turn = np.nan if np.isnan(turn) else wrap_rad_kernel(turn)
    match = Sighting(seen[i, X], seen[i, Y], known[j, X], known[j, Y], turn)
    return bool(misfit(spread, place[0], place[1], match, sight) <= max_misfit(turn))
