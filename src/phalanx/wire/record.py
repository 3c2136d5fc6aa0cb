"""Record type of the byte table, and its codec: little-endian, no padding, lengths before contents, no trailing bytes.

Only this file encodes and decodes values. table.py lists the records.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from phalanx.errors import PeerError, UsageError

Value = int | float | bytes

INTEGERS = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i8": "b", "i16": "h", "i32": "i", "i64": "q"}
FLOATS = {"f32": "f", "f64": "d", "f64?": "d"}
LENGTHS = {"v8": "B", "v16": "H"}
LARGEST_NUMBER = 1e6  # limit of an f32: one NaN or infinity in a broadcast would spoil every neighbour's sums
LARGEST_F32 = 3.4028234663852886e38  # largest finite value of the type


class MalformedRecord(PeerError):
    """A record is too short or too long, or has a wrong tag or a number out of range."""


@dataclass(frozen=True, slots=True)
class Field:
    """Field of a record.

    `type`: u8, u16, u32, u64; i8, i16, i32, i64, in two's complement; f32 (finite, at most 10^6 in magnitude); f64
    (not NaN); f64? (NaN: no value); bN: N bytes; v8, v16: a length, then that many bytes; rest: all bytes that
    follow, only as the last field.
    """

    name: str  # name in code
    type: str
    doc: str  # meaning and unit
    value: int | None = None  # value of a constant integer field; the codec writes and checks it

    @property
    def size(self) -> int:
        """Return the size of the fixed part, bytes."""
        return struct.calcsize(f"<{self.form}")

    @property
    def dtype(self) -> str:
        """Return the numpy dtype of the fixed part."""
        return f"<{self.form}"

    @property
    def form(self) -> str:
        """Return the `struct` format of the fixed part."""
        known = {**INTEGERS, **FLOATS, **LENGTHS, "rest": ""}
        return known[self.type] if self.type in known else f"{self.type[1:]}s"


@dataclass(frozen=True)
class Record:
    """Message or other byte string with named fields, in their order on the wire."""

    name: str  # name in code and in the C header
    fields: tuple[Field, ...]  # without the tag
    doc: str  # one line
    tag: int | None = None  # first byte, if the record has a tag

    @cached_property
    def all_fields(self) -> tuple[Field, ...]:
        """Return the fields, after the tag as the first field."""
        tag = () if self.tag is None else (Field("tag", "u8", "kind of the record", self.tag),)
        return tag + self.fields

    @cached_property
    def size(self) -> int:
        """Return the size of the record, bytes, without the contents of a v8, v16 or rest."""
        return sum(field.size for field in self.all_fields)

    @cached_property
    def form(self) -> struct.Struct:
        """Return the `struct` of the fixed part: without checks, for trusted bytes and for attacks."""
        return struct.Struct("<" + "".join(field.form for field in self.all_fields))

    @cached_property
    def dtype(self) -> list[tuple[str, str]]:
        """Return the numpy dtype of the fixed part, as a list of fields."""
        return [(field.name, field.dtype) for field in self.all_fields]

    def at(self, name: str) -> int:
        """Return the offset of a field, bytes.

        Raises: UsageError: no such field.
        """
        begin = 0
        for field in self.all_fields:
            if field.name == name:
                return begin
            begin += field.size
        raise UsageError(f"{self.name} has no field {name}")

    def encode(self, **values: Value) -> bytes:
        """Encode the record from the values of all fields that are not constant, by name.

        Raises: UsageError: a field is missing or unknown, or a value does not fit.
        """
        wanted = {field.name for field in self.all_fields if field.value is None}
        if wanted != set(values):
            raise UsageError(f"{self.name}: fields {sorted(wanted ^ set(values))} are missing or unknown")
        try:
            return b"".join(_encode(f, values[f.name] if f.value is None else f.value) for f in self.all_fields)
        except (struct.error, OverflowError, TypeError, AttributeError, ValueError) as error:
            raise UsageError(f"{self.name}: {error}") from error

    def read(self, raw: bytes, at: int = 0) -> tuple[dict[str, Any], int]:
        """Decode the record that begins at offset `at`; other bytes may follow it.

        Returns: the values of the fields that are not constant, by name; the offset behind the record.
        Raises: MalformedRecord: the record is incomplete or not valid.
        """
        values: dict[str, Any] = {}
        for field in self.all_fields:
            value, at = _read(self.name, field, raw, at)
            if field.value is None:
                values[field.name] = value
            elif value != field.value:
                raise MalformedRecord(f"{self.name}: {field.name} is not {field.value}")
        return values, at

    def decode(self, raw: bytes) -> dict[str, Any]:
        """Decode a record that fills all of `raw`.

        Raises: MalformedRecord: too short, too long, or not valid.
        """
        values, end = self.read(raw)
        if end != len(raw):
            raise MalformedRecord(f"{self.name}: {len(raw) - end} bytes too many")
        return values


def fields(*declared: str | Field) -> tuple[Field, ...]:
    """Parse declarations of fields, each "NAME TYPE: meaning and unit".

    Several names before a type declare as many fields; only the first gets the text. "= NUMBER" after a type is the
    field's `value`.
    """
    made: list[Field] = []
    for each in declared:
        if isinstance(each, Field):
            made.append(each)
            continue
        declaration, _, doc = each.partition(": ")
        declaration, _, value = declaration.partition(" = ")
        *names, kind = declaration.split()
        made += [Field(name, kind, "" if n else doc, int(value) if value else None) for n, name in enumerate(names)]
    return tuple(made)


def record(head: str, *declared: str | Field, tag: int | None = None) -> Record:
    """Return a record of these `fields`; `head` is "NAME: meaning"."""
    name, _, doc = head.partition(": ")
    return Record(name, fields(*declared), doc, tag)


def _encode(field: Field, value: Any) -> bytes:
    if field.type in INTEGERS:
        return int.to_bytes(value, field.size, "little", signed=field.type[0] == "i")
    if field.type in FLOATS:
        if not _fits(value, field.type):
            raise ValueError(f"{field.name} is {value!r}")
        return struct.pack(f"<{field.form}", value)
    raw = bytes(memoryview(value))
    if field.type in LENGTHS:
        return len(raw).to_bytes(field.size, "little") + raw
    if field.type != "rest" and len(raw) != field.size:
        raise ValueError(f"{field.name} has {len(raw)} bytes, not {field.size}")
    return raw


def _read(record: str, field: Field, raw: bytes, at: int) -> tuple[Value, int]:
    size = field.size
    if field.type in LENGTHS:
        size += int.from_bytes(raw[at : at + size], "little")
    elif field.type == "rest":
        size = len(raw) - at
    if at + max(size, field.size) > len(raw):
        raise MalformedRecord(f"{record}: ends inside {field.name}")
    piece = raw[at : at + size]
    if field.type in INTEGERS:
        return int.from_bytes(piece, "little", signed=field.type[0] == "i"), at + size
    if field.type in FLOATS:
        number: float = struct.unpack(f"<{field.form}", piece)[0]
        if not _fits(number, field.type):
            raise MalformedRecord(f"{record}: {field.name} is {number}")
        return number, at + size
    return bytes(piece[field.size :] if field.type in LENGTHS else piece), at + size


def _fits(number: Any, kind: str) -> bool:
    if not hasattr(number, "__float__"):
        return False
    return kind == "f64?" or (not math.isnan(number) if kind == "f64" else abs(number) <= LARGEST_NUMBER)
