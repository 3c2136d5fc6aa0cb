"""Message framing on the socket between a front end and its gateway, with one write per turn of the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from phalanx.wire.front import FRONT_HEAD
from phalanx.wire.record import MalformedRecord

_HEAD = FRONT_HEAD.form

OnMessage = Callable[[int, int, bytes], None]  # kind, number, content
OnLost = Callable[[Exception | None], None]


class Pipe(asyncio.Protocol):
    """Protocol of one end of the socket.

    Args:
        longest: longest content of a received message, bytes. A longer one ends the connection, and so does a message
            for which `on_message` raises MalformedRecord.
    """

    def __init__(self, longest: int, on_message: OnMessage, on_lost: OnLost) -> None:
        self._longest = longest
        self._on_message, self._on_lost = on_message, on_lost
        self._received = bytearray()
        self._unsent: list[bytes] = []
        self._unsent_bytes = 0
        self._transport: asyncio.Transport | None = None

    @property
    def unsent_bytes(self) -> int:
        """Return the bytes that the other end has not read yet."""
        return self._unsent_bytes + (self._transport.get_write_buffer_size() if self._transport else 0)

    def send(self, kind: int, number: int = 0, *content: bytes) -> None:
        """Send a message; it is dropped if the connection is closed."""
        if self._transport is None or self._transport.is_closing():
            return
        if not self._unsent:
            asyncio.get_running_loop().call_soon(self._flush)
        head = _HEAD.pack(sum(map(len, content)), kind, number)
        self._unsent += (head, *content)
        self._unsent_bytes += len(head) + sum(map(len, content))

    def close(self) -> None:
        """Close the connection at once."""
        if self._transport:
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Store the transport."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """Process complete messages."""
        self._received += data
        raw = bytes(self._received)
        at = 0
        try:
            while len(raw) - at >= _HEAD.size:
                length, kind, number = _HEAD.unpack_from(raw, at)
                if length > self._longest:
                    raise MalformedRecord(f"a message of {length} bytes")
                end = at + _HEAD.size + length
                if end > len(raw):
                    break
                self._on_message(kind, number, raw[at + _HEAD.size : end])
                at = end
        except MalformedRecord as error:
            self._lose(error)
        del self._received[:at]

    def connection_lost(self, error: Exception | None) -> None:
        """Call `on_lost`, once."""
        self._lose(error)

    def _lose(self, error: Exception | None) -> None:
        if self._transport is not None:
            self._transport.abort()
            self._transport = None
            self._unsent.clear()
            self._on_lost(error)

    def _flush(self) -> None:
        if self._transport:
            self._transport.write(b"".join(self._unsent))
        self._unsent.clear()
        self._unsent_bytes = 0
