"""One websocket of the front end: frames to a client, and what the client has not taken of them."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import socket
from collections.abc import Iterator

from phalanx.config.front import FrontConfig
from phalanx.net.site import Connection
from phalanx.pace import Pace

READ_BYTES = 4 * 1024  # at once, of a connection: what it may have unread here; as frames of nothing 25 times as much
SEND_BUFFER_BYTES = 32 * 1024  # of the system
SIOCOUTQNSD = 0x894B  # linux/sockios.h: bytes in a socket's send buffer that were not sent yet
CLOSE_NORMAL = (1000).to_bytes(2, "big")
BINARY, CLOSE, PONG = 2, 8, 10  # RFC 6455


class Link:
    """A websocket.

    Attributes:
        number: as the gateway knows it; 0: not yet.
        until_s: when it is closed, if it is not admitted by then, or is closing.
        pending: of a message that waits to be passed on.
        data: that message.
    """

    def __init__(self, address: str, connection: Connection, limits: FrontConfig, now_s: float) -> None:
        self.number, self.address, self.connection = 0, address, connection
        self.is_admitted = self.is_closing = self.awaits_answer = False
        self.until_s = now_s + limits.first_message_s
        self.pending: asyncio.Future[None] | None = None
        self.data = b""
        self._limits = limits
        self._messages = Pace(limits.messages_per_s, limits.messages_at_once, now_s)
        self._bytes = Pace(limits.bytes_per_s, limits.bytes_at_once, now_s)
        self._written = self._taken = 0  # bytes; as far as the client has taken them at the last look
        self._taken_at_s = now_s
        self._is_owed = False  # a message to it alone is unsent
        self._socket: socket.socket | None = None
        if transport := connection.transport:
            with contextlib.suppress(AttributeError):
                transport.max_size = READ_BYTES  # type: ignore[attr-defined]  # of a read, in asyncio's own loops
            self._socket = transport.get_extra_info("socket")
        if self._socket:
            with contextlib.suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)

    @property
    def queued_bytes(self) -> int:
        """Return how much waits in this process."""
        transport = self.connection.transport
        return transport.get_write_buffer_size() if isinstance(transport, asyncio.WriteTransport) else 0

    @property
    def unsent_bytes(self) -> int:
        """Return how much waits here and in the system, because the client or its line takes no more."""
        queued = self.queued_bytes
        if queued or self._socket is None:
            return queued
        try:
            raw = fcntl.ioctl(self._socket, SIOCOUTQNSD, bytes(4))
        except (OSError, ValueError):  # closed, or a system that does not know
            self._socket = None
            return 0
        return int.from_bytes(raw, "little")

    def wait_s(self, size: int, now_s: float) -> float:
        """Count the message just read, and return how long it must wait for the rates of this connection."""
        wait_s = max(self._messages.wait_s(now_s), self._bytes.wait_s(now_s))
        self._messages.use()
        self._bytes.use(size)
        return wait_s

    @contextlib.contextmanager
    def held_back(self) -> Iterator[None]:
        """Read nothing more of the client in this context, so that TCP holds it back."""
        self.connection.pause_reading()
        try:
            yield
        finally:
            self.connection.resume_reading()

    def send(self, data: bytes, now_s: float) -> None:
        """Send a message; the client must take it in time."""
        if not self._is_owed:
            self._is_owed, self._taken_at_s = True, now_s
        self.write(BINARY, data)
        if self.queued_bytes > self._limits.unsent_bytes:
            self.leave()

    def update(self, frame: bytes) -> None:
        """Send a frame, unless what was sent before is unsent: queues make every command late."""
        if not self.is_closing and not self.unsent_bytes:
            self._write(frame)

    def write(self, opcode: int, data: bytes) -> None:
        """Send a frame of a websocket."""
        self._write(frame_head(opcode, len(data)) + data)

    def end(self, reason: bytes, now_s: float) -> None:
        """Close the websocket after what was sent."""
        self.is_closing = True
        self.until_s = now_s + self._limits.closing_s
        self.write(CLOSE, CLOSE_NORMAL + reason)

    def leave(self) -> None:
        """Close the connection at once."""
        self.connection.leave()

    def is_stalled(self, now_s: float) -> bool:
        """Return whether the client has taken nothing for too long; call it a few times a second."""
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
    """Return what comes before `length` bytes of a server's frame."""
    head = bytes([0x80 | opcode])
    if length < 126:
        return head + bytes([length])
    return head + (b"\x7e" + length.to_bytes(2, "big") if length < 65536 else b"\x7f" + length.to_bytes(8, "big"))
