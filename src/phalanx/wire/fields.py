"""Access to little-endian fields in rows of bytes, for kernels: the same bytes compiled and uncompiled.

`row` is always (n,) uint8, in C order. Callers check lengths first, so a field at `at` lies within the row; each
access is still checked against the row's length, compiled and uncompiled. Integers are returned as int64, because the
difference of a signed and an unsigned number would be a float.
"""

from __future__ import annotations

import sys
from typing import Any, SupportsInt, TypeAlias

import numpy as np

from phalanx.arrays import U8x1
from phalanx.kernel import intrinsic, kernel

from .record import LARGEST_F32, LARGEST_NUMBER, Field
from .table import OUTPUT, STATE

assert sys.byteorder == "little", "kernels need a little-endian processor"
Row: TypeAlias = U8x1

U32_BYTES, F32_BYTES = (Field("", kind, "").size for kind in ("u32", "f32"))
OUTPUT_HEAD_BYTES, OUTPUT_LENGTH = OUTPUT.size, OUTPUT.at("payload")
ID, TIME = map(STATE.at, ("id", "t"))  # offsets, the same in every message of a controller
_INT64: Any = np.int64


def row(raw: bytes) -> Row:
    """Copy bytes into a writable row for kernels."""
    return np.frombuffer(bytearray(raw), np.uint8)


@intrinsic("whole")
def whole(value: SupportsInt) -> int:
    """Return `value` truncated to an integer."""
    made: int = _INT64(value)
    return made


def _piece(row: Row, at: int, length: int) -> Row:
    """Return a slice of a row. Raises: IndexError: it is not within the row, or `at` is negative."""
    if not 0 <= at <= len(row) - length:
        raise IndexError(f"{length} bytes at {at} are outside an array of {len(row)}")
    return row[at : at + length]


@kernel
def get_i8(row: Row, at: int) -> int:
    """Return the signed byte at `at`."""
    value = whole(row[at])
    return value - 256 if value >= 128 else value


@intrinsic("load_16")
def get_u16(row: Row, at: int) -> int:
    """Return the u16 at `at`."""
    return int(_piece(row, at, 2).view("<u2")[0])


@intrinsic("load_32")
def get_u32(row: Row, at: int) -> int:
    """Return the u32 at `at`."""
    return int(_piece(row, at, 4).view("<u4")[0])


@intrinsic("load_64")
def get_u64(row: Row, at: int) -> int:
    """Return the u64 at `at`; negative from 2^63 on, a time that no clock reaches."""
    return int(_piece(row, at, 8).view("<i8")[0])


@kernel
def get_f32(row: Row, at: int) -> float:
    """Return the f32 at `at` as float64, exactly."""
    return np.float64(np.uint32(get_u32(row, at)).view(np.float32))


@kernel
def are_fine(row: Row, at: int, count: int) -> bool:
    """Return whether `count` f32 from `at` on are finite and at most 10^6 in magnitude.

    One NaN in a broadcast would spread to every neighbour's command, and differs between compilers.
    """
    for k in range(count):
        value = get_f32(row, at + F32_BYTES * k)
        if not (-LARGEST_NUMBER <= value <= LARGEST_NUMBER):
            return False
    return True


@kernel
def are_finite(row: Row, at: int, count: int) -> bool:
    """Return whether `count` f32 from `at` on are finite."""
    for k in range(count):
        value = get_f32(row, at + F32_BYTES * k)
        if not (-LARGEST_F32 <= value <= LARGEST_F32):
            return False
    return True


@intrinsic("store_16")
def put_u16(row: Row, at: int, value: int) -> None:
    """Write the lowest 16 bits of `value` at `at`."""
    _piece(row, at, 2).view("<u2")[0] = int(value) & 0xFFFF


@intrinsic("store_32")
def put_u32(row: Row, at: int, value: int) -> None:
    """Write the lowest 32 bits of `value` at `at`."""
    _piece(row, at, 4).view("<u4")[0] = int(value) & 0xFFFFFFFF


@intrinsic("store_64")
def put_u64(row: Row, at: int, value: int) -> None:
    """Write the lowest 64 bits of `value` at `at`."""
    _piece(row, at, 8).view("<u8")[0] = int(value) & 0xFFFFFFFFFFFFFFFF


@kernel
def put_f32(row: Row, at: int, value: float) -> None:
    """Write `value`, rounded once to f32; callers pass only finite values."""
    put_u32(row, at, whole(np.float32(value).view(np.uint32)))


@intrinsic("move")
def move(to: Row, to_at: int, source: Row, source_at: int, length: int) -> None:
    """Copy `length` bytes, 0 or more; both may lie in the same row, and overlap."""
    _piece(to, to_at, length)[:] = _piece(source, source_at, length).copy()


@kernel
def put_head(out: Row, at: int, entry: int, length: int, kind: int, rob_id: int, t_ms: int) -> int:
    """Write the header of a controller's `output`, and the message's kind, id and time; return the message's offset."""
    out[at] = entry
    put_u16(out, at + OUTPUT_LENGTH, length)
    begin = at + OUTPUT_HEAD_BYTES
    out[begin] = kind
    put_u16(out, begin + ID, rob_id)
    put_u64(out, begin + TIME, t_ms)
    return begin


@kernel
def copy(to: Row, to_at: int, source: Row, source_at: int, length: int) -> None:
    """Copy `length` bytes, none if it is negative; both may lie in the same row."""
    if length > 0:
        move(to, to_at, source, source_at, length)


@intrinsic("equal")
def same(one: Row, one_at: int, other: Row, other_at: int, length: int) -> bool:
    """Return whether `length` bytes, 0 or more, are equal; not constant-time, so not for secrets."""
    return bool((_piece(one, one_at, length) == _piece(other, other_at, length)).all())


@intrinsic("prefetch")
def prefetch(rows: Any, i: int, begin: int, length: int) -> None:
    """Prefetch `length` bytes of rows[i], from byte `begin` on, into the processor's cache."""
