"""Memory of searches without a match, so that the same cells are not searched again.

A robot sees the same door ten times a second and would search around the same cells again. When it drives past the door
the searched region moves by a cell, and most of it is known already.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from phalanx.arrays import I64x1, I64x2, U64x1
from phalanx.kernel import kernel

TABLE_ROWS = 1 << 14
LANES_LIMIT = 1 << 16
TILE_BITS = 3  # a tile has 8 by 8 cells, each a bit

Numbers = tuple[int, int, int, int]
RINGS_MOST = 40


class Known(NamedTuple):
    """Hash tables of cells around which a whole search found nothing, and of single cells without a match."""

    table: I64x2  # (n, 5) lane, or 0 in a free row; x, y, bin, area
    tiles: I64x2  # (n, 6) likewise with x and y of a tile; and a bit for each of its cells
    used: I64x1  # (2,) rows in use of both tables


@lru_cache(maxsize=64)
def spiral(rings: int) -> tuple[tuple[int, int], ...]:
    """Return the (2 * rings + 1)^2 steps (dx, dy) of a square spiral outwards from (0, 0), ring after ring.

    Source: Encoded graphs §VI-B ("gradually done in a spiral manner").
    """
    steps = [(0, 0)]
    for ring in range(1, rings + 1):
        side = range(-ring, ring)
        steps += [(ring, i + 1) for i in side]
        steps += [(-i - 1, ring) for i in side]
        steps += [(-ring, -i - 1) for i in side]
        steps += [(i + 1, -ring) for i in side]
    return tuple(steps)


SPIRAL = np.array(spiral(RINGS_MOST), np.int64)


@kernel
def row_of(table: I64x2, lane: int, numbers: Numbers) -> int:
    """Return the row of a cell in a hash table, or the free row for it."""
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
def _add(table: I64x2, lane: int, numbers: Numbers) -> bool:
    """Insert a cell into a table; return True if it is new."""
    row = row_of(table, lane, numbers)
    is_new = table[row, 0] == 0
    table[row, 0] = lane
    for k in range(4):
        table[row, 1 + k] = numbers[k]
    return bool(is_new)


@kernel
def keep(known: Known, lane: int, numbers: Numbers) -> None:
    """Remember that a search around this cell found nothing; clear the table first if it is nearly full."""
    if known.used[0] >= len(known.table) * 3 // 4:
        known.table[:] = 0
        known.used[0] = 0
    known.used[0] += _add(known.table, lane, numbers)


@kernel
def tiles_around(numbers: Numbers, rings: int) -> tuple[int, int, int, int]:
    """Return (x and y of the first tile, number of tiles along x, along y) that cover the rings around a cell."""
    x, y = (numbers[0] - rings) >> TILE_BITS, (numbers[1] - rings) >> TILE_BITS
    return x, y, ((numbers[0] + rings) >> TILE_BITS) - x + 1, ((numbers[1] + rings) >> TILE_BITS) - y + 1


@kernel
def untried(known: Known, lane: int, numbers: Numbers, rings: int) -> tuple[U64x1, I64x1, I64x1]:
    """Return (x and y of each untried cell in eight bytes, their indices on the spiral, bits of the tiles if all fail).

    The bits are those of the tiles of `tiles_around`, with all cells of the rings marked as tried.
    """
    first_x, first_y, wide, high = tiles_around(numbers, rings)
    bits = np.zeros(wide * high, np.int64)
    for k in range(len(bits)):
        row = row_of(known.tiles, lane, (first_x + k % wide, first_y + k // wide, numbers[2], numbers[3]))
        if known.tiles[row, 0] != 0:
            bits[k] = known.tiles[row, 5]
    cells = (2 * rings + 1) * (2 * rings + 1)
    words, places, count = np.empty(cells, np.uint64), np.empty(cells, np.int64), 0
    for k in range(cells):
        x, y = numbers[0] + SPIRAL[k, 0], numbers[1] + SPIRAL[k, 1]
        tile = ((y >> TILE_BITS) - first_y) * wide + (x >> TILE_BITS) - first_x
        bit = np.int64(1) << np.int64((y & 7) * 8 + (x & 7))
        if bits[tile] & bit == 0:
            bits[tile] |= bit
            words[count] = np.uint64(x & 0xFFFFFFFF) | np.uint64(y & 0xFFFFFFFF) << np.uint64(32)
            places[count] = k
            count += 1
    return words[:count], places[:count], bits


@kernel
def keep_tiles(known: Known, lane: int, numbers: Numbers, rings: int, bits: I64x1) -> None:
    """Remember that no cell in these rings matches; `bits` are from `untried`."""
    first_x, first_y, wide, _ = tiles_around(numbers, rings)
    if known.used[1] + len(bits) >= len(known.tiles) * 3 // 4:
        known.tiles[:] = 0
        known.used[1] = 0
    for k in range(len(bits)):
        tile = (first_x + k % wide, first_y + k // wide, numbers[2], numbers[3])
        known.used[1] += _add(known.tiles, lane, tile)
        known.tiles[row_of(known.tiles, lane, tile), 5] = bits[k]


class SearchMemory:
    """Memory of the searches of one mission that found nothing.

    A lane is a number for all inputs of a search except the cell: the other hashed data and the wanted digests.
    """

    def __init__(self, rows: int = TABLE_ROWS) -> None:
        table, tiles = np.zeros((rows, 5), np.int64), np.zeros((2 * rows, 6), np.int64)
        self.known = Known(table, tiles, np.zeros(2, np.int64))
        self._lanes: dict[object, int] = {}
        self._next_lane = 1

    def lane(self, name: object, count: int) -> int:
        """Return the first of `count` consecutive lanes for a name; the same name gives the same lanes."""
        if name not in self._lanes:
            if len(self._lanes) >= LANES_LIMIT:
                self._lanes.clear()
            self._lanes[name] = self._next_lane
            self._next_lane += count
        return self._lanes[name]
