"""Websockets of the front end: messages of clients to the gateway, its messages and updates to clients.

What a client sends is read no faster than its limits allow, and than the gateway processes what it was passed: then TCP
holds the client back. What a client does not take is not queued: an update is dropped, and for messages it is closed.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import time

from aiohttp import WSMsgType, web

from phalanx.config.front import FrontConfig
from phalanx.io.site import Connection, connection_of
from phalanx.io.websocket import BINARY, CLOSE, PONG, frame_head
from phalanx.wire.front import FromFront, ToFront, unpack_numbers

from .pace import Pace
from .pipe import Pipe
from .window import Window

READ_BYTES = 16 * 1024  # at once, of a connection: what it may have unread here
SEND_BUFFER_BYTES = 32 * 1024  # of the system: what is in it is late
CLOSE_NORMAL, CLOSE_REFUSED = (1000).to_bytes(2, "big"), (1008).to_bytes(2, "big")


class Link:
    """One websocket."""

    def __init__(self, number: int, address: str, connection: Connection, limits: FrontConfig, now_s: float) -> None:
        self.number, self.address, self.connection = number, address, connection
        self.is_admitted = self.is_opened = self.is_closing = False
        self.awaits_answer = False  # a newcomer, whose last message the gateway has not answered
        self.until_s = now_s + limits.first_message_s  # when it is closed, if it is not admitted by then
        self.unsent_since_s: float | None = None
        self.owed_since_s: float | None = None  # the same, for messages to it alone
        self.messages = Pace(limits.messages_per_s, limits.messages_at_once, now_s)
        self.bytes = Pace(limits.bytes_per_s, limits.bytes_at_once, now_s)

    @property
    def unsent_bytes(self) -> int:
        """Return how much waits for the client."""
        transport = self.connection.transport
        return transport.get_write_buffer_size() if isinstance(transport, asyncio.WriteTransport) else 0

    def write(self, opcode: int, data: bytes) -> None:
        """Send a frame."""
        self.write_raw(frame_head(opcode, len(data)) + data)

    def write_raw(self, frame: bytes) -> None:
        """Send a frame that is made already: a server masks none, so that it is the same for all."""
        transport = self.connection.transport
        if isinstance(transport, asyncio.WriteTransport) and not transport.is_closing():
            transport.write(frame)


class Links:
    """All websockets.

    Args:
        first: number of the first one.
    """

    def __init__(self, limits: FrontConfig, first: int) -> None:
        self.pipe: Pipe | None = None
        self._limits = limits
        self._next = first
        self._links: dict[int, Link] = {}  # that the gateway knows
        self._window = Window(limits, time.monotonic())

    # --- from clients ------------------------------------------------------------------------------------------------

    async def serve(self, request: web.Request, address: str) -> web.StreamResponse:
        """Serve a websocket until it ends."""
        limits, connection = self._limits, connection_of(request)
        _tune(request.transport)
        websocket = web.WebSocketResponse(
            autoclose=False, autoping=False, compress=False, max_msg_size=limits.message_bytes + 1
        )
        connection.upgrade()
        await websocket.prepare(request)
        link = Link(0, address, connection, limits, time.monotonic())
        try:
            await self._read(link, websocket)
        finally:
            self.drop(link)
            if request.transport:
                request.transport.close()
        return websocket

    async def _read(self, link: Link, websocket: web.WebSocketResponse) -> None:
        while True:
            message = await websocket.receive()
            if message.type is WSMsgType.BINARY:
                if not link.is_admitted and len(message.data) > self._limits.newcomer_message_bytes:
                    return
                await self._wait(link, len(message.data))
                if await self._window.turn(link):
                    self._pass_on(link, message.data)
            elif message.type is WSMsgType.PING:
                await self._wait(link, len(message.data))
                link.write(PONG, message.data)
            elif message.type is WSMsgType.PONG:
                await self._wait(link, len(message.data))
            else:
                if message.type is WSMsgType.CLOSE and not link.is_closing:
                    link.write(CLOSE, CLOSE_NORMAL)
                return

    async def _wait(self, link: Link, size: int) -> None:
        now_s = time.monotonic()
        link.messages.use()
        link.bytes.use(size)
        wait_s = max(link.messages.wait_s(now_s), link.bytes.wait_s(now_s))
        if wait_s:
            await asyncio.sleep(wait_s)

    def _pass_on(self, link: Link, data: bytes) -> None:
        assert self.pipe is not None
        if not link.is_opened:
            link.number, link.is_opened = self._next, True
            self._next += 1
            self._links[link.number] = link
            self.pipe.send(FromFront.OPENED, link.number, link.address.encode("ascii", "replace"))
            link.until_s = time.monotonic() + self._limits.admission_s
        self._window.passed(link)
        self.pipe.send(FromFront.RECEIVED, link.number, data)

    def drop(self, link: Link) -> None:
        """Forget a websocket."""
        self._window.drop(link)
        if link.number in self._links:
            assert self.pipe is not None
            del self._links[link.number]
            self.pipe.send(FromFront.CLOSED, link.number)

    # --- from the gateway --------------------------------------------------------------------------------------------

    def on_message(self, kind: int, number: int, content: bytes) -> None:
        """Do what the gateway says."""
        if kind == ToFront.PUBLISH:
            numbers, update = unpack_numbers(content, number)
            self._publish(numbers, update)
        elif kind == ToFront.TAKEN:
            self._window.taken(len(unpack_numbers(content, number)[0]))
        elif kind == ToFront.PROBE:
            assert self.pipe is not None
            self.pipe.send(FromFront.ALIVE)
        elif link := self._links.get(number):
            if kind == ToFront.SEND:
                self._send(link, content)
            elif kind == ToFront.ADMITTED:
                self._admit(link)
            elif kind == ToFront.CLOSE:
                self._close(link, content)

    def _publish(self, numbers: tuple[int, ...], update: bytes) -> None:
        frame = frame_head(BINARY, len(update)) + update
        for number in numbers:
            link = self._links.get(number)
            if link and not link.unsent_bytes and not link.is_closing:
                link.write_raw(frame)

    def _send(self, link: Link, data: bytes) -> None:
        link.write(BINARY, data)
        self._window.answered(link)

    def _admit(self, link: Link) -> None:
        link.is_admitted = True
        self._window.answered(link)

    def _close(self, link: Link, reason: bytes) -> None:
        link.is_closing = True
        link.write(CLOSE, CLOSE_NORMAL + reason)
        link.until_s = time.monotonic() + self._limits.closing_s
        self._window.answered(link)


def _tune(transport: asyncio.BaseTransport | None) -> None:
    """Keep little of a client's in memory, here and in the system."""
    if transport is None:
        return
    with contextlib.suppress(AttributeError):
        transport.max_size = READ_BYTES  # type: ignore[attr-defined]  # of one read, in asyncio's own event loop
    ours: socket.socket | None = transport.get_extra_info("socket")
    if ours is not None:
        with contextlib.suppress(OSError):
            ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
