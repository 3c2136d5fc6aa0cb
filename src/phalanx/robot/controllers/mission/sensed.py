"""What stands behind a scan's ranges: what other sensors read, and the codes in the camera's picture, each a `sensed`.

It is hashed with the scan. Where a code is follows from its corners, by robot and auditor alike; no picture is kept.
Source: docs/spec/mission.md (Under audit).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phalanx.mission import Landmark
from phalanx.mission.file.canonical import Reader, text_of
from phalanx.mission.landmarks.codepose import Intrinsics, Mount, code_pose, qr_landmark
from phalanx.mission.landmarks.codes import PART_PX, SeenCode
from phalanx.wire.missions import OF_CODE, OF_READING, SEEN_CODE, SENSED
from phalanx.wire.record import MalformedRecord

from .readings import SENSED_MAX_BYTES

CODE_EDGE_M = 0.12  # of all codes that robots read
Eye = tuple[Intrinsics, Mount]  # a camera, as far as it says where a code is


class Sensed(NamedTuple):
    """What other sensors read in one moment."""

    readings: tuple[bytes, ...] = ()
    codes: tuple[SeenCode, ...] = ()


_NOTHING = Sensed()


def reading_entry(reading: bytes) -> bytes:
    """A sensor's reading, as it stands behind a scan."""
    return SENSED.encode(kind=OF_READING, content=reading)


def code_entry(code: SeenCode) -> bytes:
    """A code in the camera's picture, as it stands behind a scan."""
    corners = np.rint(code.corners_px.ravel() / PART_PX).astype(np.int64).tolist()
    return SENSED.encode(kind=OF_CODE, content=SEEN_CODE.form.pack(*corners) + code.text.encode(errors="replace"))


def parse_sensed(raw: bytes) -> Sensed:
    """What other sensors read, by what stands behind a scan. Raises: PeerError: something else does."""
    if not raw:
        return _NOTHING
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
