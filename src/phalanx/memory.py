"""Bytes of a row in one instruction, for kernels; uncompiled, the same in plain Python.

Byte by byte, each access would ask whether its index is negative, and no compiler puts four such loads together. Like
all of a kernel's accesses these are not checked: callers check lengths first. Rows are (n,) uint8, in C order.
"""

# ruff: noqa: ARG001, ARG005, PLW0108 - numba asks for functions of just these parameters

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir as llvm
from numba import extending
from numba import types as numba_types

try:
    from numba.core import cgutils
    from numba.np import arrayobj
except ImportError:  # a numba that is another inside: bytes one by one
    cgutils = arrayobj = None  # type: ignore[assignment]

assert sys.byteorder == "little", "numbers lie in memory as they do on the wire"
# Untyped, all of it.
ir: Any = llvm
types: Any = numba_types
extend: Any = extending
arrays: Any = arrayobj
utils: Any = cgutils
WORD_BITS = 64


def _place(context: Any, builder: Any, kind: Any, row: Any, at: Any) -> Any:
    data = arrays.make_array(kind)(context, builder, row).data
    return builder.gep(builder.bitcast(data, utils.voidptr_t), [at])


def _loads(bits: int) -> Callable[[Any, int], int]:
    width = bits // 8

    def load(row: Any, at: int) -> int:
        return int.from_bytes(row[at : at + width].tobytes(), "little", signed=bits == WORD_BITS)

    @extend.intrinsic  # type: ignore[untyped-decorator]
    def emitted(_: Any, row: Any, at: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            place = _place(context, builder, signature.args[0], *given)
            loaded = builder.load(builder.bitcast(place, ir.IntType(bits).as_pointer()), align=1)
            return builder.zext(loaded, ir.IntType(64)) if bits < WORD_BITS else loaded

        return types.int64(row, types.int64), generate

    def one_by_one(row, at):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        value: Any = 0
        for k in range(width):
            value |= np.int64(row[at + k]) << (8 * k)
        return value

    extend.overload(load)(lambda row, at: (lambda row, at: emitted(row, at)) if arrays else one_by_one)

    return load


def _stores(bits: int) -> Callable[[Any, int, int], None]:
    width = bits // 8

    def store(row: Any, at: int, value: int) -> None:
        cut = int(value) & ((1 << bits) - 1)
        row[at : at + width] = np.frombuffer(cut.to_bytes(width, "little"), np.uint8)

    @extend.intrinsic  # type: ignore[untyped-decorator]
    def emitted(_: Any, row: Any, at: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            place = _place(context, builder, signature.args[0], *given[:2])
            cut = builder.trunc(given[2], ir.IntType(bits)) if bits < WORD_BITS else given[2]
            builder.store(cut, builder.bitcast(place, ir.IntType(bits).as_pointer()), align=1)
            return context.get_dummy_value()

        return types.none(row, types.int64, types.int64), generate

    def one_by_one(row, at, value) -> None:  # type: ignore[no-untyped-def]  # noqa: ANN001
        for k in range(width):
            row[at + k] = (value >> (8 * k)) & 255

    extend.overload(store)(
        lambda row, at, value: (lambda row, at, value: emitted(row, at, value)) if arrays else one_by_one
    )

    return store


# The unsigned number that lies at `at`; of the longest, 2^63 and more are negative.
load_16, load_32, load_64 = _loads(16), _loads(32), _loads(64)
# The lowest so many bits of `value` lie at `at`.
store_16, store_32, store_64 = _stores(16), _stores(32), _stores(64)


def move(to: Any, to_at: int, source: Any, source_at: int, length: int) -> None:
    """`length` bytes, 0 or more, are copied; the rows may be the same, and the places overlap."""
    to[to_at : to_at + length] = source[source_at : source_at + length].copy()


def equal(one: Any, one_at: int, other: Any, other_at: int, length: int) -> bool:
    """Whether `length` bytes, 0 or more, agree."""
    return bool((one[one_at : one_at + length] == other[other_at : other_at + length]).all())


@extend.intrinsic  # type: ignore[untyped-decorator]
def _moved(_: Any, to: Any, to_at: Any, source: Any, source_at: Any, length: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        there = _place(context, builder, signature.args[0], *given[0:2])
        here = _place(context, builder, signature.args[2], *given[2:4])
        copies = builder.module.declare_intrinsic("llvm.memmove", [there.type, here.type, ir.IntType(64)])
        builder.call(copies, [there, here, given[4], ir.IntType(1)(0)])
        return context.get_dummy_value()

    return types.none(to, types.int64, source, types.int64, types.int64), generate


@extend.intrinsic  # type: ignore[untyped-decorator]
def _agreed(_: Any, one: Any, one_at: Any, other: Any, other_at: Any, length: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        first = _place(context, builder, signature.args[0], *given[0:2])
        second = _place(context, builder, signature.args[2], *given[2:4])
        of_c = ir.FunctionType(ir.IntType(32), [first.type, second.type, ir.IntType(64)])
        compares = utils.get_or_insert_function(builder.module, of_c, "memcmp")
        return builder.icmp_signed("==", builder.call(compares, [first, second, given[4]]), ir.IntType(32)(0))

    return types.boolean(one, types.int64, other, types.int64, types.int64), generate


def _moved_by_one(to, to_at, source, source_at, length) -> None:  # type: ignore[no-untyped-def]  # noqa: ANN001
    to[to_at : to_at + length] = source[source_at : source_at + length].copy()


def _agreed_by_one(one, one_at, other, other_at, length) -> bool:  # type: ignore[no-untyped-def]  # noqa: ANN001
    for k in range(length):  # noqa: SIM110
        if one[one_at + k] != other[other_at + k]:
            return False
    return True


extend.overload(move)(
    lambda to, to_at, source, source_at, length: (
        (lambda to, to_at, source, source_at, length: _moved(to, to_at, source, source_at, length))
        if arrays
        else _moved_by_one
    )
)
extend.overload(equal)(
    lambda one, one_at, other, other_at, length: (
        (lambda one, one_at, other, other_at, length: _agreed(one, one_at, other, other_at, length))
        if arrays
        else _agreed_by_one
    )
)
