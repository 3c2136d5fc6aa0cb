"""Numbers in rows of bytes, as arithmetic needs them: the same bits compiled and uncompiled.

Whole numbers come out as int64, as from `phalanx.wire.fields`: numba makes a float of a signed and an unsigned number's
difference.
"""

from __future__ import annotations

from typing import Any, SupportsInt, TypeAlias

import numpy as np
from numpy.typing import NDArray

from phalanx.kernel import kernel
from phalanx.wire.fields import get_u32, put_u32
from phalanx.wire.record import LARGEST_NUMBER

Row: TypeAlias = NDArray[np.uint8]
Params: TypeAlias = NDArray[np.float64]

U32_BYTES = F32_BYTES = 4
_INT64: Any = np.int64


@kernel
def whole(value: SupportsInt) -> int:
    """`value`, cut to a whole number."""
    made: int = _INT64(value)
    return made


@kernel
def get_i8(row: Row, at: int) -> int:
    """The signed byte at `at`."""
    value = whole(row[at])
    return value - 256 if value >= 128 else value


@kernel
def get_u64(row: Row, at: int) -> int:
    """The u64 at `at`; negative from 2^63 on, which no clock of ours reaches."""
    return get_u32(row, at) | get_u32(row, at + U32_BYTES) << 32


@kernel
def get_f32(row: Row, at: int) -> float:
    """The f32 at `at`, exactly, as float64."""
    return np.float64(np.uint32(get_u32(row, at)).view(np.float32))


@kernel
def put_f32(row: Row, at: int, value: float) -> None:
    """`value`, rounded once to f32, is written; the caller keeps it finite."""
    put_u32(row, at, whole(np.float32(value).view(np.uint32)))


@kernel
def are_fine(row: Row, at: int, count: int) -> bool:
    """Whether `count` f32 from `at` on are finite and no larger than 10^6.

    One NaN in a broadcast would spread to every neighbour's command, and differs between compilers.
    """
    for k in range(count):
        value = get_f32(row, at + F32_BYTES * k)
        if not (-LARGEST_NUMBER <= value <= LARGEST_NUMBER):
            return False
    return True
