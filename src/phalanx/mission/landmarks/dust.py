"""Dust of SLAM: lone cells of a map that no robot will meet, or can go around if it does.

Reflections and people who passed leave single black cells on a map's floor. A survey that took each for a pillar would
find no way. But a lone cell may be the leg of a chair as well: so none is dropped that narrows a way. Who surveys and
who judges a mission leave them out; who simulates a building does not.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .floorplan import PASS_M

Cells = NDArray[np.uint8]

# A cell with a longer edge is no speck.
DUST_M = 0.1
# A robot's middle goes around in so many places, PASS_M from the speck's own edge, and as far from all else.
PLACES = 24


def without_dust(cells: Cells, edge_m: float, free: int) -> tuple[Cells, int]:
    """The cells of a map, lone ones that a robot gets around made free; and how many those were.

    Args:
        cells: (height, width) with a border of such as are not free.
        edge_m: of a cell.
        free: the number of free ones.
    """
    if edge_m > DUST_M:
        return cells, 0
    solid = cells != free
    around = sum(np.roll(solid, (i, j), (0, 1)).astype(np.uint8) for i in (-1, 0, 1) for j in (-1, 0, 1))
    lone = solid & (around == 1)
    dust = [(i, j) for i, j in np.argwhere(lone).tolist() if _is_passed(solid, i, j, edge_m)]
    swept = cells.copy()
    for i, j in dust:
        swept[i, j] = free
    return swept, len(dust)


def _is_passed(solid: NDArray[np.bool_], row: int, column: int, edge_m: float) -> bool:
    """Whether a robot gets from each place beside a speck to each other beside it: it parts nothing."""
    away = PASS_M / edge_m + 0.5  # in cells, of a robot's middle from the middles of what it passes
    reach = math.ceil(2 * away)
    window = solid[max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1]
    others = np.argwhere(window) - (min(row, reach), min(column, reach))
    others = others[np.any(others != 0, axis=1)]
    turns = math.tau * np.arange(PLACES) / PLACES
    y, x = away * np.sin(turns), away * np.cos(turns)
    nearest = np.hypot(y[:, None] - others[:, 0], x[:, None] - others[:, 1]).min(axis=1, initial=np.inf)
    has_room = nearest >= away
    gaps = int(np.count_nonzero(has_room & ~np.roll(has_room, 1)))
    return bool(has_room.all() or (gaps == 1 and has_room.any()))
