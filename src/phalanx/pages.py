"""Arrays of which only the pages that were written take memory."""

from __future__ import annotations

import contextlib
import math
import mmap

import numpy as np
from numpy.typing import NDArray

LINE_BYTES = 64  # of a processor's caches
SMALL_BYTES = 1 << 20
PAGE_BYTES = mmap.PAGESIZE


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
