"""HTTP server of the front end: the visitors' and the operator's page, and the websocket `/link`, on one port."""

from __future__ import annotations

import asyncio
import hashlib
import ipaddress
import mimetypes
import socket
import ssl
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from aiohttp import web

from phalanx.config.front import FrontConfig
from phalanx.net.seats import Seats, place_of
from phalanx.net.site import Connection, Site, connection_of
from phalanx.pace import TokenBucket, TokenBuckets
from phalanx.wire.sessions import LINK_PATH

from .arrivals import Arrivals
from .links import Links
from .newcomers import Newcomers
from .turns import Turns

LINK_KEY = f"{LINK_PATH}-key"
OPERATOR_PATH = "/operator/"
FORWARDED = "X-Forwarded-For"
SWEEP_S, FORGET_S = 0.25, 1.0
REQUESTS_AT_ONCE = 32.0
RETRY_S = "2"


class FrontConnection(Connection):
    """Connection that counts as a newcomer until its first request."""

    def __init__(
        self, server: web.Server, seats: Seats[Connection], longest: int, newcomers: Newcomers, until_s: float
    ) -> None:
        super().__init__(server, seats, longest)
        self.until_s = until_s
        self._newcomers: Newcomers | None = newcomers

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Count the connection as a newcomer."""
        super().connection_made(transport)
        if self._newcomers is not None:
            self._newcomers.add(self.place, self)

    def asks(self, answering: asyncio.Task[object] | None) -> None:
        """Record a request; the connection is no newcomer any more."""
        super().asks(answering)
        if self._newcomers is not None:
            self._newcomers.remove(self)

    def trust_proxy(self) -> None:
        """Do not count the connection as a newcomer: it is a proxy's, which may stay idle."""
        self._newcomers = None

    def move(self, place: str) -> None:
        """Count the connection for another place: that of the client behind the proxy."""
        self._seats.gone(self)
        self.place = place
        self._seats.take(self)

    def connection_lost(self, error: BaseException | None) -> None:
        """Remove the connection from the newcomers."""
        if self._newcomers is not None:
            self._newcomers.remove(self)
        super().connection_lost(error)


class InMemory:
    """Handler that serves a file from memory, which takes a fifth of the time of opening it for each request."""

    def __init__(self, path: Path) -> None:
        packed = path.with_name(f"{path.name}.gz")
        self._content = path.read_bytes()
        self._packed = packed.read_bytes() if packed.is_file() else None
        self._type = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
        self._tag = f'"{hashlib.sha256(self._content).hexdigest()[:32]}"'

    async def __call__(self, request: web.Request) -> web.StreamResponse:
        """Return the file, with gzip if the client accepts it; or 304 if the client has the current version."""
        headers = {"ETag": self._tag, "Content-Type": self._type, "Vary": "Accept-Encoding"}
        if request.headers.get("If-None-Match") == self._tag:
            return web.Response(status=304, headers=headers)
        if self._packed is not None and "gzip" in request.headers.get("Accept-Encoding", ""):
            return web.Response(body=self._packed, headers=headers | {"Content-Encoding": "gzip"})
        return web.Response(body=self._content, headers=headers)


class FrontSite(Site):
    """Site with the pages and the websocket."""

    def __init__(
        self,
        pages: Path,
        policy: str,
        limits: FrontConfig,
        doors: Sequence[socket.socket],
        first: int,
        *,
        tls: ssl.SSLContext | None = None,
        behind_proxy: bool = False,
        key: str = "",
        operator: Path | None = None,
    ) -> None:
        self._limits, self._behind_proxy, self._key, self._operator = limits, behind_proxy, key, operator
        self._newcomers = Newcomers(limits, lambda address: self._charge(address, limits.cost_of_silence))
        self.links = Links(limits, self._newcomers, first, self._admitted, self._refused)
        now_s = time.monotonic()
        self._requests = _queue(
            TokenBucket(limits.requests_per_s, REQUESTS_AT_ONCE, now_s),
            TokenBuckets(limits.requests_per_s_per_address, limits.requests_at_once_per_address),
            limits,
        )
        # Behind a proxy, arrivals are counted by websocket, not by connection.
        self._forwarded = _queue(
            TokenBucket(limits.arrivals_per_s, REQUESTS_AT_ONCE, now_s),
            TokenBuckets(limits.arrivals_per_s_per_address, limits.arrivals_at_once_per_address),
            limits,
        )
        self._arrivals = Arrivals(limits, self._newcomers, self._connect, tls, behind_proxy=behind_proxy)
        super().__init__(pages, policy, connections=limits.connections_max, doors=doors)

    def _add_routes(self) -> None:
        self.app.router.add_get(LINK_PATH, self._link)
        self.app.router.add_get(LINK_KEY, self._tell_key)

    def _add_files(self, folder: Path) -> None:
        for root, pages in (("/", folder), (OPERATOR_PATH, self._operator)):
            if pages is None:
                continue
            for path in pages.rglob("*"):
                if path.is_file() and path.suffix != ".gz":
                    self.app.router.add_get(f"{root}{path.relative_to(pages).as_posix()}", InMemory(path))
            index = pages / "index.html"
            self.app.router.add_get(root, InMemory(index) if index.is_file() else self._index)

    def _admitted(self, connection: Connection) -> None:
        self._seats.mark_known(connection)
        self._charge(connection.place, -self._limits.given_back)
        self._requests.charge(connection.place, -self._limits.given_back)

    def _refused(self, address: str) -> None:
        self._charge(address, self._limits.cost_of_refusal)

    def _charge(self, address: str, arrivals: float) -> None:
        (self._forwarded if self._behind_proxy else self._arrivals.turns).charge(address, arrivals)

    def _connect(self) -> Connection:
        until_s = time.monotonic() + self._limits.head_s
        made = FrontConnection(self._server, self._seats, self._longest, self._newcomers, until_s)
        if self._behind_proxy:
            made.trust_proxy()
        return made

    async def _listen(self, doors: Sequence[socket.socket]) -> None:
        for door in doors:
            self._arrivals.listen(door)
        self._sweeping = asyncio.create_task(self._sweep())

    async def __aexit__(self, *error: object) -> None:
        self._sweeping.cancel()
        self._arrivals.close()
        for queue in (self._requests, self._forwarded):
            queue.close()
        await super().__aexit__(*error)

    async def _pace(self, request: web.Request) -> None:
        is_arrival = self._behind_proxy and request.path == LINK_PATH
        turn: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        (self._forwarded if is_arrival else self._requests).add(self._address(request), turn)
        if not await turn:
            raise web.HTTPServiceUnavailable(headers={"Retry-After": RETRY_S})

    async def _link(self, request: web.Request) -> web.StreamResponse:
        if request.headers.get("Upgrade", "").lower() != "websocket":
            raise web.HTTPUpgradeRequired(headers={"Upgrade": "websocket"})
        address = self._address(request)
        connection = connection_of(request)
        if self._behind_proxy and isinstance(connection, FrontConnection):
            connection.move(address)
        return await self.links.serve(request, address)

    async def _tell_key(self, _: web.Request) -> web.Response:
        # For clients that join by a room code, which is too short to contain the key.
        return web.Response(text=self._key) if self._key else web.Response(status=404)

    def _address(self, request: web.Request) -> str:
        """Return the address or network that a client is counted by."""
        if self._behind_proxy:
            last = ",".join(request.headers.getall(FORWARDED, [])).rpartition(",")[2].strip()
            try:
                return place_of(str(ipaddress.ip_address(last)))
            except ValueError:
                pass  # not added by a proxy: the request counts for the proxy's address
        return connection_of(request).place

    async def _sweep(self) -> None:
        forget_at_s = 0.0
        while True:
            await asyncio.sleep(SWEEP_S)
            now_s = time.monotonic()
            self._newcomers.sweep(now_s)
            self.links.sweep(now_s)
            if now_s >= forget_at_s:
                forget_at_s = now_s + FORGET_S
                for queue in (self._arrivals.turns, self._requests, self._forwarded):
                    queue.forget(now_s)


def _queue(pace: TokenBucket, paces: TokenBuckets, limits: FrontConfig) -> Turns[asyncio.Future[bool]]:
    return Turns(_settle(True), _settle(False), pace, paces, waiting_max=limits.arrivals_waiting_max)


def _settle(answer: bool) -> Callable[[asyncio.Future[bool]], None]:
    def settle(turn: asyncio.Future[bool]) -> None:
        if not turn.done():
            turn.set_result(answer)

    return settle
