"""What a search comes upon: the claim that shows it to auditors, and what the robot alone has of it."""

from __future__ import annotations

from dataclasses import dataclass

from phalanx.errors import TooLarge
from phalanx.mission.file.canonical import Reader, Shape, parse_shape
from phalanx.mission.observable import Action, Cell, Landmark, Offset
from phalanx.wire.missions import CLAIM

CLAIM_LIMIT = 16_384


@dataclass(frozen=True, slots=True)
class Claim:
    """A decoded node, as an auditor is shown it."""

    node: int
    alias: int
    shape: Shape
    offset: Offset  # of the cells; another than the compiler's opens nothing
    cell: Cell
    observed: bytes  # the canonical bytes that were hashed
    salt: bytes = b""  # of the KDF (sealed profile); says nothing about the gate that it was made of

    def encode(self) -> bytes:
        """As sent to an auditor."""
        head = (self.node, self.alias, self.shape.code, *self.offset, *self.cell, len(self.salt))
        return CLAIM.form.pack(*head) + self.salt + self.observed


def parse_claim(raw: bytes) -> Claim:
    """The claim in these bytes, of whatever robot sent them. Raises: TooLarge, MalformedMission."""
    if len(raw) > CLAIM_LIMIT:
        raise TooLarge(f"{len(raw)} bytes of claim, limit {CLAIM_LIMIT}")
    reader = Reader(raw)
    node, alias, code, *rest, salt = reader.unpack(CLAIM)
    offset, cell, salt = Offset(*rest[: len(Offset())]), Cell(*rest[len(Offset()) :]), reader.take(salt)
    return Claim(node, alias, parse_shape(code), offset, cell, reader.take(reader.left), salt)


@dataclass(frozen=True, slots=True)
class Found:
    """A match."""

    claim: Claim  # which alias of which node, and what it was made of
    seen: Landmark | None = None  # the landmark as it was seen
    action: Action | None = None
    key: bytes = b""  # what opens the node (sealed profile)
