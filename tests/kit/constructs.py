# ruff: noqa: A002, PIE790, RET501, RET504, RET505, RUF021, RUF057, RUF060 - constructs on purpose
"""Kernels for test_constructs.py: each is one construct of the subset, or what C might do otherwise than Python."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

import numpy as np

from phalanx.arrays import (
    BOOLx1,
    F32x1,
    F64x1,
    F64x2,
    I32x1,
    I64x1,
    I64x2,
    I64x3,
    Records,
    U8x1,
    U8x2,
    U8x3,
    U16x1,
    U64x1,
)
from phalanx.bundle import bundled
from phalanx.kernel import kernel
from phalanx.wire.fields import get_u16, get_u32, get_u64, move, prefetch, put_u16, put_u32, put_u64, same

# Inputs beside random ones, by the name of a kernel; only these if the second is true.
GIVEN: dict[str, tuple[list[tuple[Any, ...]], bool]] = {}
EDGES = [0, 1, -1, 2, -2, 3, 7, -7, 2**31, -(2**31), 2**53 + 1, 2**62, 2**63 - 1, -(2**63), -(2**63) + 1]
LIMIT = 7
HALF = -0.5
PAIR = (3, 4.5)
SHAPE = (2, (3, 4))
TABLE = np.array([5, -6, 7], np.int64)
GRID = np.arange(12, dtype=np.float64).reshape(3, 4)[:, ::2]  # not in C order
EMPTY = np.zeros(0)
LEAST, GREATEST = -(2**63), 2**63 - 1
LANE = np.uint64(1 << 63)
THIRD = np.float32(1 / 3)


def given(*rows: tuple[Any, ...], only: bool = False) -> Callable[[Any], Any]:
    def mark(function: Any) -> Any:
        GIVEN[function.__name__] = list(rows), only
        return function

    return mark


def pairs(values: list[Any]) -> list[tuple[Any, Any]]:
    return [(a, b) for a in values for b in values]


class Point(NamedTuple):
    x: float
    y: float


class Placed(NamedTuple):
    place: Point
    name: int
    row: I64x1


INNER = np.dtype(
    [("flag", "?"), ("small", "u1"), ("word", "u2"), ("count", "i8"), ("part", "f8", 3), ("cells", "u1", (2, 4))],
    align=True,
)

RECORD = np.dtype((np.record, INNER))


class Inner(NamedTuple):
    rows: Annotated[Any, Records(INNER, 2)]
    scale: float
    size: tuple[int, float]


class Outer(NamedTuple):
    values: F64x1
    inner: Inner
    most: int
    is_open: bool


pack_inner, pack_outer = bundled(Inner), bundled(Outer)


# --- numbers ---


@kernel
def arithmetic(a: int, b: int) -> tuple[int, int, int]:
    return a + b, a - b, a * b


@kernel
def arithmetic_of_floats(a: float, b: float) -> tuple[float, float, float]:
    return a + b, a - b, a * b


@kernel
def int_at_most_float(a: int, x: float) -> bool:
    return a <= x


@given(*pairs(EDGES))
@kernel
def floor_divided(a: int, b: int) -> tuple[int, int]:
    return a // b, a % b


@kernel
def floor_divided_floats(a: float, b: float) -> tuple[float, float]:
    return a // b, a % b


@kernel
def divided(a: int, b: int) -> float:
    return a / b


@kernel
def divided_floats(a: float, b: float) -> float:
    return a / b


@kernel
def divided_by_constants(a: int) -> tuple[int, int, int, int, int, int]:
    return a // 7, a % 7, a // -7, a % -7, a // -1, a % -1


@kernel
def divided_floats_by_constants(a: float) -> tuple[float, float, float, float]:
    return a // 0.1, a % 0.1, a // -2.5, a % -2.5


@kernel
def whole_and_float(a: int, b: float) -> tuple[float, float, float, float, bool]:
    return a + b, b - a, a * b, b / 3, a < b


@given(*[(a, n) for a in EDGES for n in (0, 1, 5, 31, 32, 40, 62, 63)], only=True)
@kernel
def shifted(a: int, n: int) -> tuple[int, int]:
    return a << n, a >> n


@given(*[(a,) for a in EDGES])
@kernel
def shifted_by_constants(a: int) -> tuple[int, int, int]:
    return a << 3, a >> 3, a >> 63


@given(*pairs(EDGES))
@kernel
def bits_of_ints(a: int, b: int) -> tuple[int, int, int, int]:
    return a & b, a | b, a ^ b, ~a


@kernel
def signs(a: int, b: float) -> tuple[int, int, float, float]:
    return -a, +a, -b, +b


@kernel
def powers_of_constants(a: float) -> tuple[float, int, float]:
    return a * 2.0**0.5, 2**40, 10**-2


@kernel
def bounds_of_64_bits() -> tuple[int, int, int, int]:
    return LEAST, GREATEST, -9223372036854775808, 2**63 - 1


@kernel
def literals() -> tuple[float, float, float, float, float, float]:
    return 1e-320, 0.1, 1e308 * 10, -0.0, 12345678901234567890.0, HALF


@kernel
def bool_as_number(a: bool, b: int) -> tuple[int, float, int, int]:
    return a + b, a * 0.5, (a << 40) + 1, b - a


@given((True,), (False,))
@kernel
def bool_shifted(a: bool) -> tuple[int, int]:
    return a >> 40, a << 62


@kernel
def bool_algebra(a: bool, b: bool) -> tuple[bool, bool, bool, bool, bool, bool]:
    return a & b, a | b, a ^ b, a and not b, a or not b, not (a and b)


@kernel
def truth_of_numbers(a: int, b: float, c: bool) -> tuple[bool, bool, bool, bool]:
    one = True if a and not b else False
    two = True if b or (c and a) else False
    return one, two, bool(a), bool(b)


@given(*pairs(EDGES))
@kernel
def compared(a: int, b: int) -> tuple[bool, bool, bool, bool, bool, bool]:
    return a < b, a <= b, a > b, a >= b, a == b, a != b


@kernel
def compared_floats(a: float, b: float) -> tuple[bool, bool, bool, bool, bool, bool]:
    return a < b, a <= b, a > b, a >= b, a == b, a != b


@kernel
def compared_in_chains(a: int, b: float, c: int) -> tuple[bool, bool, bool]:
    return 0 <= a < LIMIT, a < b <= c, a < b == c != 4


@kernel
def compared_in_chains_until_false(a: I64x1, b: int) -> bool:
    return 0 <= b < len(a) <= a[b] + 100


@kernel
def membership(a: int, b: float) -> tuple[bool, bool, bool, bool]:
    return a in (1, 2, 3), a not in (1, 2.5), b in (a, 0.5), a in ()


@kernel
def chosen(a: int, b: float) -> tuple[float, int]:
    return a if b > 0 else b, 1 if a else 2 if b else 3


@kernel
def extremes(a: int, b: float, c: float) -> tuple[float, float, float, float, float]:
    return min(a, b), max(a, b), min(b, c, 1.0), max(b, c, -0.0), min(max(b, 0.0), c)


@given(*pairs(EDGES))
@kernel
def extremes_of_ints(a: int, b: int) -> tuple[int, int, int]:
    return min(a, b), max(a, b, -1), min(a > 0, b)


@given((-(2**63), 0.0), (1, -0.0))
@kernel
def absolute(a: int, b: float) -> tuple[int, float, int]:
    return abs(a), abs(b), abs(a > 3)


LARGE = [9.2233720368547e18, 9.223372036854774784e18, -9.223372036854775808e18, 4503599627370497.5]
BOTH_SIDES = [x + y for x in range(-4, 5) for y in (-0.5, -0.25, 0.0, 0.5)]


@given(*[(x,) for x in [*LARGE, *BOTH_SIDES, float("nan"), float("inf"), -0.0]], only=True)
@kernel
def to_whole(a: float) -> tuple[int, int, int, int]:
    return int(a), round(a), math.floor(a), math.ceil(a)


@given((2**53 + 1,), (2**62 + 1,))
@kernel
def rounded_ints(a: int) -> tuple[int, int, int, float]:
    return round(a), math.floor(a), int(a), float(a)


@kernel
def conversions(a: int, b: bool, c: float) -> tuple[float, int, bool, bool, float]:
    return float(a), int(b), bool(c), bool(a), float(b)


@kernel
def functions_of_math(a: float) -> tuple[float, float, float, bool, bool]:
    return math.sqrt(abs(a)), math.sin(0.5), math.cos(1.5), math.isnan(a), math.isfinite(a)


@kernel
def functions_of_numpy(a: float) -> tuple[float, float, float, float, bool, bool]:
    return np.rint(a), np.floor(a), np.ceil(a), np.sqrt(abs(a)), np.isnan(a), np.isfinite(a)


@kernel
def float32_arithmetic(a: np.float32, b: np.float32) -> tuple[float, float, float, float, float]:
    c = a * b + a
    return float(c), float((a + b) * b - a), float(abs(a)), float(min(a, b) * b), float(-a / THIRD)


@kernel
def float32_and_constants(a: np.float32) -> tuple[float, float, bool, bool]:
    return float(a * 0.1 + 3), float(THIRD * a), a < 0.1, a == THIRD


@given((0.1,), (1e-50,), (16777217.0,), (0.0,))
@kernel
def float32_of_float(a: float) -> float:
    return float(np.float32(a))


@given((2**53 + 1,), (16777217,), (2**60 + 2**36 + 1,))
@kernel
def float32_of_int(a: int) -> float:
    return float(np.float32(a))


@kernel
def views_of_32_bits(a: np.float32, b: np.uint32) -> tuple[int, float, int]:
    return int(a.view(np.uint32)), float(b.view(np.float32)), int((b & np.uint32(255)) ^ b)


@kernel
def lanes(a: np.uint64, b: np.uint64) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64, np.uint64]:
    return a + b, a * b, a - b, (a ^ b) | (~a & b), a // (b | np.uint64(1))


@kernel
def lanes_shifted(a: np.uint64) -> tuple[np.uint64, np.uint64, np.uint64, bool, bool]:
    return (a << np.uint64(7)) | (a >> np.uint64(57)), a >> 3, a & 255, a > LANE, a == 1


@kernel
def lanes_changed(a: U64x1, b: np.uint64, i: int) -> np.uint64:
    a[i] ^= b
    a[0] += 1
    a[1:3] = LANE
    a[4] = 7
    c = a[i]
    c >>= 3
    return min(c, b) + np.uint64(i)


@kernel
def lanes_to_numbers(a: np.uint64, b: int) -> tuple[int, float, np.uint64]:
    return int(a >> np.uint64(1)), float(a), np.uint64(abs(b))


# --- elements that are narrower than what is computed with ---


@kernel
def narrow_elements(a: U8x1, b: U16x1, c: I32x1, i: int, j: int) -> tuple[int, int, int, int, int]:
    return int(a[i]) - int(a[j]), int(b[i]) * int(b[j]), int(c[i]) * int(c[j]), -int(b[i]), int(a[i]) << 40


@kernel
def narrow_compared(a: U8x1, b: I32x1, i: int) -> tuple[bool, bool, bool]:
    return int(a[i]) - 300 < b[i], a[i] < -1, b[i] > a[i]


@kernel
def narrow_stored(a: U8x1, b: U16x1, i: int, x: int) -> None:
    a[i] = x & 255
    b[i] = x & 0xFFFF
    a[0] ^= 255
    b[1] //= 3
    a[i] = a[0]


@kernel
def narrow_in_loops(a: U16x1) -> int:
    product = 1
    for each in a:
        product = (product * int(each) + 1) % 1000003
    return product


@kernel
def float32_elements(a: F32x1, i: int, x: float) -> tuple[float, float]:
    a[i] = x
    a[1] = 0.1
    a[2] = 16777217
    return float(a[i]), float(a[1] * a[i])


@kernel
def flags(a: BOOLx1, i: int, x: float) -> tuple[bool, bool, int]:
    a[i] = x
    a[0] = not a[1]
    count = 0
    for each in a:
        if each:
            count += 1
    return a[i], np.any(a), count


@kernel
def records_with_narrow_fields(r: Annotated[Any, Records(INNER)], i: int, j: int) -> tuple[int, int, bool, int]:
    r[i].word = 65535
    product = int(r[i].word) * int(r[i].word)
    difference = int(r[i].small) - int(r[j].word)
    r[j].flag = i
    r[j].count += product
    return product, difference, r[j].flag, r[j].count


# --- the order in which things happen ---


@kernel
def noted(log: I64x1, what: int) -> int:
    log[0] += 1
    log[1] = log[1] * 10 + what
    return what


@kernel
def noted_bool(log: I64x1, what: int, truth: bool) -> bool:
    log[1] = log[1] * 10 + what
    return truth


@kernel
def noted_float(log: I64x1, what: float) -> float:
    log[2] += 1
    return what * log[2]


@kernel
def in_operands(log: I64x1) -> int:
    return log[1] + noted(log, 2) * log[1] - noted(log, 3)


@kernel
def in_arguments(log: I64x1) -> int:
    return noted(log, noted(log, 1) + noted(log, 2)) + max(log[1], noted(log, 4), log[0])


@kernel
def in_tuples(log: I64x1) -> tuple[int, int, int]:
    return log[1], noted(log, 2), log[1]


@kernel
def in_and(log: I64x1, a: bool, b: bool) -> bool:
    return noted_bool(log, 1, a) and noted_bool(log, 2, b) and noted_bool(log, 3, a)


@kernel
def in_or(log: I64x1, a: bool, b: bool) -> bool:
    return noted_bool(log, 1, a) or noted_bool(log, 2, b) or log[1] > 5


@kernel
def in_conditions(log: I64x1, a: int, b: float) -> int:
    if a and noted(log, 2) or b and noted(log, 3):
        return log[1]
    elif noted(log, 4) > 3 and not noted(log, 0):
        return log[1] + 1
    return 0


@kernel
def in_choices(log: I64x1, a: bool) -> int:
    return noted(log, 1) if noted_bool(log, 5, a) else noted(log, 2) + log[1]


@kernel
def in_chains(log: I64x1, a: int, b: int) -> bool:
    return noted(log, a % 4) < noted(log, b % 4) <= noted(log, 2) < noted(log, 3)


@kernel
def in_chains_with_elements(log: I64x1, a: int) -> bool:
    return log[1] <= a < noted(log, 3) + log[1] < 1000


@kernel
def in_memberships(log: I64x1) -> bool:
    return noted(log, 3) in (log[1], noted(log, 5))


@kernel
def in_indices(log: I64x1, a: I64x2) -> int:
    return a[noted(log, 1), noted(log, 2)] + log[noted(log, 0)]


@kernel
def in_slices(log: I64x1, a: I64x1) -> int:
    part = a[noted(log, 1) : noted(log, 4)]
    return len(part) + part[noted(log, 2)]


@kernel
def in_stores(log: I64x1, a: I64x1) -> None:
    a[noted(log, 1)] = noted(log, 2)
    a[log[0] % 3] = noted(log, 3) + log[0]


@kernel
def in_augmented_elements(log: I64x1) -> None:
    log[0] += noted(log, 3)
    log[1] = log[1] % 100
    log[log[0] % 3] += noted(log, 1)


@kernel
def in_augmented_records(log: I64x1, r: Annotated[Any, Records(INNER)]) -> None:
    r[log[0] % 3].count += noted(log, 2)
    r[noted(log, 1)].word = noted(log, 2) + r[0].count % 5


@kernel
def in_augmented_names(log: I64x1) -> int:
    x = log[0]
    x += noted(log, 1) + log[0]
    x -= log[0]
    return x


@kernel
def in_assignments(log: I64x1, a: I64x1) -> int:
    x, a[noted(log, 1)], y = noted(log, 2), noted(log, 3), log[1]
    return x * 1000 + y


@kernel
def in_keywords(log: I64x1) -> int:
    return ordered(c=noted(log, 1), a=noted(log, 2), b=log[1])


@kernel
def in_loops(log: I64x1) -> int:
    count = 0
    while noted(log, 1) and log[0] % 5:
        count += 1
        if count > 6:
            break
    return count


@kernel
def in_ranges(log: I64x1) -> int:
    count = 0
    for k in range(noted(log, 1), noted(log, 5) + log[0] * 0, noted(log, 2)):
        count += k
        noted(log, 3)
    return count


@kernel
def in_calls_for_nothing(log: I64x1) -> None:
    noted(log, 2)
    return nothing(log)


@kernel
def nothing(log: I64x1) -> None:
    log[0] += 7


@kernel
def of_loads_and_calls(log: I64x1, r: Annotated[Any, Records(INNER)], b: Outer) -> float:
    return b.values[0] + log[2] + noted_float(log, 2.0) + log[2] * noted_float(log, 3.0)


# --- names ---


@kernel
def reserved_words(int_: int, double: float, struct: I64x1) -> float:
    register, static, void, while_, end, returned, t0, y, z = 1, 2, 3, 4, 5, 6, 7, 8, 9
    auto = struct[0] + register + static + void + while_ + end + returned + t0 + y + z
    for volatile in range(3):
        auto += volatile
    return auto * double + int_


@kernel
def _hidden(_x: int, __y: int) -> int:
    _z, __ = _x + 1, __y + 2
    return _z * __


@kernel
def calls_hidden(_: int) -> int:
    _ += 1
    return _hidden(_, 3) + _


@kernel
def dropped(a: I64x2, i: int) -> int:
    _, x = a.shape
    for _ in range(3):
        x += i
    _ = a[i]
    return x


@kernel
def shadowed(LIMIT: int, max: int) -> int:
    TABLE = LIMIT + max
    return TABLE


@kernel
def documented(a: int) -> int:
    """Return a + 1; */ /* \\ %s {0} \"."""
    ...
    return a + 1


@kernel
def numbers_of_modules(i: int) -> tuple[int, float, float, int, int, int]:
    return LIMIT, HALF, PAIR[1], SHAPE[1][0], SHAPE[-2], PAIR[0]


@kernel
def arrays_of_modules(i: int) -> tuple[int, int, float, int, int]:
    return TABLE[i], TABLE[-1], GRID[i, 1], len(EMPTY) + TABLE.size, GRID.shape[1]


@kernel
def copies_of_constants(i: int, x: int) -> int:
    mine = TABLE.copy()
    mine[i] = x
    return mine[0] + mine[1] * 3 + TABLE[i]


@kernel
def kinds_that_grow(n: int) -> float:
    x = 1
    for k in range(n):
        x = x * 0.5 + k
    return x


@kernel
def annotated(a: int) -> float:
    x: float = a * 0.5
    y: int = a
    return x + y


# --- tuples ---


@kernel
def swapped(a: int, b: int, c: float) -> tuple[int, int, float]:
    a, b = b, a
    c, d = a * 0.5, c
    return a, b, c + d


@kernel
def rotated(a: int, b: int, c: int) -> tuple[int, int, int]:
    a, b, c = b + c, a, b - a
    return a, b, c


@kernel
def elements_swapped(a: I64x1, i: int, j: int) -> None:
    a[i], a[j] = a[j], a[i]
    a[0], a[1], a[2] = a[1], a[2], a[0]


@kernel
def index_and_element(a: I64x1, i: int) -> int:
    i, a[i] = a[i], 9
    return i


@kernel
def rows_swapped(a: I64x2, i: int, j: int) -> None:
    a[i], a[j] = a[j], a[i]  # both are views: as in numpy, one row is lost


@kernel
def records_swapped(r: Annotated[Any, Records(INNER)], i: int, j: int) -> None:
    r[i], r[j] = r[j], r[i]


@kernel
def pair_of(a: int, b: float) -> tuple[int, float]:
    return a, b


@kernel
def unpacked(a: int, b: float) -> tuple[float, int, float]:
    x, y = pair_of(a, b)
    (p, q), r = pair_of(a + 1, y), x
    return y, r, q + p


@kernel
def starred(a: int, b: float) -> tuple[int, int, float, float]:
    both = pair_of(a, b)
    return (1, *both, b)


@kernel
def starred_arguments(a: int, b: float) -> tuple[int, float]:
    return pair_of(*pair_of(a + 1, b))


@kernel
def several_targets(a: int, row: I64x1, i: int) -> int:
    b = row[i] = c = a + 1
    return b + c * 2 + row[i]


@kernel
def indexed_by_variables(i: int, a: float, b: float) -> tuple[float, int]:
    values, names = (a, b, 0.5), (4, 5, 6)
    return values[i], names[i] + names[-1] + (7, 8, 9)[i]


@kernel
def tuples_of_arrays(a: I64x1, b: I64x1, i: int) -> int:
    both = (a, b, a)
    both[i][0] = 77
    total = 0
    for each in both:
        total += each[0] + len(each)
    return total


@kernel
def nested(a: tuple[int, tuple[float, bool]], b: Point) -> tuple[tuple[float, float], tuple[bool, int]]:
    number, (real, truth) = a
    return (real, b.x), (truth, number + 1)


@kernel
def points(a: float, p: Point) -> Point:
    q = Point(a, p.y)
    r = Point(q.x + 1, y=q[1])
    return Point(*r) if a > 0 else Point(x=p.x, y=a)


@kernel
def named_tuples_with_arrays(p: Placed, x: int) -> Placed:
    p.row[1] = x
    return Placed(Point(p.place.y, p.place.x), p.name + p.row[0], p.row)


@kernel
def items_that_widen(a: int, b: bool) -> tuple[float, float]:
    pair = (a, b) if b else (1, 0.5)
    return pair


@kernel
def tuples_in_variables(a: int, n: int) -> tuple[int, float]:
    state = (a, 0.0)
    for k in range(n):
        state = (state[0] + k, state[1] + 0.5)
    return state


@kernel
def lengths(a: I64x2, b: U8x3) -> tuple[int, int, int, int, tuple[int, int, int]]:
    return len(a), len((1, 2)), a.size, b.size, b.shape


# --- loops ---


@given(*[(a, b, c) for a in (-3, 0, 4) for b in (-4, 0, 5) for c in (-3, -2, -1, 1, 2, 3)], only=True)
@kernel
def ranges(a: int, b: int, c: int) -> tuple[int, int]:
    total = count = 0
    for k in range(a, b, c):
        total = total * 3 + k
        count += 1
    return total, count


@given(
    (2**63 - 3, 2**63 - 1, 5),
    (-(2**63) + 3, -(2**63), -7),
    (-(2**63), 2**63 - 1, 2**62),
    (2**63 - 1, -(2**63), -(2**63)),
    only=True,
)
@kernel
def ranges_to_the_end(a: int, b: int, c: int) -> int:
    count = 0
    for _ in range(a, b, c):
        count += 1
    return count


@kernel
def ranges_of_constants(n: int) -> int:
    total = 0
    for k in range(n):
        for m in range(k, 5):
            for s in range(10, m, -3):
                total += k * 100 + m * 10 + s
        for s in range(n, -1, -1):
            total ^= s
        for s in range(0, n, 2):
            total += s
    return total


@given(*[(n,) for n in range(7)], only=True)
@kernel
def variables_afterwards(n: int) -> tuple[int, int]:
    k = last = -1
    for k in range(n):
        last = k * 2
    return k, last


@kernel
def changed_inside(n: int) -> int:
    total = 0
    for k in range(n):
        total += k
        k = k * 10
        total += k
        n = 2
    return total + n


@kernel
def breaks_and_continues(a: I64x1, n: int) -> tuple[int, int]:
    total = 0
    for k in range(100):
        if k == n:
            continue
        if k > n + 3:
            break
        for each in a:
            if each == 3:
                break
            if each == 1:
                continue
            total += each * k
    while True:
        n += 1
        if n % 7 == 0:
            break
        if n % 2:
            continue
        total += n
    return total, n


@kernel
def whiles(a: int, n: int) -> int:
    while n > 0 and a % 3 != 1:
        a += n
        n -= 1
    while not a % 2:
        a += 1
    return a


@kernel
def over_tuples(a: int, b: float) -> float:
    total = 0.0
    for x, y in ((a, 1), (2, a)):
        total += x * 10 + y
    for each in (a, b, True):
        total += each
    for _ in (1, 2, 3):
        total *= 2
    return total


@kernel
def over_arrays(a: F64x2, b: I64x1) -> float:
    total = 0.0
    for row in a:
        row[0] = 1.0
        for each in row:
            total += each
    for each in b:
        b[0] = 4
        total += each
    return total


@kernel
def over_what_is_replaced(a: I64x1, b: I64x1) -> int:
    total = 0
    for each in a:
        a = b
        total = total * 2 + each
    return total + a[0]


@kernel
def over_records(r: Annotated[Any, Records(INNER)]) -> int:
    total = 0
    for each in r:
        each.count = total
        total += int(each.small)
    return total


@kernel
def returned_from_loops(a: I64x2, x: int) -> int:
    for k in range(a.shape[0]):
        for each in a[k]:
            if each == x:
                return k
    return -1


# --- arrays ---


@kernel
def indexed(a: I64x1, b: I64x2, c: I64x3, i: int, j: int, k: int) -> int:
    return a[i] + b[i, j] * 10 + c[i, j, k] * 100 + b[i][k] * 1000 + c[i][j][k] + c[k, j][i]


@kernel
def indexed_from_behind(a: I64x1, b: I64x2) -> int:
    return a[-1] + a[-6] * 10 + b[-1, -4] * 100 + b[-2][-1]


@kernel
def elements_changed(a: I64x1, b: F64x2, i: int, j: int) -> None:
    a[i] = a[j] * 2
    a[-1] += 5
    b[i, j] -= 0.5
    b[-1, j] *= 2
    b[i][j] /= 3
    a[j] <<= 3
    a[j] //= 2
    a[j] %= 100
    a[i] |= 1
    a[i] &= 0xFF
    a[i] ^= 0x0F
    a[i] >>= 1


@given(*[(np.arange(6), a, b) for a in (*range(-8, 9), 2**62) for b in range(-8, 9)], only=True)
@kernel
def sliced(a: I64x1, i: int, j: int) -> tuple[int, int, int, int, int]:
    code = 0
    for each in a[i:j]:
        code = code * 7 + each
    return code, len(a[i:]), len(a[:j]), len(a[:]), len(a[i:j][1:])


@kernel
def sliced_by_constants(a: I64x1) -> tuple[int, int, int, int]:
    return len(a[1:-1]), len(a[-2:]), len(a[:100]), len(a[4:2])


@kernel
def sliced_in_more_axes(a: I64x2, c: I64x3, i: int, n: int) -> tuple[int, int, int]:
    rows, block, row = a[i:n], c[i, n:, :], c[i, 1, :n]
    return rows.shape[0] * 10 + rows.shape[1], block.size, len(row) + c[i : n + 1, :, :].size


@kernel
def parts_changed(a: I64x2, c: I64x3, i: int, j: int) -> None:
    row = a[i]
    row[j] = 5
    part = row[1:3]
    part[0] += 7
    c[i][j][0] = 3
    c[i, j, 1:] = 9
    c[j, i:] = 8


@kernel
def filled(a: I64x1, b: F64x2, c: U8x2, d: BOOLx1, i: int, x: int) -> None:
    a[:] = x
    a[1:3] = a[0] + 1
    b[i] = 2
    b[i, 1:] = b[i, 0] + 0.5
    c[:] = x & 255
    c[i, :2] = 1
    d[:] = True
    d[i:4] = a[i] > 0


@kernel
def filled_by_its_own(a: I64x1) -> None:
    a[:] = a[3]
    a[0] = 2
    a[0:2] = a[0] + a[1]


@kernel
def assigned(a: I64x1, b: I64x1, c: I64x2, i: int) -> None:
    a[1:4] = b[:3]
    c[i] = a[2:]
    c[0:2] = c[1:3]
    b[:] = a


@kernel
def overlapping(a: I64x1, i: int) -> None:
    a[i : i + 3] = a[1:4]
    a[:5] = a[1:]
    a[1:] = a[:-1]


@kernel
def made(n: int, x: float) -> tuple[float, int, int]:
    a, b, c = np.empty(n), np.zeros((n, 2), np.int64), np.full(n + 1, x)
    e, f = np.zeros(n, dtype=np.bool_), np.full((2, 3), 7)
    total = c[n] + len(a)
    for k in range(n):
        a[k] = k * 0.5
        b[k, 1] = k
        e[k] = k % 2
    for k in range(n):
        total += a[k] + b[k, 0] + b[k, 1] + e[k]
    return total, f[1, 2] // 2, b.size + np.any(e)


@kernel
def made_in_kinds(n: int) -> tuple[int, int, float, int, bool]:
    a, b, c = np.zeros(n + 1, np.uint8), np.full(3, 300, np.uint16), np.full(2, 0.1, np.float32)
    d, e = np.zeros((1, 2, 3), np.int32), np.full(2, n > 2)
    a[n] = 255
    return int(a[n]), int(b[1]) // 2, float(c[1]), d.size + int(d[0, 1, 2]), e[0]


@kernel
def made_like(a: F64x2, b: I64x1) -> tuple[int, float, int]:
    c, d, e = np.empty_like(a), np.zeros_like(b), b.copy()
    c[:] = 1.0
    e[0] += 1
    return c.size + len(d) + d[0], c[1, 2], e[0] - b[0]


@kernel
def made_records(n: int) -> int:
    r = np.zeros(n + 1, RECORD)
    r[n].count = 5
    r[n].part[2] = 0.5
    last = r[n]
    last.count += 1
    return r[n].count + int(r[0].small)


@kernel
def unit_matrix(n: int) -> F64x2:
    a = np.eye(n)
    if n > 1:
        a[0, 1] = 0.5
    return a


@kernel
def made_in_loops(n: int) -> float:
    total = 0.0
    for k in range(n * 50):
        a = np.zeros(k + 1)
        a[k] = k
        total += a[k] + a[0]
    return total


@given((0,), (3,), (6,), only=True)
@kernel
def made_elsewhere(n: int) -> float:
    total = 0.0
    for _ in range(300):
        total += np.float64(sum_of(doubled(np.full(n * 100 + 1, 0.5))))
    return total


@kernel
def doubled(a: F64x1) -> F64x1:
    b = np.empty_like(a)
    for k in range(len(a)):
        b[k] = 2 * a[k]
    return b


@kernel
def sum_of(a: F64x1) -> float:
    total = 0.0
    for each in a:
        total += each
    return total


@kernel
def kept_while_others_are_made(n: int) -> float:
    a = doubled(np.full(n + 1, 1.5))
    total = 0.0
    for _ in range(20):
        total += sum_of(doubled(np.full(900, 1.0)))
    return total + a[n]


@kernel
def record_that_is_made(n: int, x: int) -> Annotated[Any, Records(INNER)]:
    r = np.zeros(2, RECORD)
    r[0].count = x
    r[1] = r[0]
    r[1].small = n
    return r


@kernel
def arrays_chosen(a: I64x1, b: I64x1, x: float, i: int) -> int:
    c = a if x > 0 else b
    c[i] = 50
    d = doubled(np.zeros(2)) if x > 1 else np.zeros(3)
    return len(c[1:] if x > 0 else c[:2]) + len(d)


@kernel
def given_back(a: I64x1, b: F64x2, i: int) -> tuple[I64x1, F64x1, I64x1]:
    a[i] = 4
    return a[1:4], b[i], a[5:2]


@kernel
def bytes_of_rows(a: U8x1, x: int) -> tuple[int, int, bool, bool]:
    put_u16(a, 0, x)
    put_u32(a, 2, x)
    move(a, 1, a, 0, 4)
    return get_u16(a, 1), get_u32(a, 2), same(a, 0, a, 1, 5), same(a, 0, a, 3, 0)


@kernel
def prefetched(a: U8x1, b: F64x2, i: int) -> tuple[int, float]:
    """Prefetching reads nothing, so no place is out of range."""
    prefetch(b, i, 0, 200)
    prefetch(a, 0, i, len(a))
    return int(a[0]), b[0, 0]


@kernel
def bytes_of_long_rows(a: U8x3, x: int, i: int) -> tuple[int, int]:
    row = np.zeros(16, np.uint8)
    put_u64(row, i, x)
    put_u64(row, 8, -x)
    a[0, 0, :] = row[i : i + 4]
    return get_u64(row, i), get_u64(row, 7)


# --- records and bundles ---


@kernel
def records(r: Annotated[Any, Records(INNER)], i: int, j: int, x: float) -> float:
    one = r[i]
    one.part[1] = x
    one.cells[1, 2] = 7
    one.cells[0, 1:3] = 5
    one.part[:] = r[j].part
    one.word += 1
    r[j] = one
    one.count -= r[j].count * 2
    return r[j].part[2] + len(r) + one.part.size + int(one.cells[1][2])


@kernel
def single_record(r: Annotated[Any, Records(INNER, 0)], x: int) -> int:
    r.count = x
    r.small = x & 127
    r.flag = not r.flag
    return r.count + int(r.small) * 2


@kernel
def records_in_axes(r: Annotated[Any, Records(INNER, 3)], i: int, j: int, k: int) -> int:
    row = r[i, j]
    row[k].count = 5
    plane = r[i]
    return plane[j, k].count + len(row) + int(r[i, j, k].word) + r.size


@kernel
def bundles(b: Outer, i: int, x: float) -> tuple[float, int, bool]:
    inner = b.inner
    inner.rows[i, 1].part[0] = x
    b.values[i] *= inner.scale
    grow(b.inner, i)
    whole, part = inner.size
    return b.values[i] + part + inner.size[1], b.most + whole, b.is_open and not inner.rows[0, i].flag


@kernel
def grow(b: Inner, i: int) -> None:
    b.rows[i, i].count += b.size[0]


# --- calls ---


@kernel
def ordered(a: int, b: int = 20, c: int = 300) -> int:
    return a * 10000 + b * 100 + c


@kernel
def with_defaults(a: int) -> tuple[int, int, int, int]:
    return ordered(a), ordered(a, 5), ordered(a, c=6), ordered(b=7, a=a)


@kernel
def defaults_that_widen(a: float = 1, b: float = HALF, p: tuple[float, int] = (2.5, 3)) -> float:
    return a + b + p[0] * p[1]


@kernel
def calls_with_defaults(a: int) -> tuple[float, float, float]:
    return defaults_that_widen(), defaults_that_widen(a), defaults_that_widen(b=a, p=(a, 1))


@given(*[(a, np.zeros(3, np.int64)) for a in range(-5, 8)], only=True)
@kernel
def early(a: int, log: I64x1) -> int:
    if a > 5:
        log[0] = 1
        return 1
    for k in range(a):
        if k == 3:
            return 30
    while a < 0:
        if a == -2:
            return 4
        a += 1
    log[1] = 2
    return 2


@kernel
def early_for_nothing(a: int, log: I64x1) -> None:
    if a > 5:
        return
    log[0] = a
    if a < 0:
        return None
    log[1] = a


@kernel
def through_many(a: int) -> int:
    x, y = pair_of(ordered(noted(np.zeros(3, np.int64), a)), 0.5)
    return x if y else 0


@kernel
def defined_on_all_ways(a: int, b: bool) -> float:
    if b:
        x = 1
    elif a > 3:
        x = 2
    else:
        return 0.5
    while True:
        y = a
        if y > -(10**13):
            break
    for k in range(3):
        z = k
    for each in (4, 5):
        w = each
    return x + y + z + w + k


@kernel
def narrow_variables(a: U8x1, b: I32x1, i: int, c: I64x1) -> tuple[int, float, bool]:
    x, y = a[i], b[0]
    x = a[1] if y > 3 else a[2]
    b[1] = x
    c[1] = c[int(x) % 6]
    return int(x) + int(y), float(x), x in (1, 2) or bool(y)


@kernel
def narrow_counts(a: U8x1, b: I64x1) -> int:
    a[0], a[1] = 2, 4
    total = 0
    for k in range(a[0], a[1]):
        total += b[a[0]] * k + (5, 6, 7)[a[0]]
    return total + len(b[a[0] : a[1]]) + len(np.zeros(a[1]))


@kernel
def narrow_augmented(a: U8x1, c: I32x1, i: int) -> None:
    a[i] += 200
    a[i] -= 255
    a[0] *= 3
    a[1] >>= 2
    a[2] <<= 3
    a[3] //= 7
    a[4] %= 7
    a[5] |= 129
    c[i] += 2**31 - 1


@kernel
def seen_as_two_kinds(a: I64x1, b: F64x1) -> int:
    a[0] = 1
    b[0] = 2.0
    return a[0] + a[1]


@kernel
def zero_less(x: int) -> float:
    # gcc 12 makes -0.0 of it where x is 0, unless it is told that rounding matters.
    return 0.0 * 1 - x


@kernel
def _overwritten(f: F64x1) -> float:
    f[0] = 100.0
    return 1.0


@kernel
def float_augmented_by_a_call(f: F64x1) -> float:
    f[0] += _overwritten(f)
    return f[0]
