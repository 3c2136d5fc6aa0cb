"""Gates: what a robot must hold before it can try a node of the sealed profile at all, and what it may try.

A node's payload hands out the gates of the nodes after it; the gates of the first nodes travel in a start key, which
goes to the robot over the link and is not in the file.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from phalanx.mission.file.canonical import Shape, parse_shape
from phalanx.mission.file.reader import Reader, text_of
from phalanx.mission.file.records import SECRET_BYTES
from phalanx.mission.observable import Offset
from phalanx.mission.refused import MalformedMission

KEY_MAGIC = b"PHXK\x01"
_HINT = struct.Struct("<Hhhhh")
MESSAGE_LIMIT = 1024


@dataclass(frozen=True, slots=True)
class Hint:
    """What to measure for one alias, without where it is: the shape, and the offset of its cells."""

    shape: Shape
    offset: Offset = Offset()  # noqa: RUF009  # a NamedTuple: nobody can change it

    def encode(self) -> bytes:
        """As stored, and as what it opens is bound to."""
        return _HINT.pack(self.shape.code, *self.offset)


@dataclass(frozen=True, slots=True, repr=False)
class Gate:
    """One node's gate, or one share of it where several predecessors must agree; and a hint for each alias."""

    share: bytes
    hints: tuple[Hint, ...]

    def encode(self) -> bytes:
        """As stored, always of the same length for the same number of aliases."""
        hints = b"".join(hint.encode() for hint in self.hints)
        return self.share + bytes([len(self.hints)]) + hints

    def __repr__(self) -> str:
        return "<Gate>"


def parse_gate(reader: Reader) -> Gate:
    """The gate that comes next.

    Raises: MalformedMission.
    """
    share = reader.take(SECRET_BYTES)
    hints = []
    for _ in range(reader.number(1)):
        code, *offset = reader.unpack(_HINT)
        hints.append(Hint(parse_shape(code), Offset(*offset)))
    return Gate(share, tuple(hints))


def join_shares(shares: list[bytes]) -> bytes:
    """The gate whose shares these are: their exclusive or."""
    joined = 0
    for share in shares:
        joined ^= int.from_bytes(share, "little")
    return joined.to_bytes(SECRET_BYTES, "little")


@dataclass(frozen=True, slots=True, repr=False)
class StartKey:
    """What is not in the file: the gates of the first nodes, and the messages that a controller sends.

    Args:
        mission_id: the mission it belongs to.
        gates: by node; none in the paper profile.
        messages: by name, 32 bytes each.
    """

    mission_id: bytes
    gates: dict[int, Gate]
    messages: dict[str, bytes]

    def encode(self) -> bytes:
        """The key file."""
        out = [KEY_MAGIC, self.mission_id, struct.pack("<I", len(self.gates))]
        out += [struct.pack("<I", node) + gate.encode() for node, gate in sorted(self.gates.items())]
        out.append(struct.pack("<H", len(self.messages)))
        for name, value in sorted(self.messages.items()):
            raw = name.encode()
            out.append(bytes([len(raw)]) + raw + value)
        return b"".join(out)

    def __repr__(self) -> str:
        return "<StartKey>"


def parse_start_key(raw: bytes) -> StartKey:
    """The start key in these bytes.

    Raises: MalformedMission.
    """
    reader = Reader(raw)
    if reader.take(len(KEY_MAGIC)) != KEY_MAGIC:
        raise MalformedMission("not a start key of this version")
    mission_id = reader.take(16)
    gates: dict[int, Gate] = {}
    messages: dict[str, bytes] = {}
    for _ in range(reader.number(4)):
        node = reader.number(4)
        if gates and node <= next(reversed(gates)):
            raise MalformedMission("gates are not in order")
        gates[node] = parse_gate(reader)
    for _ in range(reader.number(2)):
        name = text_of(reader.short())
        messages[name] = reader.take(SECRET_BYTES)
    reader.end()
    return StartKey(mission_id, gates, messages)
