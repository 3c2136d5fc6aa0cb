"""Evidence: what a c-node keeps of a reading that is too long for a chain, as its log holds it and auditors read it.

The chain has the reading's SHA-1. The reading itself is kept only to prove a claim: a robot can pretend not to have
seen a thing, but not to have seen one. Behind a scan's ranges stand other sensors' readings and the codes in the
camera's picture, each a `sensed`. A code's place follows from its corners. Source: docs/spec/mission.md (Under audit).
"""

from __future__ import annotations

import zlib
from typing import NamedTuple

import numpy as np

from phalanx.errors import PeerError
from phalanx.mission import Landmark
from phalanx.mission.file.canonical import Reader, text_of
from phalanx.mission.landmarks.codepose import Intrinsics, Mount, code_pose, qr_landmark
from phalanx.mission.landmarks.codes import PART_PX, SeenCode
from phalanx.mission.walk.claims import Claim, parse_claim
from phalanx.wire.missions import OF_CODE, OF_READING, SEEN_CODE, SENSED
from phalanx.wire.record import MalformedRecord
from phalanx.wire.table import KEPT, KEPT_CLAIM, RANGE

from .readings import SENSED_MAX_BYTES

CODE_EDGE_M = 0.12  # of all codes that robots read
Eye = tuple[Intrinsics, Mount]  # a camera, as far as it says where a code is


class BadEvidence(PeerError):
    """Not evidence, or not of the reading whose hash was chained."""


class Sensed(NamedTuple):
    """Readings of the other sensors at one moment."""

    readings: tuple[bytes, ...] = ()
    codes: tuple[SeenCode, ...] = ()


def reading_entry(reading: bytes) -> bytes:
    """A sensor's reading, as it stands behind a scan."""
    return SENSED.encode(kind=OF_READING, content=reading)


def code_entry(code: SeenCode) -> bytes:
    """A code in the camera's picture, as it stands behind a scan."""
    corners = np.rint(code.corners_px.ravel() / PART_PX).astype(np.int64).tolist()
    return SENSED.encode(kind=OF_CODE, content=SEEN_CODE.form.pack(*corners) + code.text.encode(errors="replace"))


def parse_sensed(raw: bytes) -> Sensed:
    """Parse the other sensors' readings behind a scan. Raises: PeerError: they are malformed."""
    if not raw:
        return Sensed()
    if len(raw) > SENSED_MAX_BYTES:
        raise MalformedRecord("more behind a scan than there is room for")
    reader = Reader(raw)
    readings: list[bytes] = []
    codes: list[SeenCode] = []
    while reader.left:
        kind, length = reader.unpack(SENSED)
        content = Reader(reader.take(length))
        if kind == OF_CODE:
            corners = np.array(content.unpack(SEEN_CODE), np.float64).reshape(4, 2) * PART_PX
            codes.append(SeenCode(text_of(content.take(content.left)), corners))
        elif kind == OF_READING and length:
            readings.append(content.raw)
        else:
            raise MalformedRecord("behind a scan stands what is no reading")
    return Sensed(tuple(readings), tuple(codes))


def codes_at(eye: Eye | None, pose: tuple[float, float, float], codes: tuple[SeenCode, ...]) -> tuple[Landmark, ...]:
    """Codes in a picture as landmarks, where a pose of the robot puts them; none of a robot without a camera."""
    if eye is None:
        return ()
    seen = [(code.text, code_pose(code.corners_px, CODE_EDGE_M, eye[0])) for code in codes]
    return tuple(qr_landmark(text, at, eye[1], *pose) for text, at in seen if at is not None)


def pack_evidence(claim: Claim | None, scan: bytes, sensed: bytes = b"") -> bytes:
    """Return the record `kept`: the claim or None, then the scan, u16 a beam, as zlib's of its differences.

    `scan` is b"" where the claim needs none; `sensed` is what stands behind it.
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
    """Return (claim, scan and what stands behind it) of what another robot's log holds.

    No more than a scan of so many beams is unpacked. Raises: BadEvidence, or what `parse_claim` raises.
    """
    reader = Reader(raw)
    count = reader.number(KEPT)
    if count > 1:
        raise BadEvidence(f"{count} claims at once")
    claim = parse_claim(reader.behind(KEPT_CLAIM)) if count else None
    if not reader.left:
        return claim, b""
    unpacker = zlib.decompressobj()
    try:
        unpacked = unpacker.decompress(reader.take(reader.left), 2 * beams + SENSED_MAX_BYTES)
        planes, sensed = unpacked[: 2 * beams], unpacked[2 * beams :]
        parse_sensed(sensed)
    except (zlib.error, PeerError) as error:
        raise BadEvidence("not a packed scan") from error
    if len(planes) != 2 * beams or not unpacker.eof or unpacker.unused_data:
        raise BadEvidence(f"a scan that is not {beams} beams")
    high, low = np.frombuffer(planes, np.uint8).reshape(2, beams).astype(np.uint16)
    return claim, np.cumsum(high << 8 | low, dtype=np.uint16).astype(RANGE.dtype).tobytes() + sensed
