"""Claims: let an auditor check a decode without repeating the search, and without learning the gates behind the node.

A robot that decoded a node shows the bytes that it hashed. The auditor checks with one hash or KDF that they open the
node, and makes the same canonical bytes again from the logged sensor reading. So a robot can pretend not to have seen a
landmark, but cannot pretend to have seen one.
"""

from __future__ import annotations

from dataclasses import dataclass

from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.crypto.sha3 import sha3_256
from phalanx.errors import PeerError, TooLarge
from phalanx.mission.file import sealed
from phalanx.mission.file.canonical import Reader, Shape, parse_shape
from phalanx.mission.file.records import EncodedMission, Profile
from phalanx.mission.observable import OFFSET_M2, OFFSET_RAD, Action, Cell, Experience, Landmark, Offset
from phalanx.wire.missions import CLAIM

from .gate import Hint
from .search import is_around, placed, pose_uncertainty

CLAIM_LIMIT = 16_384


@dataclass(frozen=True, slots=True)
class Claim:
    """Evidence for an auditor that a node was decoded."""

    node: int
    alias: int
    shape: Shape
    offset: Offset  # of the cells; only the compiler's offset opens the node
    cell: Cell
    observed: bytes  # the canonical bytes that were hashed
    salt: bytes = b""  # of the KDF (sealed profile); reveals nothing about the gate that it was derived from

    def encode(self) -> bytes:
        """Return the bytes to send to an auditor."""
        head = (self.node, self.alias, self.shape.code, *self.offset, *self.cell, len(self.salt))
        return CLAIM.form.pack(*head) + self.salt + self.observed


def parse_claim(raw: bytes) -> Claim:
    """Parse a claim from untrusted bytes. Raises: TooLarge, MalformedMission."""
    if len(raw) > CLAIM_LIMIT:
        raise TooLarge(f"{len(raw)} bytes of claim, limit {CLAIM_LIMIT}")
    reader = Reader(raw)
    node, alias, code, *rest, salt = reader.unpack(CLAIM)
    offset, cell, salt = Offset(*rest[: len(Offset())]), Cell(*rest[len(Offset()) :]), reader.take(salt)
    return Claim(node, alias, parse_shape(code), offset, cell, reader.take(reader.left), salt)


@dataclass(frozen=True, slots=True)
class Found:
    """A match of the search."""

    claim: Claim  # node, alias, and the hashed bytes
    seen: Landmark | None = None  # the landmark as seen
    action: Action | None = None
    key: bytes = b""  # opens the node (sealed profile)


class Unshown(PeerError):
    """The robot's reading, its state or the mission file does not support its claim."""


def unlock(mission: EncodedMission, claim: Claim) -> bytes | None:
    """Try to unlock the node with one hash or KDF; return its key (sealed), b"" (paper), or None if it fails."""
    if not 0 <= claim.node < len(mission.nodes) or not 0 <= claim.alias < len(mission.nodes[claim.node].aliases):
        return None
    alias = mission.nodes[claim.node].aliases[claim.alias]
    if mission.header.profile is Profile.PAPER:
        return b"" if alias.offset == claim.offset and sha3_256(claim.observed) == alias.mark else None
    hint = Hint(claim.shape, claim.offset)
    mark, key = sealed.try_observation(mission.header, claim.observed, hint, claim.salt)
    return key if mark == alias.mark else None


def match_of_claim(
    mission: EncodedMission,
    config: MissionConfig,
    claim: Claim,
    seen: Experience,
    heard: tuple[bytes, ...] = (),
    released: bytes = b"",
) -> Found | None:
    """Return the match, without its key, that a search in this experience would find for the claim, or None.

    Args:
        seen: made from the logged reading.
        heard: messages received so far (paper profile).
        released: hash H of the previous node, for chained nodes (paper profile).
    """
    coding = mission.header.coding
    if not _is_offset(coding, claim.offset) or not 0 <= claim.node < len(mission.nodes):
        return None
    shape, is_paper = claim.shape, mission.header.profile is Profile.PAPER
    doubt = pose_uncertainty(config, seen)
    messages = heard if is_paper else (b"",) * shape.messages
    reach_dm = mission.nodes[claim.node].reach_dm
    for variant, at in placed(shape, coding, seen, messages, claim.offset, reach_dm):
        if shape.place and not is_around(shape, coding, doubt, variant.landmark, at, claim.offset, claim.cell):
            continue
        previous = released if shape.previous else None
        if variant.canonical(shape, claim.cell, variant.messages if is_paper else (), previous) == claim.observed:
            return Found(claim, variant.landmark, variant.action)
    return None


def _is_offset(coding: CodingConfig, offset: Offset) -> bool:
    """Return True if each part of an offset is at most half a cell, bin or step.

    With a larger offset a compromised robot could move any orientation into the bin that opens the node.
    """
    place = max(abs(offset.x), abs(offset.y)) <= coding.delta_mm // 2 + 1
    orientation = abs(offset.orientation) * OFFSET_RAD <= coding.bin_rad / 2 + OFFSET_RAD
    return place and orientation and abs(offset.area) * OFFSET_M2 <= coding.area_m2 / 2 + OFFSET_M2
