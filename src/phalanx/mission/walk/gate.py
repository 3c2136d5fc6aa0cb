"""Gates: secrets that a robot needs before it can try to decode a node of the sealed profile, with hints what to try.

A node's payload has the gates of the next nodes. The gates of the first nodes are in a start key, which is sent to the
robot over the link and is not in the mission file.
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
    """Hint how to try one alias: the shape of the observables, and the offset of their cells, without the place."""

    shape: Shape
    offset: Offset = Offset()  # noqa: RUF009  # an immutable NamedTuple

    def encode(self) -> bytes:
        """Return the stored bytes, which also go into the KDF."""
        return table.HINT.form.pack(self.shape.code, *self.offset)


@dataclass(frozen=True, slots=True, repr=False)
class Gate:
    """The gate of a node, or a share of it if several predecessors must be decoded; and a hint for each alias."""

    share: bytes
    hints: tuple[Hint, ...]

    def encode(self) -> bytes:
        """Return the stored bytes; their length depends only on the number of aliases."""
        return table.GATE.form.pack(self.share, len(self.hints)) + b"".join(hint.encode() for hint in self.hints)

    def __repr__(self) -> str:
        return "<Gate>"


def parse_gate(reader: Reader) -> Gate:
    """Parse a gate at the reader's position. Raises: MalformedMission."""
    share, count = reader.unpack(table.GATE)
    hints = []
    for _ in range(count):
        code, *offset = reader.unpack(table.HINT)
        hints.append(Hint(parse_shape(code), Offset(*offset)))
    return Gate(share, tuple(hints))


def join_shares(shares: list[bytes]) -> bytes:
    """Return the gate with these shares: their exclusive or."""
    return bytes(reduce(xor, each) for each in zip(*shares, strict=True))


@dataclass(frozen=True, slots=True, repr=False)
class StartKey:
    """Secret to start a mission, kept outside its file: the gates of the first nodes, and the controllers' messages."""

    mission_id: bytes
    gates: dict[int, Gate]  # by node; empty in the paper profile
    messages: dict[str, bytes]  # by name, 32 bytes each

    def encode(self) -> bytes:
        """Return the bytes of the key file."""
        out = [table.START_KEY.form.pack(KEY_MAGIC, KEY_VERSION, self.mission_id, len(self.gates))]
        out += [table.OF_NODE.form.pack(node) + gate.encode() for node, gate in sorted(self.gates.items())]
        out.append(table.COUNT_U16.form.pack(len(self.messages)))
        out += [table.KEY_MESSAGE.encode(name=name.encode()) + value for name, value in sorted(self.messages.items())]
        return b"".join(out)

    def __repr__(self) -> str:
        return "<StartKey>"


def parse_start_key(raw: bytes) -> StartKey:
    """Parse a start key. Raises: MalformedMission."""
    reader = Reader(raw)
    magic, version, mission_id, count = reader.unpack(table.START_KEY)
    if magic != KEY_MAGIC:
        raise MalformedMission("not a start key")
    if version != KEY_VERSION:
        raise MalformedMission(f"start key of version {version}, not {KEY_VERSION}: build the mission again")
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
