"""Encoding of frozen dataclasses by the types of their fields; checkpoints hold controllers' memory in it.

Fields are written in their order, little-endian, without padding:

- `int` has 8 bytes (`I64`), `float` 8 (`F64`), `bool` one; widths.py declares other widths;
- tuples of a fixed length (`tuple[U16, F32]`, `Annotated[tuple[F32, ...], 16]`) and frozen dataclasses are written
  item by item;
- `bytes` has a length of 2 bytes before it, `Annotated[bytes, 20]` is 20 bytes without one.

A float is written as its IEEE bits, infinities and -0.0 too. All NaNs are written with the same bits, because the
sign and the payload of a NaN differ between machines.
"""

from __future__ import annotations

import dataclasses
import math
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from operator import attrgetter
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from .record import FLOATS, INTEGERS, MalformedRecord

WIDTHS = INTEGERS | {name: FLOATS[name] for name in ("f32", "f64")}
DECLARED = {int: "i64", float: "f64"}  # of a field without a declared width
LENGTH = struct.Struct("<H")  # of `bytes`, before its contents
MOST_BYTES = 65_535
MAY_BE = "a frozen dataclass of numbers, bools, bytes, tuples of a fixed length, and frozen dataclasses"


class Unfit(ValueError):
    """A value does not fit its field, or a field's type has no encoding."""


@dataclasses.dataclass(frozen=True, slots=True)
class _Leaf:
    """A number, bool or byte string within a dataclass."""

    name: str  # as in `memory.neighbours[2].x_m`
    type: type[Any]
    letter: str  # its `struct` format; "" for bytes with a length before them
    length: int = 0  # of bytes without a length before them


@dataclasses.dataclass(frozen=True, slots=True)
class _Part:
    """Functions that flatten a field's value into the values of its leaves, and build it from them."""

    spread: Callable[[Any, list[Any]], None]
    build: Callable[[Iterator[Any]], Any]


class Packing:
    """Encoding of one dataclass; error messages call its values `name`.

    Attributes:
        size: bytes of every encoding; None if that depends on the value.

    Raises: Unfit: the class is no frozen dataclass, or a field's type has no encoding.
    """

    def __init__(self, kind: type[Any], name: str = "memory") -> None:
        leaves: list[_Leaf] = []
        try:
            self._part = _class(kind, name, leaves)
        except RecursionError as error:
            raise Unfit(f"{name} is a {kind.__name__}, which has itself among its fields") from error
        self._leaves, self._types = leaves, [leaf.type for leaf in leaves]
        is_fixed = all(leaf.letter for leaf in leaves)
        self._form = struct.Struct("<" + "".join(leaf.letter for leaf in leaves)) if is_fixed else None
        self.size = self._form.size if self._form else None
        self._floats = [n for n, leaf in enumerate(leaves) if leaf.type is float]

    def settle(self, value: Any) -> tuple[bytes, Any]:
        """Encode a value; return the bytes and the value that they decode to: an F32 is rounded, a 1 may become 1.0.

        Raises: Unfit: a type, a number or a length is wrong; the message names the field.
        """
        values: list[Any] = []
        self._part.spread(value, values)
        for n in self._floats:
            if values[n] != values[n]:  # only a NaN
                values[n] = math.nan
        raw = self._joined(values)
        settled = self._split(raw)
        # Comparing takes a tenth of the time of building.
        if settled == values and list(map(type, values)) == self._types:
            return raw, value
        return raw, self._part.build(iter(settled))

    def decode(self, raw: bytes) -> Any:
        """Decode a value.

        Raises: MalformedRecord: no value has this encoding: wrong length, a bool of 2, a NaN with other bits.
        """
        try:
            value = self._part.build(iter(self._split(raw)))
            own, value = self.settle(value)
        except Exception as error:  # a dataclass may check its fields and raise any exception
            raise MalformedRecord(f"{len(raw)} bytes: {error}") from error
        if own != raw:
            raise MalformedRecord(f"{len(raw)} bytes: not the canonical encoding of the value")
        return value

    def _joined(self, values: Sequence[Any]) -> bytes:
        if self._form:
            with suppress(struct.error, OverflowError):
                return self._form.pack(*values)
        return b"".join(map(_packed, self._leaves, values))  # raises, and names the leaf that does not fit

    def _split(self, raw: bytes) -> list[Any]:
        if self._form:
            return list(self._form.unpack(raw))
        values, at = [], 0
        for leaf in self._leaves:
            letter = leaf.letter
            if not letter:
                letter, at = f"{LENGTH.unpack_from(raw, at)[0]}s", at + LENGTH.size
            values.append(struct.unpack_from(f"<{letter}", raw, at)[0])
            at += struct.calcsize(f"<{letter}")
        if at != len(raw):
            raise Unfit(f"{len(raw) - at} bytes too many")
        return values


@cache
def packing_of(kind: type[Any]) -> Packing:
    """Return the cached packing of a class. Raises: as `Packing`."""
    return Packing(kind)


def _packed(leaf: _Leaf, value: Any) -> bytes:
    """Encode a leaf. Raises: Unfit: the value does not fit."""
    if not leaf.letter:
        return LENGTH.pack(len(value)) + value  # type: ignore[no-any-return]
    try:
        return struct.pack(f"<{leaf.letter}", value)
    except (struct.error, OverflowError) as error:
        width = next((name.upper() for name, letter in WIDTHS.items() if letter == leaf.letter), "bool")
        raise Unfit(f"{leaf.name} is {value!r:.40}: does not fit into {width}") from error


# --- the parts of each type of a field ---


def _part(kind: Any, name: str, leaves: list[_Leaf]) -> _Part:
    """Return the functions for a type, and append its leaves to `leaves`. Raises: Unfit: the type has no encoding."""
    of, *more = (get_args(kind)) if get_origin(kind) is Annotated else (kind,)
    declared = more[0] if len(more) == 1 else None
    if len(leaves) >= MOST_BYTES:
        raise Unfit(f"{name}: more than {MOST_BYTES} numbers")
    if of in DECLARED and (declared in WIDTHS or not more):
        width = declared or DECLARED[of]
        if (width in FLOATS) == (of is float):
            return _number(_Leaf(name, of, WIDTHS[width]), leaves)
    if of is bool and not more:
        return _number(_Leaf(name, of, "?"), leaves)
    if of is bytes and (not more or _is_length(declared)):
        return _bytes(_Leaf(name, of, f"{declared}s" if more else "", declared or 0), leaves)
    if get_origin(of) is tuple:
        return _tuple(of, more, name, leaves)
    if dataclasses.is_dataclass(of) and not more:
        return _class(of, name, leaves)
    raise Unfit(f"{name} is a {_shown(kind)}, which has no encoding")


def _number(leaf: _Leaf, leaves: list[_Leaf]) -> _Part:
    leaves.append(leaf)
    return _Part(_append, next)


def _append(value: Any, values: list[Any]) -> None:
    values.append(value)


def _bytes(leaf: _Leaf, leaves: list[_Leaf]) -> _Part:
    leaves.append(leaf)
    wanted = f"{leaf.length} bytes" if leaf.letter else f"at most {MOST_BYTES} bytes"

    def spread(value: Any, values: list[Any]) -> None:
        if not isinstance(value, bytes):
            raise Unfit(f"{leaf.name} is a {type(value).__name__}, not {wanted}")
        if len(value) != leaf.length if leaf.letter else len(value) > MOST_BYTES:
            raise Unfit(f"{leaf.name} has {len(value)} bytes, not {wanted}")
        values.append(value)

    return _Part(spread, next)


def _tuple(of: Any, more: list[Any], name: str, leaves: list[_Leaf]) -> _Part:
    items = list(get_args(of))
    if Ellipsis in items:
        if len(more) != 1 or not _is_length(more[0]):
            raise Unfit(f"{name} is a {_shown(of)} without a fixed length: use Annotated[{_shown(of)}, 16]")
        items = items[:1] * more[0]
    elif more:
        raise Unfit(f"{name} is a {_shown(of)} annotated with {more[0]!r}: its length is fixed already")
    parts = [_part(item, f"{name}[{n}]", leaves) for n, item in enumerate(items)]

    def spread(value: Any, values: list[Any]) -> None:
        if type(value) is not tuple or len(value) != len(parts):
            many = f" of {len(value)}" if isinstance(value, tuple) else ""
            raise Unfit(f"{name} is a {type(value).__name__}{many}, not a tuple of {len(parts)}")
        for part, item in zip(parts, value, strict=True):
            part.spread(item, values)

    return _Part(spread, lambda values: tuple(part.build(values) for part in parts))


def _class(of: Any, name: str, leaves: list[_Leaf]) -> _Part:
    if not hasattr(of, "__dataclass_params__"):
        raise Unfit(f"{name} is a {_shown(of)}, not a dataclass")
    if not of.__dataclass_params__.frozen:
        raise Unfit(f"{name} is a {of.__name__} that is not frozen: use @dataclass(frozen=True)")
    try:
        hints = get_type_hints(of, include_extras=True)
    except NameError as error:
        raise Unfit(f"{name}: {error}") from error
    parts = {each.name: _part(hints[each.name], f"{name}.{each.name}", leaves) for each in dataclasses.fields(of)}

    # A single attrgetter for two or more plain numbers is several times as fast.
    all_of = attrgetter(*parts) if len(parts) > 1 and all(part.spread is _append for part in parts.values()) else None

    def spread(value: Any, values: list[Any]) -> None:
        if type(value) is not of:
            raise Unfit(f"{name} is a {type(value).__name__}, not a {of.__name__}")
        if all_of:
            values.extend(all_of(value))
            return
        for field, part in parts.items():
            part.spread(getattr(value, field), values)

    return _Part(spread, lambda values: of(**{field: part.build(values) for field, part in parts.items()}))


def _is_length(declared: Any) -> bool:
    return type(declared) is int and 0 <= declared <= MOST_BYTES


def _shown(kind: Any) -> str:
    return kind.__name__ if isinstance(kind, type) and not get_args(kind) else str(kind).replace("typing.", "")
