"""Gates: what a robot must hold before it can try a node of the sealed profile at all, and what it may try.

A node's payload hands out the gates of the nodes after it; the gates of the first nodes travel in a start key, which
goes to the robot over the link and is not in the file.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from operator import xor

from phalanx.mission.file.canonical import Reader, Shape, parse_shape, text_of
from phalanx.mission.file.records import SECRET_BYTES
from phalanx.mission.observable import Offset
from phalanx.mission.refused import MalformedMission
from phalanx.wire import missions as table

KEY_MAGIC = b"PHXK"
KEY_VERSION = 2


@dataclass(frozen=True, slots=True)
class Hint:
    """Hint for one alias without its place: the shape to measure, and the offset of its cells."""

    shape: Shape
    offset: Offset = Offset()  # noqa: RUF009  # a NamedTuple: nobody can change it

    def encode(self) -> bytes:
        """As stored, and as what it opens is bound to."""
        return table.HINT.form.pack(self.shape.code, *self.offset)


@dataclass(frozen=True, slots=True, repr=False)
class Gate:
    """One node's gate, or one share of it where several predecessors must agree; and a hint for each alias."""

    share: bytes
    hints: tuple[Hint, ...]

    def encode(self) -> bytes:
        """As stored, always of the same length for the same number of aliases."""
        return table.GATE.form.pack(self.share, len(self.hints)) + b"".join(hint.encode() for hint in self.hints)

    def __repr__(self) -> str:
        return "<Gate>"


def parse_gate(reader: Reader) -> Gate:
    """The gate that comes next. Raises: MalformedMission."""
    share, count = reader.unpack(table.GATE)
    hints = []
    for _ in range(count):
        code, *offset = reader.unpack(table.HINT)
        hints.append(Hint(parse_shape(code), Offset(*offset)))
    return Gate(share, tuple(hints))


def join_shares(shares: list[bytes]) -> bytes:
    """The gate whose shares these are: their exclusive or."""
    return bytes(reduce(xor, each) for each in zip(*shares, strict=True))


@dataclass(frozen=True, slots=True, repr=False)
class StartKey:
    """Secret that is not in the file: the gates of the first nodes, and the controllers' messages."""

    mission_id: bytes
    gates: dict[int, Gate]  # by node; none in the paper profile
    messages: dict[str, bytes]  # by name, 32 bytes each

    def encode(self) -> bytes:
        """The key file."""
        out = [table.START_KEY.form.pack(KEY_MAGIC, KEY_VERSION, self.mission_id, len(self.gates))]
        out += [table.OF_NODE.form.pack(node) + gate.encode() for node, gate in sorted(self.gates.items())]
        out.append(table.COUNT_U16.form.pack(len(self.messages)))
        out += [table.KEY_MESSAGE.encode(name=name.encode()) + value for name, value in sorted(self.messages.items())]
        return b"".join(out)

    def __repr__(self) -> str:
        return "<StartKey>"


def parse_start_key(raw: bytes) -> StartKey:
    """The start key in these bytes. Raises: MalformedMission."""
    reader = Reader(raw)
    magic, version, mission_id, count = reader.unpack(table.START_KEY)
    if magic != KEY_MAGIC:
        raise MalformedMission("not a start key")
    if version != KEY_VERSION:
        raise MalformedMission(f"a start key of version {version}, not {KEY_VERSION}: build the mission again")
    gates: dict[int, Gate] = {}
    messages: dict[str, bytes] = {}
    for _ in range(count):
        node = reader.number(table.OF_NODE)
        if gates and node <= next(reversed(gates)):
            raise MalformedMission("gates are not in order")
        gates[node] = parse_gate(reader)
    for _ in range(reader.number(table.COUNT_U16)):
        name = text_of(reader.behind(table.KEY_MESSAGE))
        messages[name] = reader.take(SECRET_BYTES)
    reader.end()
    return StartKey(mission_id, gates, messages)
