"""Kernels for test_violations.py: the line with a violation ends with its mark."""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np

from phalanx.arrays import I64x1, I64x2, I64x3, Records, U8x1
from phalanx.bundle import bundled
from phalanx.kernel import kernel, reads_peer
from phalanx.wire.fields import get_u16, get_u32, get_u64, move, put_u16, put_u32, put_u64, same

CELL = np.dtype([("count", "i8"), ("part", "f8", 3), ("grid", "u1", (2, 4))], align=True)
TABLE = np.arange(4)


class Queue(NamedTuple):
    row: I64x1
    cells: Annotated[Any, Records(CELL)]


pack = bundled(Queue)


@kernel
def element(a: I64x1, i: int) -> int:
    return a[i]  # index


@kernel
def element_stored(a: I64x1, i: int) -> None:
    a[i] = 5  # index


@kernel
def element_augmented(a: I64x1, i: int) -> None:
    a[i] += 5  # index


@kernel
def first_axis(a: I64x2, i: int) -> int:
    return a[i, 0]  # index


@kernel
def last_axis(a: I64x2, i: int) -> int:
    return a[0, i]  # index


@kernel
def row(a: I64x2, i: int) -> int:
    part = a[i]  # index
    return part[0]


@kernel
def middle_axis(a: I64x3, i: int) -> int:
    part = a[0, i, 1:]  # index
    return part[0]


@kernel
def behind(a: I64x1) -> int:
    return a[-7]  # index


@kernel
def behind_a_slice(a: I64x1, i: int) -> int:
    return a[:2][i]  # index


@kernel
def of_an_empty_slice(a: I64x1) -> int:
    return a[6:][0]  # index


@kernel
def constant(i: int) -> int:
    return TABLE[i]  # index


@kernel
def swapped(a: I64x1, i: int) -> None:
    a[0], a[i] = a[i], a[0]  # index


@kernel
def in_a_condition(a: I64x1, i: int) -> int:
    while a[0] < 0 or a[i] > 2:  # index
        return 1
    return 2


@kernel
def item(i: int) -> int:
    return (4, 5, 6)[i]  # index


@kernel
def record(q: Queue, i: int) -> int:
    return q.cells[i].count  # index


@kernel
def record_stored(q: Queue, i: int) -> None:
    q.cells[i].count = 7  # index


@kernel
def part_of_a_record(q: Queue, i: int) -> float:
    return q.cells[0].part[i]  # index


@kernel
def grid_of_a_record(q: Queue, i: int) -> int:
    return int(q.cells[1].grid[1, i])  # index


@kernel
def row_of_a_bundle(q: Queue, i: int) -> int:
    return q.row[i]  # index


@kernel
def made(i: int) -> float:
    a = np.zeros(3)
    return a[i]  # index


@kernel
def loaded_16(a: U8x1, i: int) -> int:
    return get_u16(a, i)  # index


@kernel
def loaded_32(a: U8x1, i: int) -> int:
    return get_u32(a, i)  # index


@kernel
def loaded_64(a: U8x1, i: int) -> int:
    return get_u64(a, i)  # index


@kernel
def stored_16(a: U8x1, i: int) -> None:
    put_u16(a, i, 1)  # index


@kernel
def stored_32(a: U8x1, i: int) -> None:
    put_u32(a, i, 1)  # index


@kernel
def stored_64(a: U8x1, i: int) -> None:
    put_u64(a, i, 1)  # index


@kernel
def moved_from(a: U8x1, i: int) -> None:
    move(a, 0, a, i, 4)  # index


@kernel
def moved_to(a: U8x1, i: int) -> None:
    move(a, i, a, 0, 4)  # index


@kernel
def moved_too_much(a: U8x1, i: int) -> None:
    move(a, 0, a, 0, 7 + abs(i))  # index


@kernel
def compared(a: U8x1, i: int) -> bool:
    return same(a, i, a, 0, 3)  # index


@kernel
def shifted(i: int) -> int:
    return 1 << (i if i < 0 else i + 64)  # index


@kernel
def rows_of_other_lengths(a: I64x2, b: I64x1, i: int) -> None:
    a[0] = b  # shape


@kernel
def slices_of_other_lengths(b: I64x1, i: int) -> None:
    b[0:2] = b[2:5]  # shape


@kernel
def blocks_of_other_lengths(a: I64x2, i: int) -> None:
    a[0:1] = a[1:]  # shape


@kernel
def negative_length(i: int) -> int:
    return len(np.zeros(-1 - abs(i)))  # size


@kernel
def divided(i: int, zero: int) -> int:
    return i // zero  # divisor


@kernel
def remainder(i: int, zero: int) -> int:
    return i % zero  # divisor


@kernel
def element_divided(a: I64x1, i: int, zero: int) -> None:
    a[1] //= zero  # divisor


@kernel
def divided_by_a_constant(i: int) -> int:
    return i // 0  # divisor


@kernel
def lanes_divided(i: int, zero: int) -> np.uint64:
    return np.uint64(3) // np.uint64(zero)  # divisor


@kernel
def stepped(i: int, zero: int) -> int:
    for k in range(0, i, zero):  # divisor
        return k
    return 0


@kernel
def whole_of_nan(x: float) -> int:
    return int(x)  # number


@kernel
def rounded_nan(x: float) -> int:
    return round(x)  # number


@kernel
def floor_of_nan(x: float) -> int:
    return math.floor(x)  # number


@kernel
def ceiling_of_nan(x: float) -> int:
    return math.ceil(x * 1)  # number


@kernel
def too_much_at_once(i: int) -> int:
    return len(np.zeros(1 << 26))  # scratch


@kernel
def too_long(i: int) -> int:
    return len(np.zeros(1 << 60))  # size


@kernel
def too_much_in_axes(i: int) -> int:
    return len(np.zeros((1 << 20, 1 << 20, 1 << 20)))  # scratch


@kernel
def too_much_in_a_loop(i: int) -> int:
    for k in range(1 << 30):
        a = np.empty(1 << 16)  # scratch
        a[0] = k
    return 0


@kernel
def without_a_result(i: int) -> int:  # result
    while i == 123:
        return 0


@kernel
def deep(a: I64x1, i: int) -> int:
    b = np.zeros(5000)  # which is released
    return int(b[0]) + deeper(a, i)


@kernel
def deeper(a: I64x1, i: int) -> int:
    total = np.empty((40, 40))
    total[0, 0] = a[i] + element(a, 0)  # index
    return int(total[0, 0])


@kernel
@reads_peer(rejected=-3)
def reading(a: I64x1, i: int) -> int:
    b = np.zeros(20000)
    return element(a, i) + int(b[1])


@kernel
def after_reading(a: I64x1, i: int) -> int:
    c = np.full(3, 2.0)
    return reading(a, i) * 100 + int(c[1])


@kernel
def twice(a: I64x1, i: int) -> int:
    first = after_reading(a, i)
    return first + element(a, i)  # not here, but in `element`
