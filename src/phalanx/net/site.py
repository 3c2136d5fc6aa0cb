"""A page over HTTP: who may connect, for how long, and with which headers it is served.

The operator's is served beside the gateway's event loop (`beside`): what holds that up does not hold up an emergency
stop. The visitors', which strangers reach, by a process of its own (`front`): threads share one interpreter, and a few
who asked for pages without end cost a third of all moves.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Sequence
from pathlib import Path
from typing import Any, Self, TypeVar, cast

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError
from aiohttp.web_protocol import RequestHandler

from .ports import LOOPBACK, listen
from .seats import Seats, a_share, place_of

# A page is some 600 KB: a phone that cannot load it within this cannot drive a robot either.
HANG_UP_AFTER_S = 30.0
CHECK_S = 1.0
# What a request may be before what it asks for is known: aiohttp keeps 128 headers of 8190 bytes, of many at once.
LINE_BYTES, HEADERS, HEAD_BYTES = 4096, 64, 16 * 1024
AT_ONCE = 100  # let in before any is heard: fewer than there are seats, or who just came is pushed out unheard
FILES_EACH = 2  # a connection, and what is read for it
# aiohttp logs a trace for every request that is no HTTP, and quotes it; and for whoever goes before the file is sent.
_FAULTS = logging.getLogger(f"{__name__}.aiohttp")
_FAULTS.addFilter(lambda record: not (record.exc_info and _is_theirs(record.exc_info[1])))

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
Served = TypeVar("Served", bound="Site")

COMMON_HEADERS = {
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cache-Control": "no-cache",
}


def _is_theirs(error: BaseException | None) -> bool:
    return isinstance(error, HttpProcessingError) or str(error) == "Transport is closing"


class Site:
    """An HTTP server for the page in `folder`, and for so many connections.

    It listens on loopback, for people at this machine alone, or is given `doors` that listen already.
    """

    port_option = "--port"

    def __init__(
        self,
        folder: Path,
        policy: str,
        port: int = 0,
        *,
        connections: int,
        longest: int = 4096,
        doors: Sequence[socket.socket] = (),
    ) -> None:
        self.port = port
        self._folder = folder
        self._doors = doors
        self._listening: list[asyncio.Server] = []
        self._seats = Seats[Connection](a_share(connections, FILES_EACH))
        headers = COMMON_HEADERS | {"Content-Security-Policy": policy}

        @web.middleware
        async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
            connection_of(request).asks(asyncio.current_task())
            # A foreign page that rebinds its name to loopback sends its own.
            is_rebound = not doors and request.host.rsplit(":", 1)[0] not in (LOOPBACK, "localhost")
            try:
                await self._pace(request)
                response = await (_for_this_machine_only if is_rebound else handler)(request)
            except web.HTTPException as error:  # aiohttp's way of saying 404
                response = web.Response(status=error.status, text=f"{error.reason}\n")
            except OSError:  # a name longer than any file's
                response = web.Response(status=404, text="Not Found\n")
            for name, value in headers.items():
                response.headers.setdefault(name, value)
            return response

        self.app = web.Application(middlewares=[check], client_max_size=longest)
        self._add_routes()
        self._add_files(folder)
        limits: dict[str, Any] = {
            "max_line_size": LINE_BYTES,
            "max_field_size": LINE_BYTES,
            "max_headers": HEADERS,
            "auto_decompress": False,  # or it is unpacked for whoever sends it; our pages send none that is packed
        }
        self._runner = web.AppRunner(self.app, access_log=None, logger=_FAULTS, shutdown_timeout=0.5, **limits)
        self._longest = HEAD_BYTES + 2 * longest  # who says a little too much is told so

    def _add_routes(self) -> None:
        """Routes that come before the page's files."""

    def _add_files(self, folder: Path) -> None:
        self.app.router.add_get("/", self._index)
        if folder.is_dir():
            self.app.router.add_static("/", folder)

    async def _pace(self, request: web.Request) -> None:
        """Wait until a request may be answered. Raises: HTTPException: it may not."""

    def know(self, request: web.Request) -> None:
        """Keep the seat of whoever asks this, however many strangers come."""
        self._seats.know(connection_of(request))

    async def _index(self, _: web.Request) -> web.StreamResponse:
        index = self._folder / "index.html"
        if not index.is_file():
            return web.Response(status=503, text="The page is not built: run `make setup` in the project's folder.\n")
        return web.FileResponse(index)

    async def __aenter__(self) -> Self:
        hint = f"another program has it; choose another with {self.port_option}, or {self.port_option} 0 for any"
        doors = self._doors or (listen(LOOPBACK, self.port, hint),)
        self.port = int(doors[0].getsockname()[1])
        await self._runner.setup()
        await self._listen(doors)
        self._hanging_up = asyncio.create_task(self._hang_up_on_idlers())
        return self

    async def _listen(self, doors: Sequence[socket.socket]) -> None:
        """Accept connections."""
        for door in doors:
            listening = await asyncio.get_running_loop().create_server(self._connect, sock=door, backlog=AT_ONCE)
            self._listening.append(listening)

    def _connect(self) -> Connection:
        return Connection(self._server, self._seats, self._longest)

    @property
    def _server(self) -> web.Server:
        return cast("web.Server", self._runner.server)

    async def __aexit__(self, *_: object) -> None:
        self._hanging_up.cancel()
        for listening in self._listening:
            listening.close()
        await self._runner.cleanup()

    async def _hang_up_on_idlers(self) -> None:
        """Hang up on whoever asks nothing for a while, or does not read the answer: aiohttp waits for them for ever."""
        while True:
            await asyncio.sleep(CHECK_S)
            now_s = time.monotonic()
            for connection in [each for each in self._seats if each.is_idle(now_s)]:
                connection.leave()


class Connection(RequestHandler):
    """A connection of aiohttp's that has a seat."""

    def __init__(self, server: web.Server, seats: Seats[Connection], longest: int) -> None:
        super().__init__(server, loop=asyncio.get_running_loop(), **server._kwargs)  # noqa: SLF001  # as it makes its own
        self.place = ""
        self.heard_at_s = time.monotonic()
        self._seats = seats
        self._answering: asyncio.Task[Any] | None = None
        self._longest = longest
        self._unanswered = 0  # bytes since its last request was taken up
        self.is_websocket = False
        self.on_lost: Callable[[], None] | None = None

    def asks(self, answering: asyncio.Task[Any] | None) -> None:
        """Note a request, on which this task works."""
        self.heard_at_s = time.monotonic()
        self._answering = answering
        self._unanswered = 0
        self._seats.heard(self)

    def upgrade(self) -> None:
        """Stop counting bytes and time: what follows is a websocket's."""
        self.is_websocket = True

    def is_idle(self, now_s: float) -> bool:
        """Return whether it asked nothing for too long."""
        return not self.is_websocket and now_s - self.heard_at_s >= HANG_UP_AFTER_S

    def leave(self) -> None:
        """Hang up."""
        self._seats.gone(self)
        if self._answering:
            self._answering.cancel()
        # Nobody tells a sendfile that its socket is closed: it must have ended before.
        if self.transport:
            asyncio.get_running_loop().call_soon(self.transport.abort)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a seat."""
        self.place = place_of((transport.get_extra_info("peername") or ("",))[0])
        super().connection_made(transport)
        self._seats.take(self)

    def data_received(self, data: bytes) -> None:
        """Hang up on whoever sends more than a request may be before that is answered."""
        self._unanswered += len(data)
        if self._unanswered > self._longest and not self.is_websocket:
            self.leave()
        else:
            super().data_received(data)

    def close(self) -> None:
        """Hang up on a websocket that breaks its protocol: aiohttp would read on, and drop what it reads."""
        super().close()
        if self.is_websocket:
            self.leave()

    def connection_lost(self, error: BaseException | None) -> None:
        """Free the seat."""
        self._seats.gone(self)
        if self.on_lost:
            self.on_lost()
        super().connection_lost(error)


def connection_of(request: web.Request) -> Connection:
    """Return the connection that a request came by."""
    return cast("Connection", request.protocol)


async def _for_this_machine_only(_: web.Request) -> web.StreamResponse:
    return web.json_response({"error": "this page is for this machine only"}, status=403)


@contextlib.asynccontextmanager
async def beside(pages: Served) -> AsyncIterator[Served]:
    """A page, served by an event loop in a thread of its own while the context lasts."""
    runner = asyncio.Runner(loop_factory=asyncio.new_event_loop)
    loop = runner.get_loop()
    thread = threading.Thread(target=loop.run_forever, name="pages", daemon=True)
    thread.start()

    async def there(job: Coroutine[Any, Any, Any]) -> None:
        await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(job, loop))

    try:
        await there(pages.__aenter__())
        try:
            yield pages
        finally:
            await there(pages.__aexit__())
    finally:
        loop.call_soon_threadsafe(loop.stop)
        await asyncio.to_thread(thread.join)
        await asyncio.to_thread(runner.close)  # what is under way there ends with it
