"""HTTP server for a page: limits of connections and requests, and security headers.

The operator's page has an event loop of its own (`serve_in_thread`), so that a busy gateway does not delay an
emergency stop.
The visitors' page, which strangers reach, has a process of its own (`front`): in a thread of the gateway, a few clients
with endless requests delayed a third of all commands.
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
from .seats import Seats, connection_limit, place_of

# A page has some 600 KB: a phone that cannot load it in this time cannot drive a robot either.
HANG_UP_AFTER_S = 30.0
CHECK_S = 1.0
# Limits of a request's head. By default aiohttp buffers 128 headers of 8190 bytes for each of many connections.
LINE_BYTES, HEADERS, HEAD_BYTES = 4096, 64, 16 * 1024
AT_ONCE = 100  # accepted in one turn: fewer than there are seats, or the newest would be evicted before they are read
FILES_EACH = 2  # file descriptors per connection: the socket, and a file that is sent
# aiohttp logs a traceback, with the request, for each malformed request and for each client that leaves too early.
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
    """HTTP server for the page in `folder`, with a limited number of connections.

    It listens on loopback, for this machine only, or uses `doors`, sockets that listen already.
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
        self._seats = Seats[Connection](connection_limit(connections, FILES_EACH))
        headers = COMMON_HEADERS | {"Content-Security-Policy": policy}

        @web.middleware
        async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
            connection_of(request).asks(asyncio.current_task())
            # A foreign page that rebinds its host name to loopback (DNS rebinding) sends that name.
            is_rebound = not doors and request.host.rsplit(":", 1)[0] not in (LOOPBACK, "localhost")
            try:
                await self._pace(request)
                response = await (_for_this_machine_only if is_rebound else handler)(request)
            except web.HTTPException as error:  # aiohttp's way of saying 404
                response = web.Response(status=error.status, text=f"{error.reason}\n")
            except OSError:  # for example a file name that is too long
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
            "auto_decompress": False,  # the pages send no compressed requests, and decompression costs time
        }
        self._runner = web.AppRunner(self.app, access_log=None, logger=_FAULTS, shutdown_timeout=0.5, **limits)
        self._longest = HEAD_BYTES + 2 * longest  # slightly too long requests still get an answer

    def _add_routes(self) -> None:
        """Add routes that take precedence over the page's files."""

    def _add_files(self, folder: Path) -> None:
        self.app.router.add_get("/", self._index)
        if folder.is_dir():
            self.app.router.add_static("/", folder)

    async def _pace(self, request: web.Request) -> None:
        """Delay a request until it may be answered. Raises: HTTPException: it must not be answered."""

    def know(self, request: web.Request) -> None:
        """Protect the seat of this request's connection from being given to strangers."""
        self._seats.mark_known(connection_of(request))

    async def _index(self, _: web.Request) -> web.StreamResponse:
        index = self._folder / "index.html"
        if not index.is_file():
            return web.Response(status=503, text="The page is not built: run `make setup` in the project's folder.\n")
        return web.FileResponse(index)

    async def __aenter__(self) -> Self:
        hint = f"another program uses it: choose another with {self.port_option}, or {self.port_option} 0 for any"
        doors = self._doors or (listen(LOOPBACK, self.port, hint),)
        self.port = int(doors[0].getsockname()[1])
        await self._runner.setup()
        await self._listen(doors)
        self._hanging_up = asyncio.create_task(self._hang_up_on_idlers())
        return self

    async def _listen(self, doors: Sequence[socket.socket]) -> None:
        """Start to accept connections."""
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
        """Close connections that are idle or do not read their answers: aiohttp has no such limit."""
        while True:
            await asyncio.sleep(CHECK_S)
            now_s = time.monotonic()
            for connection in [each for each in self._seats if each.is_idle(now_s)]:
                connection.leave()


class Connection(RequestHandler):
    """aiohttp connection with a seat, a time limit and a limit of unanswered bytes."""

    def __init__(self, server: web.Server, seats: Seats[Connection], longest: int) -> None:
        super().__init__(server, loop=asyncio.get_running_loop(), **server._kwargs)  # noqa: SLF001  # as aiohttp does
        self.place = ""
        self.heard_at_s = time.monotonic()
        self._seats = seats
        self._answering: asyncio.Task[Any] | None = None
        self._longest = longest
        self._unanswered = 0  # bytes received since its last request was processed
        self.is_websocket = False
        self.on_lost: Callable[[], None] | None = None

    def asks(self, answering: asyncio.Task[Any] | None) -> None:
        """Record a request, and the task that answers it."""
        self.heard_at_s = time.monotonic()
        self._answering = answering
        self._unanswered = 0
        self._seats.heard(self)

    def upgrade(self) -> None:
        """Stop limiting bytes and time: the connection is a websocket now."""
        self.is_websocket = True

    def is_idle(self, now_s: float) -> bool:
        """Return whether the last request is too long ago."""
        return not self.is_websocket and now_s - self.heard_at_s >= HANG_UP_AFTER_S

    def leave(self) -> None:
        """Close the connection."""
        self._seats.gone(self)
        if self._answering:
            self._answering.cancel()
        # A running sendfile does not notice that its socket is closed, so it has to end first.
        if self.transport:
            asyncio.get_running_loop().call_soon(self.transport.abort)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a seat."""
        self.place = place_of((transport.get_extra_info("peername") or ("",))[0])
        super().connection_made(transport)
        self._seats.take(self)

    def data_received(self, data: bytes) -> None:
        """Process data, or close the connection if an unanswered request is too long."""
        self._unanswered += len(data)
        if self._unanswered > self._longest and not self.is_websocket:
            self.leave()
        else:
            super().data_received(data)

    def close(self) -> None:
        """Close a websocket after a protocol error: aiohttp would go on reading, and drop the data."""
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
    """Return the connection of a request."""
    return cast("Connection", request.protocol)


async def _for_this_machine_only(_: web.Request) -> web.StreamResponse:
    return web.json_response({"error": "this page is for this machine only"}, status=403)


@contextlib.asynccontextmanager
async def serve_in_thread(pages: Served) -> AsyncIterator[Served]:
    """Serve a site by an event loop in a separate thread while the context lasts."""
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
        await asyncio.to_thread(runner.close)  # cancels the remaining tasks
