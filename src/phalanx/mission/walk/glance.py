"""A fast check, in one kernel call, that a scan holds nothing new for the mission, as is true for most scans.

A robot scans ten times a second and finds a node every few seconds. The check only rules out a find: if it does not,
the full search (finding.py, constellation.py) runs and decides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phalanx.arrays import F64x2, I64x1
from phalanx.bundle import bundled
from phalanx.config.mission import MissionConfig
from phalanx.kernel import kernel
from phalanx.mission.file.canonical import Shape
from phalanx.mission.pose.spread import Sight

from .cells import PoseUncertainty, Shapes, Steps, search_shapes
from .chart import KIND, NO_TEXT, TEXT, TURN, Chart, X, Y, may_match
from .fix import GROWN, floor_of, sight_of
from .search import LANDMARK_PLACES

SIGHT_M = 1e3  # maximum plausible distance to a landmark
NOBODY = -1
AREA = 4  # column of seen landmarks; a chart has the text there


class SearchTarget(NamedTuple):
    """Everything that the fast check searches for; constant until a node is decoded or given up."""

    known: F64x2  # (n, 5) landmarks decoded before, rows of `Chart`
    nodes: I64x1  # (n,) node of each of them
    target: int  # target node, or NOBODY
    shapes: Shapes  # shapes that the check searches itself
    asked: F64x2  # (m, 4) shapes left to the full search: kind, 1 if oriented, 1 if with area, reach in 0.1 m or 0
    steps: Steps  # size of a cell
    sight: tuple[float, float, float]
    sigmas: float
    within_m: float  # largest distance between a seen and a known landmark that may match
    decode_m: float  # largest distance to a landmark that is decoded
    sure_m2: float  # variances up to which a pose needs no correction
    sure_rad2: float


_pack = bundled(SearchTarget)


def search_target_of(
    config: MissionConfig,
    chart: Chart,
    target: int | None,
    steps: Steps,
    shapes: Shapes,
    asked: Sequence[tuple[Shape, int]],
) -> SearchTarget | None:
    """Return the search target for the nodes decoded so far and the present target.

    Args:
        shapes: packed shapes that the check searches itself.
        asked: other shapes, each with the largest distance to its landmark in 0.1 m, or 0 for any.
    Returns: None if a shape in `asked` is not that of a landmark.
    """
    if any(shape.place not in LANDMARK_PLACES for shape, _ in asked):
        return None
    # A lidar cannot see landmarks with a text.
    rows = [(it.place - 1, it.oriented, it.area, reach_dm) for it, reach_dm in asked if not it.text]
    elsewhere = np.array(rows, np.float64).reshape(-1, 4)
    (place_m, turn_rad), most = floor_of(config), GROWN * GROWN
    place, per_m, turn = sight_of(config)
    nodes = np.array(chart.nodes, np.int64)
    limits = float(config.sigmas), float(config.tolerance_m), float(config.decode_m)
    sure = most * place_m * place_m, most * turn_rad * turn_rad
    meant = NOBODY if target is None else target
    arrays = chart.rows, nodes, meant, shapes, elsewhere, steps, (float(place), float(per_m), turn)
    return _pack(SearchTarget(*arrays, *limits, *sure))


@kernel
def _is_asked(gaze: SearchTarget, seen: F64x2, i: int, away_dm: float) -> bool:
    """Return True if a landmark in sight has a shape that is left to the full search."""
    for k in range(len(gaze.asked)):
        kind, oriented, area, reach_dm = gaze.asked[k, 0], gaze.asked[k, 1], gaze.asked[k, 2], gaze.asked[k, 3]
        lacks = (oriented > 0.0 and np.isnan(seen[i, TURN])) or (area > 0.0 and np.isnan(seen[i, AREA]))
        if seen[i, KIND] == kind and not lacks and not 0.0 < reach_dm < away_dm:
            return True
    return False


@kernel
def glance(gaze: SearchTarget, seen: F64x2, x_m: float, y_m: float, spread: F64x2, tries: int) -> int:
    """Return the tries left if the scan has no match and no landmark that corrects the pose; else NOBODY.

    Args:
        seen: (k, 5) rows from `rows_of`, of landmarks without texts.
        spread: (3, 3) covariance of the pose.
    """
    sight = Sight(gaze.sight[0], gaze.sight[1], gaze.sight[2])
    is_sure = max(spread[0, 0], spread[1, 1]) <= gaze.sure_m2 and spread[2, 2] <= gaze.sure_rad2
    dark, count = np.empty((len(seen), 5)), 0
    for i in range(len(seen)):
        dx, dy = seen[i, X] - x_m, seen[i, Y] - y_m
        away_m = math.sqrt(dx * dx + dy * dy)
        if not away_m < SIGHT_M:
            return NOBODY
        is_dark = away_m <= gaze.decode_m
        for j in range(len(gaze.known)):
            if gaze.known[j, TEXT] != NO_TEXT:
                continue
            if may_match(seen, i, gaze.known, j, (x_m, y_m), spread, sight, gaze.within_m):
                if not is_sure:
                    return NOBODY
                is_dark = is_dark and gaze.nodes[j] == gaze.target
        if is_dark and _is_asked(gaze, seen, i, 10 * away_m):
            return NOBODY
        if is_dark:
            for k in range(5):
                dark[count, k] = seen[i, k]
            count += 1
    around = PoseUncertainty(x_m, y_m, spread, sight, gaze.sigmas, gaze.within_m)
    hit, _, _, _, left, _, _ = search_shapes((0, 0), gaze.shapes, dark[:count], around, gaze.steps, tries)
    return NOBODY if hit >= 0 else left
