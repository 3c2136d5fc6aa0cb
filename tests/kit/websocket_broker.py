"""A broker's end of a websocket, from bytes to bytes: for tests that play a hostile broker."""

from __future__ import annotations

import base64
import hashlib
import itertools

MAGIC = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"


class BrokerEnd:
    """Answers the handshake with `replies`, and unmasks what a client says."""

    def __init__(self) -> None:
        self.replies = b""
        self._came, self._is_open = bytearray(), False

    def read(self, data: bytes) -> bytes:
        """Return what whole frames carry."""
        self._came += data
        if not self._is_open:
            head, end, rest = bytes(self._came).partition(b"\r\n\r\n")
            if not end:
                return b""
            (key,) = (
                line[18:].strip() for line in head.split(b"\r\n") if line.lower().startswith(b"sec-websocket-key")
            )
            accept = base64.b64encode(hashlib.sha1(key + MAGIC, usedforsecurity=False).digest())
            self.replies = b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            self.replies += b"Sec-WebSocket-Accept: " + accept + b"\r\nSec-WebSocket-Protocol: mqtt\r\n\r\n"
            self._came, self._is_open = bytearray(rest), True
        carried = b""
        while len(self._came) > 1:
            assert self._came[1] & 128, "a client masks"
            short = self._came[1] & 127
            size = 2 + {126: 2, 127: 8}.get(short, 0)
            length = short if short < 126 else int.from_bytes(self._came[2:size], "big")
            if len(self._came) < size + 4 + length:
                break
            mask, masked = self._came[size : size + 4], self._came[size + 4 : size + 4 + length]
            carried += bytes(a ^ b for a, b in zip(masked, itertools.cycle(mask), strict=False))
            del self._came[: size + 4 + length]
        return carried
