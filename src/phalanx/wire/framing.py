"""Frames of the serial line: a payload with its CRC, without zeros (COBS), between two marks.

Rubbish costs the frame it hits and no other: whatever stands between two marks is a frame or is dropped.
Source: docs/spec/serial.md; S. Cheshire, M. Baker: Consistent Overhead Byte Stuffing, SIGCOMM 1997.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator

from phalanx.errors import PeerError

from .lines import CHECK, CRC_BYTES, MARK, RUN_MAX

_MARK = bytes([MARK])
_FULL = RUN_MAX + 1  # the length of a block that no zero follows


class BadFrame(PeerError):
    """Rubbish between two marks: altered, cut off, or never a frame."""


def framed(payload: bytes) -> bytes:
    """The frame of a payload."""
    rest = payload + zlib.crc32(payload).to_bytes(CRC_BYTES, "little")
    blocks, at = [_MARK], 0
    while True:
        end = rest.find(_MARK, at, at + RUN_MAX)
        if end < 0:
            end = min(len(rest), at + RUN_MAX)
        blocks += [bytes([end - at + 1]), rest[at:end]]
        if end == len(rest):
            return b"".join([*blocks, _MARK])
        at = end if end - at == RUN_MAX else end + 1


def opened(frame: bytes) -> bytes:
    """The payload of what stood between two marks.

    Raises: BadFrame.
    """
    rest, at = bytearray(), 0
    while at < len(frame):
        length = frame[at]
        if at + length > len(frame):
            raise BadFrame("a frame was cut off")
        rest += frame[at + 1 : at + length]
        at += length
        if length < _FULL and at < len(frame):
            rest += _MARK
    payload, crc = bytes(rest[:-CRC_BYTES]), bytes(rest[-CRC_BYTES:])
    if len(payload) < CHECK.size or zlib.crc32(payload).to_bytes(CRC_BYTES, "little") != crc:
        raise BadFrame("a frame was altered")
    return payload


class Frames:
    """The payloads in a stream of bytes that comes in pieces.

    Attributes:
        bad: pieces of rubbish so far.
    """

    def __init__(self, longest: int) -> None:
        """`longest` is a payload's most bytes: no more is kept of what has no mark."""
        self._longest = longest
        self._most = len(framed(bytes([RUN_MAX]) * longest))
        self._rest = b""
        self.bad = 0

    def feed(self, raw: bytes) -> Iterator[bytes]:
        """The payloads that are whole now."""
        *frames, rest = (self._rest + raw).split(_MARK)
        # Too long for a frame: of what is behind, up to the next mark, nothing counts.
        self._rest = rest[: self._most]
        for frame in filter(None, frames):
            try:
                payload = opened(frame) if len(frame) < self._most else b""
            except BadFrame:
                payload = b""
            if 0 < len(payload) <= self._longest:
                yield payload
            else:
                self.bad += 1
