"""Where arrays lie: in pages of 4 kB of which only those count that were written, or close together in large ones.

A processor remembers where some two thousand pages are, and looks up others in memory. Ten thousand robots in pages of
4 kB have thirty thousand.
"""

from __future__ import annotations

import contextlib
import math
import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

LINE_BYTES = 64  # of a processor's caches
SMALL_BYTES = 1 << 20
PAGE_BYTES = mmap.PAGESIZE
# A large page; arrays from so long on lie in these; and addresses are taken by so many.
LARGE_PAGE_BYTES, DENSE_BYTES, BLOCK_BYTES = 2 << 20, 1 << 17, 32 << 20


def sparse(*shape: int) -> NDArray[np.uint8]:
    """Zeroed bytes that take memory only by the page, and only where something was written.

    numpy asks for pages of 2 MB where it can: of rows that are used in part, all would be memory.
    Raises: MemoryError: there is no room for so many addresses.
    """
    size = math.prod(shape)
    if size < SMALL_BYTES:
        return np.zeros(shape, np.uint8)
    return _addresses(size, mmap.MADV_NOHUGEPAGE).reshape(shape)


def _addresses(size: int, advice: int) -> NDArray[np.uint8]:
    try:
        pages = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError as error:
        raise MemoryError(f"{size} bytes") from error
    with contextlib.suppress(OSError):  # where pages are of one kind, it is that
        pages.madvise(advice)
    return np.frombuffer(pages, np.uint8)


def lines(size: int) -> int:
    """So many bytes in whole lines of the processor's caches."""
    return -(-size // LINE_BYTES) * LINE_BYTES


def dense(shape: int | tuple[int, ...], dtype: Any = np.float64) -> NDArray[Any]:
    """A zeroed array of which all is used: it begins at a line, and large ones lie in pages of 2 MB side by side.

    Raises: MemoryError: there is no room for so many addresses.
    """
    kind, shape = np.dtype(dtype), (shape,) if isinstance(shape, int) else shape
    size = math.prod(shape) * kind.itemsize
    if size < DENSE_BYTES:
        return np.zeros(shape, kind)
    made: NDArray[Any] = _cut(size).view(kind).reshape(shape)
    return made


# Addresses from which arrays are cut, one behind the other; a block goes when it is used up and its arrays are gone.
_left: list[NDArray[np.uint8]] = []


def _cut(size: int) -> NDArray[np.uint8]:
    try:
        left = _left.pop()  # nobody else has it meanwhile: two threads may ask at once
    except IndexError:
        left = np.zeros(0, np.uint8)
    if size > len(left):
        made = _addresses(max(BLOCK_BYTES, lines(size)) + LARGE_PAGE_BYTES, mmap.MADV_HUGEPAGE)
        left = made[-made.ctypes.data % LARGE_PAGE_BYTES :]
    _left.append(left[lines(size) :])
    return left[:size]


def filled(shape: int | tuple[int, ...], value: Any, dtype: Any = np.float64) -> NDArray[Any]:
    """As `dense`, each number `value`, or those of an array of this shape."""
    made = dense(shape, dtype)
    made[...] = value
    return made
