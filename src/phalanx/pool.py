"""Rows of bytes that are lent while they are needed.

Of a thousand robots a handful show or hear a request at any moment. With a row each of their own, all rows would be
memory, and cold; of rows that are lent the one given back last is lent next, and the others are never touched.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phalanx.arrays import I32x1, I64x1, U8x2
from phalanx.bundle import bundled
from phalanx.kernel import kernel
from phalanx.pages import sparse

NO_ROW = -1


class Pool(NamedTuple):
    """As many rows as there can be borrowers: there is always one left."""

    rows: U8x2  # (P, R)
    free: I32x1  # (P,), those that nobody has, the next at the end
    left: I64x1  # (1,), how many those are


pack = bundled(Pool)


def make_pool(borrowers: int, size: int) -> Pool:
    """Rows of `size` bytes for so many borrowers at once."""
    free = np.arange(borrowers - 1, -1, -1, dtype=np.int32)
    return pack(Pool(sparse(borrowers, size), free, np.array([borrowers], np.int64)))


@kernel
def lend(pool: Pool) -> int:
    """A row, by its number; what is in it is anybody's last."""
    pool.left[0] -= 1
    return int(pool.free[pool.left[0]])


@kernel
def give_back(pool: Pool, row: int) -> None:
    """The row is free again; its bytes stay until it is lent next."""
    pool.free[pool.left[0]] = row
    pool.left[0] += 1
