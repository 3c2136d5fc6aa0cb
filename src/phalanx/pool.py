"""Where rows of bytes lie: in pages that take memory only once they are written, and in rows that are lent.

Of a thousand robots a handful show or hear a request at any moment. With a row each of their own, all rows would be
memory, and cold; of rows that are lent the one given back last is lent next, and the others are never touched.
"""

from __future__ import annotations

import contextlib
import math
import mmap
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import I32x1, I64x1, U8x2
from phalanx.bundle import bundled
from phalanx.kernel import kernel

LINE_BYTES = 64  # of a processor's caches
SMALL_BYTES = 1 << 20
PAGE_BYTES = mmap.PAGESIZE
NO_ROW = -1


def sparse(*shape: int) -> NDArray[np.uint8]:
    """Return zeroed bytes that take memory only by the page, and only where something was written.

    numpy asks for pages of 2 MB where it can: of rows that are used in part, all would be memory.
    Raises: MemoryError: there is no room for so many addresses.
    """
    size = math.prod(shape)
    if size < SMALL_BYTES:
        return np.zeros(shape, np.uint8)
    try:
        pages = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError as error:
        raise MemoryError(f"{size} bytes") from error
    with contextlib.suppress(OSError):  # a kernel without huge pages
        pages.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(pages, np.uint8).reshape(shape)


def lines(size: int) -> int:
    """Return the least multiple of a cache line's length that is not below `size`, in bytes."""
    return -(-size // LINE_BYTES) * LINE_BYTES


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
