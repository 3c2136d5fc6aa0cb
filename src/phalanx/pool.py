"""Memory for rows of bytes: pages that take memory only once they are written, and a pool of rows to borrow.

Of a thousand simulated robots only a few send or receive a request at any moment. A row for each robot would take
memory for all of them and would rarely be in a cache. A pool lends the row that was returned last and leaves the others
untouched.
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

LINE_BYTES = 64  # cache line of the processor
SMALL_BYTES = 1 << 20
PAGE_BYTES = mmap.PAGESIZE
NO_ROW = -1


def sparse(*shape: int) -> NDArray[np.uint8]:
    """Return zeroed bytes that take memory page by page, and only where something was written.

    numpy asks for pages of 2 MB where it can, so rows that are used in part would take memory in full.
    Raises: MemoryError: the address space has no room.
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
    """Return `size` in bytes, rounded up to whole cache lines."""
    return -(-size // LINE_BYTES) * LINE_BYTES


class Pool(NamedTuple):
    """A pool of rows; it has a row for each borrower, so it never runs out."""

    rows: U8x2  # (P, R)
    free: I32x1  # (P,), stack of the free rows' numbers, the next one to lend on top
    left: I64x1  # (1,), number of free rows


pack = bundled(Pool)


def make_pool(borrowers: int, size: int) -> Pool:
    """Return a pool of rows of `size` bytes for at most `borrowers` borrowers at once."""
    free = np.arange(borrowers - 1, -1, -1, dtype=np.int32)
    return pack(Pool(sparse(borrowers, size), free, np.array([borrowers], np.int64)))


@kernel
def borrow(pool: Pool) -> int:
    """Return the number of a free row, which still has the bytes of its last borrower."""
    pool.left[0] -= 1
    return int(pool.free[pool.left[0]])


@kernel
def give_back(pool: Pool, row: int) -> None:
    """Return a row to the pool; its bytes stay as they are."""
    pool.free[pool.left[0]] = row
    pool.left[0] += 1
