"""Little-endian fields in rows of bytes, for kernels: the same bytes compiled and not.

`row` is always (n,) uint8 and `at` lies within it with the field's width to spare: callers check lengths first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phalanx.kernel import kernel

Row = NDArray[np.uint8]


@kernel
def get_u16(row: Row, at: int) -> int:
    """The u16 at `at`."""
    # int64 from the start: compiled, unsigned and signed integers would meet as a float.
    return np.int64(row[at]) | np.int64(row[at + 1]) << 8  # type: ignore[return-value]  # as good as an int


@kernel
def get_u32(row: Row, at: int) -> int:
    """The u32 at `at`."""
    low = np.int64(row[at]) | np.int64(row[at + 1]) << 8
    return low | np.int64(row[at + 2]) << 16 | np.int64(row[at + 3]) << 24  # type: ignore[return-value]


@kernel
def put_u16(row: Row, at: int, value: int) -> None:
    """`value`, 0..2^16-1, written at `at`."""
    row[at] = value & 0xFF
    row[at + 1] = (value >> 8) & 0xFF


@kernel
def put_u32(row: Row, at: int, value: int) -> None:
    """`value`, 0..2^32-1, written at `at`."""
    row[at] = value & 0xFF
    row[at + 1] = (value >> 8) & 0xFF
    row[at + 2] = (value >> 16) & 0xFF
    row[at + 3] = (value >> 24) & 0xFF


@kernel
def put_u64(row: Row, at: int, value: int) -> None:
    """`value`, 0..2^63-1, written at `at`."""
    put_u32(row, at, value & 0xFFFFFFFF)
    put_u32(row, at + 4, (value >> 32) & 0xFFFFFFFF)


@kernel
def copy(to: Row, to_at: int, source: Row, source_at: int, length: int) -> None:
    """`length` bytes copied; the rows may be the same when they are copied towards the front."""
    for k in range(length):
        to[to_at + k] = source[source_at + k]


@kernel
def same(one: Row, one_at: int, other: Row, other_at: int, length: int) -> bool:
    """Whether `length` bytes agree; not for secrets."""
    for k in range(length):
        if one[one_at + k] != other[other_at + k]:
            return False
    return True
