"""Remember fruitless searches, so that the same cells are not searched again.

A robot that looks at the same door ten times a second would search around the same cells again; one that drives past
it, around the next cell, of whose surroundings it knows all but an edge.
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
    """Cells that nothing is around, and cells that nothing is in."""

    table: I64x2  # (n, 5) lane, 0 where a row is free; x, y, bin, area
    tiles: I64x2  # (n, 6) likewise, x and y of tiles, and the bits of their cells
    used: I64x1  # (2,) rows of both


@lru_cache(maxsize=64)
def spiral(rings: int) -> tuple[tuple[int, int], ...]:
    """Steps (dx, dy) outwards from (0, 0), ring after ring, (2 * rings + 1)^2 of them.

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
    """Return the row of this cell in the hash table, or the free row for it."""
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
    """Puts a cell into the table; whether it is new."""
    row = row_of(table, lane, numbers)
    is_new = table[row, 0] == 0
    table[row, 0] = lane
    for k in range(4):
        table[row, 1 + k] = numbers[k]
    return bool(is_new)


@kernel
def keep(known: Known, lane: int, numbers: Numbers) -> None:
    """Nothing is around this cell."""
    if known.used[0] >= len(known.table) * 3 // 4:
        known.table[:] = 0
        known.used[0] = 0
    known.used[0] += _add(known.table, lane, numbers)


@kernel
def tiles_around(numbers: Numbers, rings: int) -> tuple[int, int, int, int]:
    """(x and y of the first, how many along x, along y) of the tiles that have cells in so many rings."""
    x, y = (numbers[0] - rings) >> TILE_BITS, (numbers[1] - rings) >> TILE_BITS
    return x, y, ((numbers[0] + rings) >> TILE_BITS) - x + 1, ((numbers[1] + rings) >> TILE_BITS) - y + 1


@kernel
def untried(known: Known, lane: int, numbers: Numbers, rings: int) -> tuple[U64x1, I64x1, I64x1]:
    """(x and y of each cell around that was not tried, in eight bytes; their places on the spiral; all tiles' bits)."""
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
    """Nothing is in these cells: `bits` as `untried` has them."""
    first_x, first_y, wide, _ = tiles_around(numbers, rings)
    if known.used[1] + len(bits) >= len(known.tiles) * 3 // 4:
        known.tiles[:] = 0
        known.used[1] = 0
    for k in range(len(bits)):
        tile = (first_x + k % wide, first_y + k // wide, numbers[2], numbers[3])
        known.used[1] += _add(known.tiles, lane, tile)
        known.tiles[row_of(known.tiles, lane, tile), 5] = bits[k]


class Searched:
    """Cells in which one mission's searches found nothing.

    A lane stands for all that goes into a hash beside the cell, and for the digests that are looked for.
    """

    def __init__(self, rows: int = TABLE_ROWS) -> None:
        table, tiles = np.zeros((rows, 5), np.int64), np.zeros((2 * rows, 6), np.int64)
        self.known = Known(table, tiles, np.zeros(2, np.int64))
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
