"""Functions that the compiler knows: their types, and their C."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .value_types import (
    BOOL,
    F32,
    FLOAT,
    INT,
    NARROW,
    NONE,
    U32,
    U64,
    Array,
    Scalar,
    Tuple,
    ValueType,
    array_type,
    named,
)

NUMBERS = (INT, BOOL, U32, FLOAT, F32)
ROW = Array(np.dtype(np.uint8), 1)
Types = list[ValueType]
# What np.full makes of a value, without a dtype.
DTYPES: dict[ValueType, type[Any]] = {INT: np.int64, BOOL: np.bool_, F32: np.float32, U32: np.uint32, U64: np.uint64}


@dataclass(frozen=True, slots=True)
class Intrinsic:
    """A function that the compiler knows: its type by its arguments' types (None: refused), and its C."""

    rule: Callable[[Types], ValueType | None]
    c: Callable[..., str]  # (emitter, node, [(C, type)]) -> C
    usage: str


def _of(*wanted: ValueType, result: ValueType) -> Callable[[Types], ValueType | None]:
    """Return a rule for arguments of just these types, where a float also takes whole numbers."""

    def rule(given: Types) -> ValueType | None:
        fits = len(given) == len(wanted) and all(
            a == b or (b == FLOAT and a in NUMBERS) or (b == INT and a in (BOOL, U32))
            for a, b in zip(given, wanted, strict=True)
        )
        return result if fits else None

    return rule


def _math(name: str, count: int = 1, result: ValueType = FLOAT) -> Intrinsic:
    def c(emitter: Any, node: ast.AST, given: list[tuple[str, ValueType]]) -> str:
        if result == INT and given[0][1] in (INT, BOOL):
            return str(emitter.convert(*given[0], INT))
        call = f"{name}({', '.join(emitter.convert(*each, FLOAT) for each in given)})"
        return f"to_int({call}, {emitter.site(node)})" if result == INT else call

    return Intrinsic(_of(*[FLOAT] * count, result=result), c, "pass one number")


def _of_float(name: str) -> Intrinsic:
    """Return a function of numpy that would give a float32, or a whole number, of such a one."""

    def c(emitter: Any, _: ast.AST, given: list[tuple[str, ValueType]]) -> str:
        return f"{name}({emitter.convert(*given[0], FLOAT)})"

    return Intrinsic(lambda given: FLOAT if given == [FLOAT] else None, c, "pass a float; float() converts")


def _test(name: str) -> Intrinsic:
    return Intrinsic(
        _of(FLOAT, result=BOOL),
        lambda e, _, given: f"({name}({e.convert(*given[0], FLOAT)}) != 0)",
        "pass one number",
    )


def _conversion(into: Scalar) -> Intrinsic:
    def rule(given: Types) -> ValueType | None:
        return into if len(given) == 1 and isinstance(given[0], Scalar) and given[0] != NONE else None

    def c(emitter: Any, node: ast.AST, given: list[tuple[str, ValueType]]) -> str:
        value, of = given[0]
        if into == BOOL:
            return str(emitter.convert(value, of, BOOL))
        if into in (INT, U64, U32) and of in (FLOAT, F32):
            value = f"to_int({value}, {emitter.site(node)})"
            return value if into == INT else f"(({into.c})({value}))"
        return str(emitter.convert(value, of, into))

    return Intrinsic(rule, c, "pass one number")


def _extreme(name: str) -> Intrinsic:
    def rule(given: Types) -> ValueType | None:
        both = set(given)
        if len(given) < 2 or (both not in ({U64}, {F32}) and not both <= {INT, BOOL, FLOAT}):
            return None
        return given[0] if both in ({U64}, {F32}) else FLOAT if FLOAT in both else INT

    def c(emitter: Any, _: ast.AST, given: list[tuple[str, ValueType]]) -> str:
        into = rule([each for _, each in given])
        suffix = "i" if into == INT else "u" if into == U64 else "d"
        text: str = emitter.convert(*given[0], into)
        for each in [emitter.convert(*each, into) for each in given[1:]]:
            text = f"{name}_{suffix}({text}, {each})"
        return f"((float){text})" if into == F32 else text

    return Intrinsic(rule, c, "pass two or more numbers")


def _abs(given: Types) -> ValueType | None:
    if len(given) == 1 and given[0] in NUMBERS:
        return given[0] if given[0] in (FLOAT, F32) else INT
    return None


def _abs_c(_: Any, __: ast.AST, given: list[tuple[str, ValueType]]) -> str:
    value, typ = given[0]
    return f"fabs({value})" if typ == FLOAT else f"fabsf({value})" if typ == F32 else f"abs_i({value})"


def _len(given: Types) -> ValueType | None:
    return INT if len(given) == 1 and isinstance(given[0], (Array, Tuple)) else None


def _len_c(emitter: Any, _: ast.AST, given: list[tuple[str, ValueType]]) -> str:
    value, typ = given[0]
    return str(len(typ.items)) if isinstance(typ, Tuple) else f"{emitter.in_temporary(value, typ)}.n0"


def _any_c(emitter: Any, _: ast.AST, given: list[tuple[str, ValueType]]) -> str:
    value = emitter.in_temporary(*given[0])
    found = emitter.temporary(BOOL)
    emitter.emit(f"{found} = false;")
    emitter.emit(f"for (int64_t z = 0; z < {value}.n0; z++) {found} |= ((uint8_t *){value}.p)[z] != 0;")
    return str(found)


def _eye_c(emitter: Any, node: ast.AST, given: list[tuple[str, ValueType]]) -> str:
    side = emitter.in_temporary(*given[0])
    made: str = emitter.made(Array(np.dtype(np.float64), 2), [side, side], node, zeroed=True)
    emitter.emit(f"for (int64_t z = 0; z < {side}; z++) ((double *){made}.p)[z * {side} + z] = 1.0;")
    return made


def _memory(name: str, *wanted: ValueType, result: ValueType) -> Intrinsic:
    def c(emitter: Any, node: ast.AST, given: list[tuple[str, ValueType]]) -> str:
        values = [emitter.convert(value, typ, to) for (value, typ), to in zip(given, wanted, strict=True)]
        return f"{name}({', '.join(values)}, {emitter.site(node)})"

    return Intrinsic(_of(*wanted, result=result), c, "pass a row of bytes, and whole numbers")


def _prefetch(given: Types) -> ValueType | None:
    return NONE if len(given) == 4 and isinstance(given[0], Array) and set(given[1:]) <= {INT, U32} else None


def _prefetch_c(emitter: Any, _: ast.AST, given: list[tuple[str, ValueType]]) -> str:
    (value, typ), *places = given
    assert isinstance(typ, Array)
    row = emitter.in_temporary(value, typ)
    size = " * ".join([str(typ.dtype.itemsize), *(f"{row}.n{axis}" for axis in range(1, typ.axes))])
    i, begin, length = (emitter.convert(*each, INT) for each in places)
    return f"prefetch({row}.p, ({i}) * {size} + ({begin}), {length})"


# Functions of Python, math and numpy, by themselves.
KNOWN: dict[Any, Intrinsic] = {
    int: _conversion(INT),
    np.int64: _conversion(INT),
    float: _conversion(FLOAT),
    np.float64: _conversion(FLOAT),
    np.float32: _conversion(F32),
    np.uint32: _conversion(U32),
    np.uint64: _conversion(U64),
    bool: _conversion(BOOL),
    abs: Intrinsic(_abs, _abs_c, "pass one number"),
    min: _extreme("min"),
    max: _extreme("max"),
    len: Intrinsic(_len, _len_c, "pass an array or a tuple"),
    round: _math("rint", result=INT),
    math.sqrt: _math("sqrt"),
    math.sin: _math("sin"),
    math.cos: _math("cos"),
    math.floor: _math("floor", result=INT),
    math.ceil: _math("ceil", result=INT),
    np.rint: _of_float("rint"),
    np.floor: _of_float("floor"),
    np.ceil: _of_float("ceil"),
    np.sqrt: _of_float("sqrt"),
    math.isnan: _test("isnan"),
    math.isfinite: _test("isfinite"),
    np.isnan: _test("isnan"),
    np.isfinite: _test("isfinite"),
    np.any: Intrinsic(_of(Array(np.dtype(np.bool_), 1), result=BOOL), _any_c, "pass an array of bool with one axis"),
    np.eye: Intrinsic(_of(INT, result=Array(np.dtype(np.float64), 2)), _eye_c, "pass a whole number"),
}
# Functions of phalanx, by the name that `phalanx.kernel.intrinsic` gave them.
NAMED: dict[str, Intrinsic] = {
    "whole": _conversion(INT),
    "load_16": _memory("load_16", ROW, INT, result=INT),
    "load_32": _memory("load_32", ROW, INT, result=INT),
    "load_64": _memory("load_64", ROW, INT, result=INT),
    "store_16": _memory("store_16", ROW, INT, INT, result=NONE),
    "store_32": _memory("store_32", ROW, INT, INT, result=NONE),
    "store_64": _memory("store_64", ROW, INT, INT, result=NONE),
    "move": _memory("move_bytes", ROW, INT, ROW, INT, INT, result=NONE),
    "prefetch": Intrinsic(_prefetch, _prefetch_c, "pass an array, and three whole numbers"),
    "equal": _memory("equal_bytes", ROW, INT, ROW, INT, INT, result=BOOL),
}
# Functions that kernels cannot call, and what to write instead.
INSTEAD: list[tuple[tuple[Any, ...], str]] = [
    ((math.hypot, np.hypot), "write math.sqrt(x * x + y * y)"),
    ((math.dist, np.linalg.norm), "write math.sqrt() of the sum of the squares"),
    ((math.tan, np.tan), "write math.sin(x) / math.cos(x)"),
    ((np.sin, np.cos), "write math.sin() or math.cos()"),
    ((math.fabs, np.abs), "write abs()"),
    ((math.isinf, np.isinf), "write abs(x) == math.inf"),
    ((math.pow, pow, np.power), "write multiplications"),
    ((math.radians, np.radians, math.degrees, np.degrees), "multiply by a constant, as math.pi / 180"),
    ((np.minimum, np.maximum, np.min, np.max), "write min() or max() of two numbers, in a loop"),
    ((np.clip,), "write min(max(x, low), high)"),
    ((sum, math.fsum, np.sum, np.mean, np.prod, np.dot), "write a loop over the elements"),
    (
        (np.array, np.arange, np.ones, list, tuple),
        "make an array with np.zeros() or np.full(), and assign its elements",
    ),
    ((enumerate, zip, reversed), "loop over range(), and use an index"),
    ((range,), "use range() only in `for ... in range(...)`"),
    ((print,), "remove it; with PHALANX_PURE=1 a debugger stops in kernels"),
]
MARK_IT = (
    "mark it with @kernel if it is your own; phalanx docs reference/kernels lists the functions that kernels may call"
)
MAKERS = (np.empty, np.zeros, np.full, np.empty_like, np.zeros_like)


def found(function: Any) -> Intrinsic | None:
    """Return what the compiler knows of a function; None if nothing."""
    name = getattr(function, "__intrinsic__", None)
    if name is not None:
        return NAMED[name]
    return KNOWN.get(function) if isinstance(function, type) or callable(function) else None


def result_type(typed: Any, node: ast.Call, function: Any) -> ValueType:
    """Return the type of a call of a known function. Raises: SubsetError: it is not known, or called otherwise."""
    if any(function is each for each in MAKERS):
        return _type_of_made(typed, node, function)
    given = typed.many(node.args)
    if hasattr(function, "__c_symbol__"):
        for each in given:
            if each not in (INT, NARROW, BOOL, ROW):
                raise typed.source.refuse(node, f"{named(each)} for C", "pass rows of bytes and whole numbers")
        return INT
    known = found(function)
    name = getattr(function, "__name__", str(function))
    if known is None:
        instead = next((each for functions, each in INSTEAD if any(function is one for one in functions)), MARK_IT)
        raise typed.source.refuse(node, f"{name} is no kernel", instead)
    if node.keywords:
        raise typed.source.refuse(node, f"keywords of {name}", "pass its arguments by their places")
    result = known.rule(given)
    if result is None:
        raise typed.source.refuse(node, f"a call with {', '.join(map(str, given)) or 'nothing'}", known.usage)
    return result


def shape_of(node: ast.Call) -> list[ast.expr]:
    """Return the lengths that an array is made with."""
    shape = node.args[0]
    return list(shape.elts) if isinstance(shape, ast.Tuple) else [shape]


def _type_of_made(typed: Any, node: ast.Call, function: Any) -> ValueType:
    first = 2 if function is np.full else 1
    if len(node.args) < first or len(node.args) > first + 1 or any(each.arg != "dtype" for each in node.keywords):
        usage = "give a shape, " + ("a value, " if first > 1 else "") + "and a dtype"
        raise typed.source.refuse(node, f"{len(node.args)} arguments of {function.__name__}", usage)
    of = [*node.args[first:], *(each.value for each in node.keywords)]
    if function in (np.empty_like, np.zeros_like):
        like: ValueType = typed.type_of(node.args[0])
        if not isinstance(like, Array) or of:
            raise typed.source.refuse(node, "an array like something else", "pass an array")
        return like
    for each in shape_of(node):
        if typed.type_of(each) not in (INT, NARROW, U32):
            raise typed.source.refuse(each, "no length", "give a whole number for each axis")
    value = typed.type_of(node.args[1]) if function is np.full else FLOAT
    if value == NARROW and not of:
        raise typed.source.refuse(node, "a narrow int without a dtype", "write int() of it, or give a dtype")
    try:
        made = array_type(_dtype_of(typed, node, of, value), len(shape_of(node)))
    except TypeError as error:
        raise typed.source.refuse(node, str(error), "use np.int64, np.float64, np.uint8, np.bool_, …") from None
    if function is np.full:
        typed.fills(node, value, made)
    return made


def _dtype_of(typed: Any, node: ast.Call, of: list[ast.expr], value: ValueType) -> np.dtype[Any]:
    given = typed.constant(of[0]) if of else None
    if given is not None and not isinstance(given, (np.dtype, type)):
        raise typed.source.refuse(node, f"no dtype: {ast.unparse(of[0])}", "use np.int64, np.uint8, …")
    return np.dtype(DTYPES.get(value, np.float64) if given is None else given)


def method_type(typed: Any, node: ast.Call) -> ValueType:
    """Return the type of a method's call: `copy` of an array, `view` of a 32-bit number."""
    method = node.func
    if isinstance(method, ast.Attribute):
        of = typed.type_of(method.value)
        if method.attr == "copy" and isinstance(of, Array) and not node.args and not node.keywords:
            return of
        if method.attr == "view" and len(node.args) == 1 and not node.keywords:
            into = typed.constant(node.args[0])
            if (of, into) == (U32, np.float32):
                return F32
            if (of, into) == (F32, np.uint32):
                return U32
    raise typed.source.refuse(
        node, "a call of something unknown", "call a kernel, or a function that phalanx docs reference/kernels lists"
    )
