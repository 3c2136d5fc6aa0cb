"""Canonical bytes of observables, with one encoding per value (docs/spec/mission.md), and a reader for them.

A version byte; then, in the order of the tags, tag u8, length u16 and content of each observable; all little-endian.
Texts and readings are encoded as their SHA3-256, so that all bytes of one shape have the same length.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from phalanx.crypto.sha3 import sha3_256
from phalanx.errors import UsageError
from phalanx.mission.observable import (
    LANDMARK_TYPES,
    Action,
    Cell,
    Direction,
    Landmark,
    Message,
    Observable,
    Position,
    Previous,
    Sensor,
    Time,
)
from phalanx.mission.refused import MalformedMission
from phalanx.wire import Record
from phalanx.wire import missions as table

LARGEST_ARGUMENT = 1e12
AT_POSITION = 1 + len(LANDMARK_TYPES)  # Shape.place for the robot's own position
ARG_LIMIT, NAME_LIMIT = 16, 200
MILLI = 1000
SEVERAL = 3  # most sensors, and most messages, in one node
_BEGIN = table.CANONICAL.encode(observables=b"")
_SHAPE_BITS = (3, 1, 1, 1, 2, 2, 1, 1, 1)  # width of each field of a Shape


class Reader:
    """Sequential reader of untrusted bytes; each method returns a value or raises MalformedMission."""

    def __init__(self, raw: bytes) -> None:
        self.raw = raw
        self.at = 0

    @property
    def left(self) -> int:
        """Return the number of bytes not read yet."""
        return len(self.raw) - self.at

    def take(self, count: int) -> bytes:
        """Read `count` bytes."""
        if count > self.left:
            raise MalformedMission(f"{count} bytes wanted at {self.at}, {self.left} left")
        self.at += count
        return self.raw[self.at - count : self.at]

    def unpack(self, record: Record) -> tuple[Any, ...]:
        """Read the fixed part of a record."""
        return record.form.unpack(self.take(record.size))

    def number(self, record: Record) -> int:
        """Read a record of a single number."""
        (number,) = self.unpack(record)
        return int(number)

    def behind(self, length: Record) -> bytes:
        """Read a length and that many bytes."""
        return self.take(self.number(length))

    def end(self) -> None:
        """Check that all bytes were read."""
        if self.left:
            raise MalformedMission(f"{self.left} bytes too many")


def text_of(raw: bytes) -> str:
    """Decode UTF-8. Raises: MalformedMission."""
    try:
        return raw.decode()
    except UnicodeDecodeError as error:
        raise MalformedMission("a text is not UTF-8") from error


class Shape(NamedTuple):
    """The kinds and numbers of observables in a node: a robot needs them to try it."""

    place: int = 0  # 0 for none, 1 + index in LANDMARK_TYPES, or AT_POSITION
    oriented: int = 0
    area: int = 0
    text: int = 0
    sensors: int = 0
    messages: int = 0
    action: int = 0
    time: int = 0
    previous: int = 0

    @property
    def code(self) -> int:
        """Return the stored 16 bits."""
        code = 0
        for value, bits in zip(reversed(self), reversed(_SHAPE_BITS), strict=True):
            code = code << bits | value
        return code


def parse_shape(code: int) -> Shape:
    """Return the shape with this code. Raises: MalformedMission: the code is invalid."""
    values = []
    for bits in _SHAPE_BITS:
        values.append(code & ((1 << bits) - 1))
        code >>= bits
    shape = Shape(*values)
    landmark = 1 <= shape.place < AT_POSITION
    if code or shape.place > AT_POSITION or (not landmark and (shape.oriented or shape.area or shape.text)):
        raise MalformedMission("invalid shape of a node")
    return shape


def shape_of(observables: Sequence[Observable]) -> Shape:
    """Return the shape of a conjunction.

    Raises: UsageError: more than one place, or more observables of a kind than the format allows.
    """
    places = [thing for thing in observables if isinstance(thing, Landmark | Position)]
    counts = {kind: sum(isinstance(thing, kind) for thing in observables) for kind in (Sensor, Message, Action, Time)}
    if len(places) > 1:
        raise UsageError("two places in one node", "use one landmark or one position, or make two nodes")
    if max(counts[Sensor], counts[Message]) > SEVERAL or max(counts[Action], counts[Time]) > 1:
        hint = f"use at most {SEVERAL} readings, {SEVERAL} messages, and one of each other kind"
        raise UsageError("too many observables in one node", hint)
    place, oriented, area, text = 0, 0, 0, 0
    if places:
        thing = places[0]
        if isinstance(thing, Position):
            place = AT_POSITION
        else:
            place = 1 + LANDMARK_TYPES.index(thing.type)
            oriented, area = int(thing.orientation_rad is not None), int(thing.area_m2 is not None)
            text = int(thing.text is not None)
    previous = int(any(isinstance(thing, Previous) for thing in observables))
    return Shape(place, oriented, area, text, counts[Sensor], counts[Message], counts[Action], counts[Time], previous)


def _tlv(tag: int, content: bytes) -> bytes:
    return table.OBSERVABLE.form.pack(tag, len(content)) + content


def place_bytes(shape: Shape, cell: Cell, text: str | None = None) -> bytes:
    """Return the bytes of the place: a landmark's cell, the robot's own, or b"" for shapes without a place."""
    if not shape.place:
        return b""
    if shape.place == AT_POSITION:
        return _tlv(table.OF_POSITION, table.POSITION.form.pack(cell.x, cell.y))
    content = table.LANDMARK.form.pack(shape.place - 1, cell.x, cell.y, cell.bin, cell.area)
    return _tlv(table.OF_LANDMARK, content + (sha3_256((text or "").encode()) if shape.text else b""))


def cell_at(shape: Shape) -> int:
    """Return the offset of x and y, eight bytes, in the canonical bytes of a shape."""
    content = table.POSITION if shape.place == AT_POSITION else table.LANDMARK
    return table.CANONICAL.size + table.OBSERVABLE.size + content.at("x")


def action_bytes(action: Action) -> bytes:
    """Return the bytes of an action: its name, and the name, type byte and value of each argument.

    Numbers are stored in thousandths. Raises: UsageError: a name or value is too long, or a number out of range.
    """
    if len(action.args) > ARG_LIMIT:
        raise UsageError(f"action {action.name!r} has {len(action.args)} arguments", f"use at most {ARG_LIMIT}")
    out = [_short(action.name)]
    for name, value in sorted(action.args):
        if isinstance(value, str):
            out += [_short(name), table.ARGUMENT.form.pack(table.OF_TEXT), _short(value)]
        elif abs(value) < LARGEST_ARGUMENT:
            thousandths = table.NUMBER.form.pack(round(value * MILLI))
            out += [_short(name), table.ARGUMENT.form.pack(table.OF_NUMBER), thousandths]
        else:
            raise UsageError(f"argument {name!r} of {action.name!r} is {value}", "use a text, or a number below 1e12")
    return b"".join(out)


def parse_action(raw: bytes) -> Action:
    """Parse an action. Raises: MalformedMission."""
    reader = Reader(raw)
    name = _name(reader)
    args: list[tuple[str, float | str]] = []
    while reader.left:
        key, kind = _name(reader), reader.number(table.ARGUMENT)
        if kind > table.OF_TEXT or len(args) == ARG_LIMIT:
            raise MalformedMission("an invalid argument of an action, or too many")
        value: float | str = _name(reader) if kind == table.OF_TEXT else reader.number(table.NUMBER) / MILLI
        if kind == table.OF_NUMBER and not abs(float(value)) < LARGEST_ARGUMENT:
            raise MalformedMission("an argument of an action is out of range")
        args.append((key, value))
    return Action(name, tuple(args))


def _name(reader: Reader) -> str:
    raw = reader.behind(table.NAME)
    if not 0 < len(raw) <= NAME_LIMIT:
        raise MalformedMission("a name or text of an action is empty or too long")
    return text_of(raw)


def _short(text: str) -> bytes:
    raw = text.encode("utf-8", "surrogatepass")
    if not 0 < len(raw) <= NAME_LIMIT or text != text.encode("utf-8", "ignore").decode():
        raise UsageError(f"{text[:40]!r} as a name or value of an action", f"use 1 to {NAME_LIMIT} bytes of text")
    return table.NAME.form.pack(len(raw)) + raw


def canonical(
    place: bytes = b"",
    *,
    sensors: Sequence[bytes] = (),
    action: Action | None = None,
    window: int | None = None,
    messages: Sequence[bytes] = (),
    previous: bytes | None = None,
    direction: Direction | None = None,
) -> bytes:
    """Return the canonical bytes of a conjunction; sensors and messages are sorted.

    `place` is from `place_bytes`, `previous` is the hash of the previous node, `direction` belongs to a way.
    Source: docs/spec/mission.md; Encoded graphs §III-A, Fig. 2, with tags for the paper's "+".
    """
    out = [_BEGIN, place]
    out += [_tlv(table.OF_SENSOR, digest) for digest in sorted(sha3_256(value) for value in sensors)]
    if action is not None:
        out.append(_tlv(table.OF_ACTION, action_bytes(action)))
    if window is not None:
        out.append(_tlv(table.OF_TIME, table.WINDOW.form.pack(window)))
    out += [_tlv(table.OF_MESSAGE, digest) for digest in sorted(sha3_256(value) for value in messages)]
    if previous is not None:
        out.append(_tlv(table.OF_PREVIOUS, previous))
    return with_direction(b"".join(out), direction) if direction else b"".join(out)


def with_direction(node: bytes, direction: Direction) -> bytes:
    """Return a node's canonical bytes followed by a direction; its hash encodes a way (paper profile)."""
    return node + _tlv(table.OF_DIRECTION, table.DIRECTION.form.pack(direction.sector, direction.of))


# The hashes of the paper profile, as published. They commit to the encoded values, but do not hide them: anyone can
# try all values (docs/spec/mission.md has the time needed). H_i of a node is the SHA3-256 of its canonical bytes.


def direction_hash(observed: bytes, sector: int, sectors: int) -> bytes:
    """Return H_ij of a way that is a direction, from the node's bytes and the sector. Source: Encoded graphs §IV-A."""
    return sha3_256(with_direction(observed, Direction(sector, sectors)))


def action_hash(mark: bytes, action: Action) -> bytes:
    """Return H_ij of a way that is an action: H(H_i + action). Source: Encoded graphs §III-A, Fig. 2."""
    return sha3_256(canonical(previous=mark, action=action))


def message_of(observed: bytes, index: int) -> bytes:
    """Return C_ij, the `index`-th message of a node, derived from its bytes. Source: Encoded graphs §III-B-3."""
    return sha3_256(table.MESSAGE + table.NTH.form.pack(index) + observed)
