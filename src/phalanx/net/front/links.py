"""Websockets of the front end: forwards clients' messages to the gateway, and its messages and updates to clients.

A client is read no faster than its limits allow and the gateway processes its messages; TCP flow control stops it.
For a client that does not read, updates are dropped, and unread messages close its connection.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

from aiohttp import WSMsgType, web

from phalanx.config.front import FrontConfig
from phalanx.net.site import Connection, connection_of
from phalanx.wire.front import FromFront, ToFront, unpack_numbers

from .link import BINARY, CLOSE, CLOSE_NORMAL, PONG, Link, frame_head
from .newcomers import Newcomers
from .pipe import Pipe
from .window import Window


class Links:
    """All websockets of the front end.

    Args:
        first: connection number of the first websocket.
        on_admitted: called with each connection that the gateway admits.
        on_refused: called with the address of each client that the gateway refuses.
    """

    def __init__(
        self,
        limits: FrontConfig,
        newcomers: Newcomers,
        first: int,
        on_admitted: Callable[[Connection], None],
        on_refused: Callable[[str], None],
    ) -> None:
        self.pipe: Pipe | None = None
        self._limits, self._newcomers, self._on_admitted = limits, newcomers, on_admitted
        self._on_refused = on_refused
        self._next = first
        self._links: dict[int, Link] = {}  # websockets with a number, which the gateway knows
        self._window: Window[Link] = Window(limits, self._pass_on, time.monotonic())

    # --- from clients ---

    async def serve(self, request: web.Request, address: str) -> web.StreamResponse:
        """Serve a websocket until it is closed."""
        connection, longest = connection_of(request), self._limits.message_bytes + 1
        websocket = web.WebSocketResponse(autoclose=False, autoping=False, compress=False, max_msg_size=longest)
        connection.upgrade()
        link = Link(address, connection, self._limits, time.monotonic())
        connection.on_lost = lambda: self._drop(link)
        self._newcomers.add(address, link)
        try:
            await websocket.prepare(request)
            await self._read(link, websocket)
        finally:
            self._drop(link)
            if transport := request.transport:
                transport.close()
                # Buffered data goes out first, for a limited time.
                asyncio.get_running_loop().call_later(self._limits.closing_s, transport.abort)
        return websocket

    async def _read(self, link: Link, websocket: web.WebSocketResponse) -> None:
        while True:
            message = await websocket.receive()
            match message.type:
                case WSMsgType.BINARY:
                    if not link.is_admitted and len(message.data) > self._limits.newcomer_message_bytes:
                        return
                    await self._wait(link, len(message.data))
                    if not link.is_closing:
                        link.data = message.data
                        if not self._window.go(link):
                            with link.held_back():
                                await self._window.turn(link)
                case WSMsgType.PING:
                    await self._wait(link, len(message.data))
                    link.write(PONG, message.data)
                case WSMsgType.PONG:
                    await self._wait(link, len(message.data))
                case WSMsgType.CLOSE:
                    if not link.is_closing:
                        link.write(CLOSE, CLOSE_NORMAL)
                    return
                case _:
                    return

    async def _wait(self, link: Link, size: int) -> None:
        if wait_s := link.wait_s(size, time.monotonic()):
            with link.held_back():
                await asyncio.sleep(wait_s)

    def _pass_on(self, link: Link) -> None:
        assert self.pipe is not None
        if not link.number:
            link.number = self._next
            self._next += 1
            self._links[link.number] = link
            link.until_s = time.monotonic() + self._limits.admission_s
            self.pipe.send(FromFront.OPENED, link.number, link.address.encode("ascii", "replace"))
        self.pipe.send(FromFront.RECEIVED, link.number, link.data)
        link.data = b""

    def _drop(self, link: Link) -> None:
        link.is_closing = True  # a message delayed by a rate limit must not be forwarded
        self._window.drop(link)
        self._newcomers.remove(link)
        if self._links.pop(link.number, None) and self.pipe:
            self.pipe.send(FromFront.CLOSED, link.number)

    # --- from the gateway ---

    def on_message(self, kind: int, number: int, content: bytes) -> None:
        """Process a message of the gateway."""
        match kind:
            case ToFront.PUBLISH:
                numbers, update = unpack_numbers(content, number)
                frame = frame_head(BINARY, len(update)) + update
                for each in numbers:
                    if reader := self._links.get(each):
                        reader.update(frame)
            case ToFront.TAKEN:
                self._window.taken(unpack_numbers(content, number)[0])
            case ToFront.PROBE:
                assert self.pipe is not None
                self.pipe.send(FromFront.ALIVE)
            case _ if link := self._links.get(number):
                self._on_message_for(link, kind, content)

    def _on_message_for(self, link: Link, kind: int, content: bytes) -> None:
        now_s = time.monotonic()
        match kind:
            case ToFront.SEND:
                link.send(content, now_s)
                self._window.answered(link)
            case ToFront.ADMITTED if not link.is_admitted:
                link.is_admitted = True
                self._newcomers.remove(link)
                self._on_admitted(link.connection)
                self._window.answered(link)
            case ToFront.CLOSE:
                if not link.is_admitted:
                    self._on_refused(link.address)
                self._window.drop(link)
                self._newcomers.remove(link)
                link.end(content, now_s)

    # --- what is due ---

    def sweep(self, now_s: float) -> None:
        """Close clients that do not read, or exceed their deadline; call it a few times a second."""
        queued = 0
        for link in list(self._links.values()):
            if link.is_stalled(now_s) or (link.is_closing and now_s >= link.until_s):
                link.leave()
            else:
                queued += link.queued_bytes
        if queued > self._limits.unsent_bytes_in_all:
            for link in sorted(self._links.values(), key=lambda each: each.queued_bytes, reverse=True):
                queued -= link.queued_bytes
                link.leave()
                if queued <= self._limits.unsent_bytes_in_all // 2:
                    break
