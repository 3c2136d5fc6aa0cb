"""Evidence: logged sensor data of which the chained reading has only a hash.

The chain has the data's SHA-1. The data itself is logged only to prove a claim: a robot can hide an observation, but
not invent one. After a scan's ranges follow other sensors' readings and the codes in the camera's image, each as a
`sensed`. A code's position follows from its corners. Source: docs/spec/mission.md (Under audit).
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

CODE_EDGE_M = 0.12  # edge of all codes that robots read
Eye = tuple[Intrinsics, Mount]  # the parameters of a camera that locate a code


class BadEvidence(PeerError):
    """Error: malformed evidence, or its hash is not the chained one."""


class Sensed(NamedTuple):
    """Readings of the other sensors at one moment."""

    readings: tuple[bytes, ...] = ()
    codes: tuple[SeenCode, ...] = ()


def reading_entry(reading: bytes) -> bytes:
    """Encode a sensor's reading as an entry after a scan."""
    return SENSED.encode(kind=OF_READING, content=reading)


def code_entry(code: SeenCode) -> bytes:
    """Encode a code in the camera's image as an entry after a scan."""
    corners = np.rint(code.corners_px.ravel() / PART_PX).astype(np.int64).tolist()
    return SENSED.encode(kind=OF_CODE, content=SEEN_CODE.form.pack(*corners) + code.text.encode(errors="replace"))


def parse_sensed(raw: bytes) -> Sensed:
    """Parse the entries after a scan. Raises: PeerError: they are malformed."""
    if not raw:
        return Sensed()
    if len(raw) > SENSED_MAX_BYTES:
        raise MalformedRecord(f"more than {SENSED_MAX_BYTES} bytes after a scan")
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
            raise MalformedRecord("unknown or empty entry after a scan")
    return Sensed(tuple(readings), tuple(codes))


def codes_at(eye: Eye | None, pose: tuple[float, float, float], codes: tuple[SeenCode, ...]) -> tuple[Landmark, ...]:
    """Return codes in an image as landmarks, positioned by the robot's pose; none without a camera."""
    if eye is None:
        return ()
    seen = [(code.text, code_pose(code.corners_px, CODE_EDGE_M, eye[0])) for code in codes]
    return tuple(qr_landmark(text, at, eye[1], *pose) for text, at in seen if at is not None)


def pack_evidence(claim: Claim | None, scan: bytes, sensed: bytes = b"") -> bytes:
    """Encode the record `kept`: an optional claim, then the scan, u16 per beam, as compressed differences.

    `scan` is b"" if the claim needs none; `sensed` are the entries after it.
    """
    claimed = KEPT_CLAIM.encode(claim=claim.encode()) if claim else b""
    packed = b""
    if scan:
        steps = np.diff(np.frombuffer(scan, RANGE.dtype), prepend=np.uint16(0)).astype(RANGE.dtype)
        # All high bytes first, then all low ones: most high bytes are equal, which compresses well.
        high, low = (steps >> 8).astype(np.uint8).tobytes(), (steps & 255).astype(np.uint8).tobytes()
        packed = zlib.compress(high + low + sensed)
    return KEPT.encode(claims=int(claim is not None), shown=claimed + packed)


def unpack_evidence(raw: bytes, beams: int) -> tuple[Claim | None, bytes]:
    """Decode evidence of another robot's log into the claim and the raw data (scan and entries).

    Decompression is limited to a scan of `beams`. Raises: BadEvidence, and exceptions of `parse_claim`.
    """
    reader = Reader(raw)
    count = reader.number(KEPT)
    if count > 1:
        raise BadEvidence(f"{count} claims instead of 0 or 1")
    claim = parse_claim(reader.behind(KEPT_CLAIM)) if count else None
    if not reader.left:
        return claim, b""
    unpacker = zlib.decompressobj()
    try:
        unpacked = unpacker.decompress(reader.take(reader.left), 2 * beams + SENSED_MAX_BYTES)
        planes, sensed = unpacked[: 2 * beams], unpacked[2 * beams :]
        parse_sensed(sensed)
    except (zlib.error, PeerError) as error:
        raise BadEvidence("not a compressed scan") from error
    if len(planes) != 2 * beams or not unpacker.eof or unpacker.unused_data:
        raise BadEvidence(f"not a scan of {beams} beams")
    high, low = np.frombuffer(planes, np.uint8).reshape(2, beams).astype(np.uint16)
    return claim, np.cumsum(high << 8 | low, dtype=np.uint16).astype(RANGE.dtype).tobytes() + sensed
