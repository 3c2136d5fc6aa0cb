"""Types of values in the subset, and how annotations name them.

A type is a scalar, an array (dtype and number of axes), a record (dtype), a tuple (types of its items), or a bundle
(a NamedTuple class whose fields have types).
"""

from __future__ import annotations

import typing
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class Scalar:
    """A number, a truth value, or nothing."""

    name: str
    c: str

    def __str__(self) -> str:
        return self.name


INT = Scalar("int", "int64_t")
# An element of fewer than 64 bits: in Python its sums would wrap at its own width, so int() comes first.
NARROW = Scalar("narrow int", "int64_t")
FLOAT = Scalar("float", "double")
F32 = Scalar("np.float32", "float")
U32 = Scalar("np.uint32", "uint32_t")
U64 = Scalar("np.uint64", "uint64_t")
BOOL = Scalar("bool", "bool")
NONE = Scalar("None", "void")


@dataclass(frozen=True, slots=True)
class Array:
    """An array in C order."""

    dtype: np.dtype[Any]
    axes: int

    def __str__(self) -> str:
        elements = self.dtype if self.dtype.names is None else "records"
        return f"array of {elements} with {self.axes} {'axis' if self.axes == 1 else 'axes'}"


@dataclass(frozen=True, slots=True)
class Record:
    """One record of an array; assignments to its fields change the array."""

    dtype: np.dtype[Any]

    def __str__(self) -> str:
        return f"record with {', '.join(self.dtype.names or ())}"


@dataclass(frozen=True, slots=True)
class Tuple:
    """A tuple of fixed length, or a NamedTuple."""

    items: tuple[ValueType, ...]
    cls: type[Any] | None = None

    def __str__(self) -> str:
        return f"tuple[{', '.join(map(str, self.items))}]"

    @property
    def fields(self) -> tuple[str, ...]:
        """Return the names of the items of a NamedTuple."""
        return self.cls._fields if self.cls else ()


@dataclass(frozen=True, slots=True)
class Bundle:
    """Arrays and numbers that kernels take by one address (phalanx/bundle.py)."""

    cls: Any

    def __str__(self) -> str:
        return str(self.cls.__name__)

    @property
    def places(self) -> dict[str, tuple[int, ValueType]]:
        """Return each field's first 8-byte word, and its type."""
        return _places(self.cls)


ValueType = Scalar | Array | Record | Tuple | Bundle
SCALARS: dict[Any, Scalar] = {
    int: INT,
    float: FLOAT,
    bool: BOOL,
    None: NONE,
    type(None): NONE,
    np.float64: FLOAT,
    np.float32: F32,
    np.uint32: U32,
    np.uint64: U64,
    np.int64: INT,
}
# Element types of arrays: C type and the type that an element has once it is read.
ELEMENTS: dict[str, tuple[str, Scalar]] = {
    "u1": ("uint8_t", NARROW),
    "i1": ("int8_t", NARROW),
    "u2": ("uint16_t", NARROW),
    "i2": ("int16_t", NARROW),
    "u4": ("uint32_t", NARROW),
    "i4": ("int32_t", NARROW),
    "i8": ("int64_t", INT),
    "u8": ("uint64_t", U64),
    "f4": ("float", F32),
    "f8": ("double", FLOAT),
    "b1": ("uint8_t", BOOL),  # whatever is not 0 is true, as in numpy; a bool of C has to be 0 or 1
}
MOST_AXES = 4


def element(dtype: np.dtype[Any]) -> tuple[str, Scalar]:
    """Return the C type and the type of an array's elements, or of a record's field. Raises: TypeError: it has none."""
    if dtype.str[1:] not in ELEMENTS or not dtype.isnative:
        raise TypeError(f"{dtype} is not an element type of kernels")
    return ELEMENTS[dtype.str[1:]]


def array_type(dtype: np.dtype[Any], axes: int) -> Array:
    """Return the type of an array. Raises: TypeError: it has none."""
    if not 1 <= axes <= MOST_AXES:
        raise TypeError(f"an array with {axes} axes, and 1 to {MOST_AXES} are possible")
    if dtype.names is None:
        element(dtype)
    return Array(_aligned(dtype), axes)


def _aligned(dtype: np.dtype[Any]) -> np.dtype[Any]:
    for name, (field, offset, *_) in (dtype.fields or {}).items():
        if offset % field.base.alignment or dtype.itemsize % field.base.alignment:
            raise TypeError(f"a record whose field {name} is not aligned; np.dtype(…, align=True) aligns it")
    return dtype


def named(typ: ValueType) -> str:
    """Return a type as messages name a value of it: "an int", "a tuple[int, float]"."""
    if typ == NONE:
        return "None"
    name = str(typ)
    return f"{'an' if name[0] in 'aeiou' or name.startswith('np.') else 'a'} {name}"


def is_bundle(cls: Any) -> bool:
    """Return whether a NamedTuple is taken by address."""
    return getattr(cls, "__bundled__", False) is True


def type_of_annotation(hint: Any) -> ValueType:
    """Return the type that an annotation names. Raises: TypeError: it names none."""
    if hint in SCALARS:
        return SCALARS[hint]
    if isinstance(hint, type) and issubclass(hint, tuple) and hasattr(hint, "_fields"):
        return Bundle(hint) if is_bundle(hint) else Tuple(tuple(typ for _, typ in fields_of(hint)), hint)
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is tuple and Ellipsis not in arguments:
        return Tuple(tuple(map(type_of_annotation, arguments)))
    if origin is typing.Annotated:
        return _array_of(arguments)
    raise TypeError(f"{_name(hint)} is not a type of kernels")


def _array_of(arguments: tuple[Any, ...]) -> ValueType:
    base, *notes = arguments
    for note in notes:
        if isinstance(note, int):
            return array_type(np.dtype(typing.get_args(typing.get_args(base)[1])[0]), note)
        if hasattr(note, "dtype") and hasattr(note, "axes"):
            return array_type(note.dtype, note.axes) if note.axes else Record(_aligned(note.dtype))
    return type_of_annotation(base)


def _name(hint: Any) -> str:
    return hint.__name__ if isinstance(hint, type) else str(hint)


def _hints_of(declared: Any) -> dict[str, Any]:
    try:
        return typing.get_type_hints(declared, include_extras=True)
    except (
        NameError,
        AttributeError,
        SyntaxError,
    ) as error:  # an annotation is text, or imported for type checkers only
        raise TypeError(f"an annotation of {declared.__name__} cannot be read: {error}") from None


@cache
def fields_of(cls: Any) -> list[tuple[str, ValueType]]:
    """Return the fields of a NamedTuple with their types. Raises: TypeError: a field has none."""
    hints = _hints_of(cls)
    fields = []
    for name in cls._fields:
        try:
            fields.append((name, type_of_annotation(hints[name])))
        except TypeError as error:
            raise TypeError(f"{cls.__module__}.{cls.__name__}.{name}: {error}") from None
    return fields


@cache
def signature_of(function: Callable[..., Any]) -> tuple[dict[str, ValueType], ValueType]:
    """Return the types of a function's parameters, and of what it returns. Raises: TypeError: one has none."""
    hints = _hints_of(function)
    code = function.__code__
    types = {}
    for name in (*code.co_varnames[: code.co_argcount], "return"):
        if name not in hints:
            raise TypeError(f"{'the result' if name == 'return' else name} has no annotation")
        try:
            types[name] = type_of_annotation(hints[name])
        except TypeError as error:
            raise TypeError(f"{name}: {error}") from None
    returned = types.pop("return")
    return types, returned


def joined(one: ValueType | None, other: ValueType | None) -> ValueType | None:
    """Return the type that holds values of both, None if there is none; None joins with everything."""
    if one == other or other is None:
        return one
    if one is None:
        return other
    if {one, other} <= {INT, BOOL, FLOAT}:
        return FLOAT if FLOAT in (one, other) else INT
    if isinstance(one, Tuple) and isinstance(other, Tuple) and len(one.items) == len(other.items):
        items = [joined(a, b) for a, b in zip(one.items, other.items, strict=True)]
        if one.cls is other.cls:
            return Tuple(tuple(items), one.cls) if None not in items else None  # type: ignore[arg-type]
    return None


def compared(one: ValueType, other: ValueType) -> ValueType:
    """Return the type in which two numbers are compared."""
    both = {one, other}
    for typ in (U64, F32, FLOAT):
        if typ in both:
            return typ
    return BOOL if both == {BOOL} else INT


def leaves(typ: ValueType) -> list[ValueType]:
    """Return the types that a value is made of."""
    return [leaf for item in typ.items for leaf in leaves(item)] if isinstance(typ, Tuple) else [typ]


def words(typ: ValueType) -> int:
    """Return how many 8-byte words a value takes in a bundle, or in a call from Python."""
    if isinstance(typ, Array):
        return 1 + typ.axes
    if isinstance(typ, Tuple):
        return sum(map(words, typ.items))
    return 1


@cache
def _places(cls: Any) -> dict[str, tuple[int, ValueType]]:
    places, at = {}, 0
    for name, typ in fields_of(cls):
        places[name] = at, typ
        at += words(typ)
    return places
