"""A glance at what is in sight, in one call: whether there is anything in it for a walk. Mostly there is not.

A robot looks ten times a second, and comes upon something every few seconds. What a glance finds is looked for again by
those who weigh it (finding.py, constellation.py): they decide, and a glance only says that they would find nothing.
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

from .cells import Doubt, Shapes, Steps, search_shapes
from .chart import KIND, NO_TEXT, TEXT, TURN, Chart, X, Y, may_match
from .fix import GROWN, floor_of, sight_of
from .search import LANDMARK_PLACES

SIGHT_M = 1e3  # no robot sees farther
NOBODY = -1
AREA = 4  # of what is seen, where a chart has the text


class SearchTarget(NamedTuple):
    """Search target and method; constant until a node is decoded or given up."""

    known: F64x2  # (n, 5) landmarks decoded before, as `Chart` has them
    nodes: I64x1  # (n,) of each its node
    target: int  # or NOBODY
    shapes: Shapes  # of what is searched here
    asked: F64x2  # (m, 4) of what is searched elsewhere: kind, whether an orientation, an area; reach in 0.1 m, or 0
    steps: Steps  # from one cell to the next
    sight: tuple[float, float, float]
    sigmas: float
    within_m: float  # what is farther off is not meant
    decode_m: float  # nor decoded
    sure_m2: float  # a pose surer than so is worth no correction
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
    """Return the gaze for the nodes decoded so far and the present target.

    Args:
        shapes: packed.
        asked: others, each with the reach in 0.1 m from which it counts, or 0.
    Returns: None if some are not of landmarks.
    """
    if any(shape.place not in LANDMARK_PLACES for shape, _ in asked):
        return None
    # What has a text is no lidar's to see.
    rows = [(it.place - 1, it.oriented, it.area, reach_dm) for it, reach_dm in asked if not it.text]
    elsewhere = np.array(rows, np.float64).reshape(-1, 4)
    (place_m, turn_rad), most = floor_of(config), GROWN * GROWN
    place, per_m, turn = sight_of(config)
    nodes = np.array(chart.nodes, np.int64)
    limits = float(config.sigmas), float(config.tolerance_m), float(config.decode_m)
    sure = most * place_m * place_m, most * turn_rad * turn_rad
    meant = NOBODY if target is None else target
    told = chart.rows, nodes, meant, shapes, elsewhere, steps, (float(place), float(per_m), turn)
    return _pack(SearchTarget(*told, *limits, *sure))


@kernel
def _is_asked(gaze: SearchTarget, seen: F64x2, i: int, away_dm: float) -> bool:
    """Return whether a thing in sight is of a shape that is searched elsewhere."""
    for k in range(len(gaze.asked)):
        kind, oriented, area, reach_dm = gaze.asked[k, 0], gaze.asked[k, 1], gaze.asked[k, 2], gaze.asked[k, 3]
        lacks = (oriented > 0.0 and np.isnan(seen[i, TURN])) or (area > 0.0 and np.isnan(seen[i, AREA]))
        if seen[i, KIND] == kind and not lacks and not 0.0 < reach_dm < away_dm:
            return True
    return False


@kernel
def glance(gaze: SearchTarget, seen: F64x2, x_m: float, y_m: float, spread: F64x2, tries: int) -> int:
    """Tries that are left if nothing is found, and nothing known corrects the pose; else NOBODY.

    Args:
        seen: (k, 5) as `rows_of` has it, without texts.
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
    around = Doubt(x_m, y_m, spread, sight, gaze.sigmas, gaze.within_m)
    hit, _, _, _, left, _, _ = search_shapes((0, 0), gaze.shapes, dark[:count], around, gaze.steps, tries)
    return NOBODY if hit >= 0 else left
