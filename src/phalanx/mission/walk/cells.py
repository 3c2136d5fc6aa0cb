"""Cells, compiled: the one that a seen thing falls into, and which of thousands have not been searched yet.

A robot that looks at the same door ten times a second would search around the same cells again. Cells that nothing was
found around are in a table; looking there changes how long a search takes, never what it finds or how many tries it
counts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.kernel import kernel
from phalanx.mission.angles import turn_about

CELL_LIMIT = 1 << 30  # cells from the origin: further away is nonsense, and would not fit
TABLE_ROWS = 1 << 17
FULL = TABLE_ROWS * 3 // 4
LANES_LIMIT = 4096

Floats = NDArray[np.float64]
Table = NDArray[np.int64]
Numbers = tuple[int, int, int, int]
Steps = tuple[float, float, float, float]


class Groups(NamedTuple):
    """What is searched for together, as kernels take it."""

    rows: Floats  # (m, 5) offset of the cells, and the reach in 0.1 m from which things count, or 0
    steps: Steps
    bins: int
    rings: int


@kernel
def _number(value: float, offset: float, step: float) -> int:
    # rint rounds halves to even, on every machine and as `round` does.
    return int(np.rint((value - offset) / step))


@kernel
def numbers_of(
    x_m: float, y_m: float, turn_rad: float, area_m2: float, offset: Steps, steps: Steps, bins: int
) -> Numbers:
    """(x, y, bin, area) of the cell of a thing; -1 where it has no orientation or no area, which is NaN.

    Args:
        offset: of the cells: metres, metres, radians, square metres.
        steps: from one cell to the next: metres, metres, radians, square metres.
        bins: in a full turn, or in half of one.
    Source: Encoded graphs §IV-A.
    """
    x, y = _number(x_m, offset[0], steps[0]), _number(y_m, offset[1], steps[1])
    turn, area = -1, -1
    if not np.isnan(turn_rad):
        turn = _number(turn_rad, offset[2], steps[2]) % bins
    if not np.isnan(area_m2):
        area = max(0, min(CELL_LIMIT, _number(area_m2, offset[3], steps[3])))
    return max(-CELL_LIMIT, min(CELL_LIMIT, x)), max(-CELL_LIMIT, min(CELL_LIMIT, y)), turn, area


@kernel
def _row(table: Table, lane: int, numbers: Numbers) -> int:
    """Where this cell is in the table, or the free row where it would be."""
    x, y, turn, area = numbers
    mask = len(table) - 1
    row = (x * 73856093 + y * 19349663 + turn * 83492791 + area * 39916801 + lane * 67867967) & mask
    while table[row, 0] != 0 and not (
        table[row, 0] == lane
        and table[row, 1] == x
        and table[row, 2] == y
        and table[row, 3] == turn
        and table[row, 4] == area
    ):
        row = (row + 1) & mask
    return row


@kernel
def _add(table: Table, lane: int, numbers: Numbers) -> bool:
    """Puts a cell into the table; whether it is new."""
    row = _row(table, lane, numbers)
    is_new = table[row, 0] == 0
    table[row, 0] = lane
    for k in range(4):
        table[row, 1 + k] = numbers[k]
    return bool(is_new)


@kernel
def next_unsearched(
    first: int,
    things: Floats,
    eye: tuple[float, float],
    turn_rad: float,
    groups: Groups,
    table: Table,
    lane: int,
    left: int,
) -> tuple[int, int, Numbers]:
    """(pair, tries left, its cell) of the next pair that has to be searched; tries of those known are spent.

    Args:
        first: pair to begin with; pair k is thing k // groups and group k % groups.
        things: (n, 4) x, y, orientation and area, NaN where there is none.
        lane: of the first group; the others' follow.
    Returns: pair -1 where no tries are left, n * m where no pair is.
    """
    nobody, rows, rings = (0, 0, 0, 0), groups.rows, groups.rings
    for pair in range(first, len(things) * len(rows)):
        thing, group = things[pair // len(rows)], rows[pair % len(rows)]
        x, y, turn = thing[0], thing[1], thing[2]
        if turn_rad != 0.0:
            x, y = turn_about(x, y, eye[0], eye[1], turn_rad)
            turn += turn_rad
        if group[4] > 0.0:
            dx, dy = x - eye[0], y - eye[1]
            if math.sqrt(dx * dx + dy * dy) * 10 > group[4]:
                continue
        if left <= 0:
            return -1, left, nobody
        offset = (group[0], group[1], group[2], group[3])
        numbers = numbers_of(x, y, turn, thing[3], offset, groups.steps, groups.bins)
        # With fewer tries left a search has fewer rings, and is another one.
        whole = left >= (2 * rings - 1) * (2 * rings - 1)
        if not whole or table[_row(table, lane + pair % len(rows), numbers), 0] == 0:
            return pair, left, numbers
        left -= (2 * rings + 1) * (2 * rings + 1)
    return len(things) * len(rows), left, nobody


class Searched:
    """Cells that nothing was found around, in all their rings; who asks has always as many.

    A lane stands for all that goes into a hash beside the cell, and for the digests that are looked for.
    """

    def __init__(self) -> None:
        self.table = np.zeros((TABLE_ROWS, 5), np.int64)
        self._used = 0
        self._lanes: dict[object, int] = {}
        self._next_lane = 1

    def lane(self, name: object, count: int) -> int:
        """The first of `count` lanes that belong together; the same for the same name."""
        if name not in self._lanes:
            if len(self._lanes) >= LANES_LIMIT:
                self._lanes.clear()
            self._lanes[name] = self._next_lane
            self._next_lane += count
        return self._lanes[name]

    def add(self, lane: int, numbers: Numbers) -> None:
        """Nothing is around this cell."""
        if self._used >= FULL:
            self.table[:] = 0
            self._used = 0
        self._used += _add(self.table, lane, numbers)
