"""What a c-node keeps of a reading that is too long for a chain: evidence, as its log holds it and auditors read it.

The chain has the reading's SHA-1. The reading itself is kept only where the controller claims something on the strength
of it, so a robot can pretend not to have seen a thing, and cannot pretend to have seen one.
"""

from __future__ import annotations

import zlib

import numpy as np

from phalanx.errors import PeerError
from phalanx.mission.file.reader import Reader
from phalanx.mission.walk.claims import Claim, parse_claim
from phalanx.wire.table import KEPT, KEPT_CLAIM, RANGE

from .readings import SENSED_MAX_BYTES
from .sensed import parse_sensed


class BadEvidence(PeerError):
    """Not evidence, or not of the reading whose hash was chained."""

    reason = "bad_evidence"


def pack_evidence(claim: Claim | None, scan: bytes, sensed: bytes = b"") -> bytes:
    """The record `kept`: the claim, then the scan, u16 a beam, as zlib's of its differences.

    Args:
        claim: None where only the scan is to be seen.
        scan: b"" where the claim needs none.
        sensed: what stands behind it, as other sensors read it.
    """
    claimed = KEPT_CLAIM.encode(claim=claim.encode()) if claim else b""
    packed = b""
    if scan:
        steps = np.diff(np.frombuffer(scan, RANGE.dtype), prepend=np.uint16(0)).astype(RANGE.dtype)
        # High bytes first, then low ones: the high ones are nearly all alike.
        high, low = (steps >> 8).astype(np.uint8).tobytes(), (steps & 255).astype(np.uint8).tobytes()
        packed = zlib.compress(high + low + sensed)
    return KEPT.encode(claims=int(claim is not None), shown=claimed + packed)


def unpack_evidence(raw: bytes, beams: int) -> tuple[Claim | None, bytes]:
    """(claim, scan and what stands behind it) of what another robot's log holds.

    Args:
        beams: of a scan; no more is unpacked, whatever the bytes would unpack to.
    Raises: BadEvidence, or what `parse_claim` raises.
    """
    reader = Reader(raw)
    count = reader.number(KEPT)
    if count > 1:
        raise BadEvidence(f"{count} claims at once")
    claim = parse_claim(reader.behind(KEPT_CLAIM)) if count else None
    return claim, _unpack_scan(reader.take(reader.left), beams) if reader.left else b""


def _unpack_scan(packed: bytes, beams: int) -> bytes:
    unpacker = zlib.decompressobj()
    try:
        unpacked = unpacker.decompress(packed, 2 * beams + SENSED_MAX_BYTES)
        planes, sensed = unpacked[: 2 * beams], unpacked[2 * beams :]
        parse_sensed(sensed)
    except (zlib.error, PeerError) as error:
        raise BadEvidence("not a packed scan") from error
    if len(planes) != 2 * beams or not unpacker.eof or unpacker.unused_data:
        raise BadEvidence(f"a scan that is not {beams} beams")
    high, low = np.frombuffer(planes, np.uint8).reshape(2, beams).astype(np.uint16)
    return np.cumsum(high << 8 | low, dtype=np.uint16).astype(RANGE.dtype).tobytes() + sensed
