"""Framing of the serial line: a payload and its CRC, encoded without zeros (COBS), between two zero bytes.

Noise on the line destroys only the frames it hits: bytes between two marks are a valid frame or are dropped.
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
    """The bytes between two marks are no valid frame: altered, cut off, or noise."""


def encode_frame(payload: bytes) -> bytes:
    """Encode a payload as a frame, with its marks."""
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


def decode_frame(frame: bytes) -> bytes:
    """Decode the bytes between two marks, and return the payload.

    Raises: BadFrame: cut off, or the CRC does not match.
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
    """Decoder for a stream of bytes that arrives in pieces.

    Attributes:
        bad: number of invalid frames so far.
    """

    def __init__(self, longest: int) -> None:
        """Limit payloads to `longest` bytes, and the buffer to one frame of that length."""
        self._longest = longest
        self._most = len(encode_frame(bytes([RUN_MAX]) * longest))
        self._rest = b""
        self.bad = 0

    def feed(self, raw: bytes) -> Iterator[bytes]:
        """Yield the payloads that these bytes complete."""
        *frames, rest = (self._rest + raw).split(_MARK)
        # An incomplete frame that is too long already: the bytes up to the next mark are dropped.
        self._rest = rest[: self._most]
        for frame in filter(None, frames):
            try:
                payload = decode_frame(frame) if len(frame) < self._most else b""
            except BadFrame:
                payload = b""
            if 0 < len(payload) <= self._longest:
                yield payload
            else:
                self.bad += 1
