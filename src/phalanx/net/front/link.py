"""One websocket of the front end: sending of frames, and detection of clients that do not read."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import socket
from collections.abc import Iterator

from phalanx.config.front import FrontConfig
from phalanx.net.site import Connection
from phalanx.pace import TokenBucket

READ_BYTES = 4 * 1024  # size of a read, which bounds a connection's unprocessed data; empty frames take 25 times that
SEND_BUFFER_BYTES = 32 * 1024  # send buffer of the kernel
SIOCOUTQNSD = 0x894B  # linux/sockios.h: unsent bytes in a socket's send buffer
CLOSE_NORMAL = (1000).to_bytes(2, "big")
BINARY, CLOSE, PONG = 2, 8, 10  # RFC 6455


class Link:
    """Websocket of one client.

    Attributes:
        number: connection number at the gateway; 0: none yet.
        until_s: deadline for admission, or for closing.
        pending: future of a message that waits to be forwarded to the gateway.
        data: that message.
    """

    def __init__(self, address: str, connection: Connection, limits: FrontConfig, now_s: float) -> None:
        self.number, self.address, self.connection = 0, address, connection
        self.is_admitted = self.is_closing = self.awaits_answer = False
        self.until_s = now_s + limits.first_message_s
        self.pending: asyncio.Future[None] | None = None
        self.data = b""
        self._limits = limits
        self._messages = TokenBucket(limits.messages_per_s, limits.messages_at_once, now_s)
        self._bytes = TokenBucket(limits.bytes_per_s, limits.bytes_at_once, now_s)
        self._written = self._taken = 0  # bytes written, and of these sent at the last check
        self._taken_at_s = now_s
        self._is_owed = False  # a message other than an update is unsent
        self._socket: socket.socket | None = None
        if transport := connection.transport:
            with contextlib.suppress(AttributeError):
                transport.max_size = READ_BYTES  # type: ignore[attr-defined]  # only asyncio's own loops have it
            self._socket = transport.get_extra_info("socket")
        if self._socket:
            with contextlib.suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)

    @property
    def queued_bytes(self) -> int:
        """Return the bytes queued in this process."""
        transport = self.connection.transport
        return transport.get_write_buffer_size() if isinstance(transport, asyncio.WriteTransport) else 0

    @property
    def unsent_bytes(self) -> int:
        """Return the unsent bytes, here or else in the kernel's buffer."""
        queued = self.queued_bytes
        if queued or self._socket is None:
            return queued
        try:
            raw = fcntl.ioctl(self._socket, SIOCOUTQNSD, bytes(4))
        except (OSError, ValueError):  # closed, or not supported by the system
            self._socket = None
            return 0
        return int.from_bytes(raw, "little")

    def wait_s(self, size: int, now_s: float) -> float:
        """Count a received message; return the delay that the rate limits of this connection require."""
        wait_s = max(self._messages.wait_s(now_s), self._bytes.wait_s(now_s))
        self._messages.use()
        self._bytes.use(size)
        return wait_s

    @contextlib.contextmanager
    def held_back(self) -> Iterator[None]:
        """Pause reading in this context, so that TCP flow control stops the client."""
        self.connection.pause_reading()
        try:
            yield
        finally:
            self.connection.resume_reading()

    def send(self, data: bytes, now_s: float) -> None:
        """Send a message; a client that does not read it in time is closed."""
        if not self._is_owed:
            self._is_owed, self._taken_at_s = True, now_s
        self.write(BINARY, data)
        if self.queued_bytes > self._limits.unsent_bytes:
            self.leave()

    def update(self, frame: bytes) -> None:
        """Send an update, unless earlier data is unsent: a queue would make every command late."""
        if not self.is_closing and not self.unsent_bytes:
            self._write(frame)

    def write(self, opcode: int, data: bytes) -> None:
        """Send a websocket frame."""
        self._write(frame_head(opcode, len(data)) + data)

    def end(self, reason: bytes, now_s: float) -> None:
        """Send a close frame after all earlier data."""
        self.is_closing = True
        self.until_s = now_s + self._limits.closing_s
        self.write(CLOSE, CLOSE_NORMAL + reason)

    def leave(self) -> None:
        """Close the connection at once."""
        self.connection.leave()

    def is_stalled(self, now_s: float) -> bool:
        """Return whether the client has read nothing for too long; call it a few times a second."""
        taken = self._written - self.unsent_bytes
        if taken != self._taken:
            self._taken, self._taken_at_s = taken, now_s
        if taken == self._written:
            self._is_owed, self._taken_at_s = False, now_s
        patience_s = self._limits.unread_s if self._is_owed else self._limits.stalled_s
        return now_s - self._taken_at_s >= patience_s

    def _write(self, frame: bytes) -> None:
        transport = self.connection.transport
        if isinstance(transport, asyncio.WriteTransport) and not transport.is_closing():
            transport.write(frame)
            self._written += len(frame)


def frame_head(opcode: int, length: int) -> bytes:
    """Return the header of a server's websocket frame with a payload of `length` bytes."""
    head = bytes([0x80 | opcode])
    if length < 126:
        return head + bytes([length])
    return head + (b"\x7e" + length.to_bytes(2, "big") if length < 65536 else b"\x7f" + length.to_bytes(8, "big"))
