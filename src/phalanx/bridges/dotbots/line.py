"""Client of PyDotBot's controller: the site by REST, state updates and commands by websocket.

The client runs in a thread with its own event loop, so that a blocked gateway does not delay a stop
(docs/adr/0023-brakes.md). Messages of the controller are limited in length before they are read.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import os
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Any, Self
from urllib.parse import urlsplit

import aiohttp

from phalanx.errors import PeerError, TooLarge, Unavailable, UsageError, did_you_mean
from phalanx.pace import TokenBucket

from .stream import ANY_AREA_MM, TRAIL_POINTS, Dotbot, Fleet, area_of

log = logging.getLogger(__name__)

DEFAULT_PORT = 8000
HINT = f"dotbot://HOST:PORT, where `dotbot run controller` serves its API: dotbot://127.0.0.1:{DEFAULT_PORT}"
STREAM = f"/controller/ws/stream?hz=10&trail={TRAIL_POINTS}"
ORDERS = "/controller/ws/dotbots"
SITE = "/controller/site"
# A part of a snapshot describes a hundred robots, each with a trail of 200 points: 1 MB.
LONGEST_BYTES = 4 * 1024 * 1024
LONGEST_SITE_BYTES = 1024 * 1024
ANSWER_S = 5.0
ALIVE_EVERY_S = 4.0  # without an answer for half of that, the connection is closed
AGAIN_S = (0.2, 3.0)  # the first and the longest delay before connecting again
FLUSH_S = 1.0
REFUSALS = (0.1, 5.0)  # logged refusals: per second, and at once


@dataclass(frozen=True, slots=True)
class DotbotUrl:
    """Address of a DotBot controller."""

    host: str  # name or address, IPv6 without brackets
    port: int

    @property
    def is_here(self) -> bool:
        """Return whether the host is a loopback address."""
        try:
            return ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    @property
    def http(self) -> str:
        """Return the URL of its REST API."""
        return f"http{str(self).removeprefix('dotbot')}"

    def __str__(self) -> str:
        return f"dotbot://{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"


def parse_dotbot_url(url: str) -> DotbotUrl:
    """Parse a controller's URL. Raises: UsageError: not such a URL."""
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        raise UsageError("the swarm's URL has an invalid host or port", HINT) from error
    if parts.scheme != "dotbot":
        raise UsageError(f"unknown kind of swarm {url!r}", did_you_mean(f"{parts.scheme}://", ["dotbot://"]) + HINT)
    more = (parts.username, parts.password, parts.path.strip("/"), parts.query, parts.fragment)
    if not parts.hostname or port == 0 or any(more):
        raise UsageError("the swarm's URL has no host, or more than host and port", HINT)
    return DotbotUrl(parts.hostname, port or DEFAULT_PORT)


class Orders:
    """Thread-safe queue of commands. `put` calls `wake` in its own thread."""

    def __init__(self) -> None:
        self.wake: Callable[[], None] = lambda: None
        self._lock = threading.Lock()
        self._due: dict[tuple[str, str], tuple[tuple[Any, ...], float]] = {}

    def put(self, address: str, about: str, *words: Any, until_s: float = math.inf) -> None:
        """Queue messages; they replace queued ones of the same `about`, and expire at `until_s` of uptime."""
        with self._lock:
            self._due[address, about] = words, until_s
        self.wake()

    def take(self, uptime_s: float) -> list[Any]:
        """Remove and return all queued messages that have not expired, oldest first."""
        with self._lock:
            due, self._due = self._due, {}
        return [said for words, until_s in due.values() if uptime_s <= until_s for said in words]


class Line:
    """Connection to a controller, within a context; it reconnects after each loss.

    Attributes:
        robots: newest known state by address.
        area_mm: width and height of the controller's site.
        lost_at_s: when the connection was lost, seconds since 1970; None while connected.
        orders: commands to send.
        trails: REST paths of trails to delete.
    """

    def __init__(self, url: DotbotUrl) -> None:
        self.url = url
        self.orders = Orders()
        self.trails = Orders()
        self.robots: Mapping[str, Dotbot] = {}
        self.area_mm = ANY_AREA_MM
        self.lost_at_s: float | None = time.time()
        self.trouble = ""
        self._reached = threading.Event()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="dotbots", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self.orders.wake()
        self._thread.join(2 * FLUSH_S)

    def wait(self, timeout_s: float) -> None:
        """Wait until all robots are known. Raises: Unavailable: the time is over."""
        if not self._reached.wait(timeout_s):
            raise Unavailable(
                f"no DotBot controller at {self.url} within {timeout_s:g} s ({self.trouble or 'no answer'})",
                "start it: dotbot run controller, or without robots dotbot run simulator --headless;"
                " use --wait to wait longer",
            )

    def _run(self) -> None:
        asyncio.run(self._live())

    async def _live(self) -> None:
        loop, due = asyncio.get_running_loop(), asyncio.Event()

        def wake() -> None:
            with contextlib.suppress(RuntimeError):  # the event loop has ended
                loop.call_soon_threadsafe(due.set)

        self.orders.wake = self.trails.wake = wake
        again_s = AGAIN_S[0]
        while not self._over.is_set():
            try:
                await self._connected(due)
            # A bad address may raise a ValueError; if this thread ended, no robot could be stopped.
            except (OSError, aiohttp.ClientError, TimeoutError, PeerError, ValueError) as error:
                if self.lost_at_s is None:
                    again_s = AGAIN_S[0]
                self._down(_in_words(error))
            due.clear()
            if not self._over.is_set():
                with contextlib.suppress(TimeoutError):  # for a stop queued meanwhile, connect at once
                    await asyncio.wait_for(due.wait(), again_s)
            again_s = min(2 * again_s, AGAIN_S[1])

    async def _connected(self, due: asyncio.Event) -> None:
        """Serve one connection until it is lost or the context ends."""
        traces = aiohttp.TraceConfig()
        traces.on_request_redirect.append(_refuse)
        async with aiohttp.ClientSession(
            self.url.http,
            trace_configs=[traces],
            timeout=aiohttp.ClientTimeout(total=ANSWER_S),
            cookie_jar=aiohttp.DummyCookieJar(),
            auto_decompress=False,
            headers={"Accept-Encoding": "identity"},
        ) as session:
            self.area_mm = area_of(await _site(session))
            async with (
                _socket(session, STREAM) as stream,
                _socket(session, ORDERS) as orders,
            ):
                jobs = [
                    asyncio.ensure_future(job)
                    for job in (self._hear(stream), _hear_refusals(orders), self._speak(orders, session, due))
                ]
                try:
                    done, _ = await asyncio.wait(jobs, return_when=asyncio.FIRST_COMPLETED)
                    for job in done:
                        job.result()
                finally:
                    for job in jobs:
                        job.cancel()
                    await asyncio.gather(*jobs, return_exceptions=True)

    async def _hear(self, stream: aiohttp.ClientWebSocketResponse) -> None:
        fleet = Fleet()
        while True:
            number = fleet.hear(await _text(stream), time.time())
            if fleet.robots is not None:
                self.robots = fleet.robots
                if self.lost_at_s is not None:
                    self._up()
            if number is not None:
                await stream.send_json({"ack": number})

    async def _speak(
        self, orders: aiohttp.ClientWebSocketResponse, session: aiohttp.ClientSession, due: asyncio.Event
    ) -> None:
        forgetting: set[asyncio.Task[None]] = set()
        while True:
            is_last = self._over.is_set()
            due.clear()
            async with asyncio.timeout(FLUSH_S if is_last else ANSWER_S):
                for said in self.orders.take(time.monotonic()):
                    await orders.send_json(said)
            if is_last:
                return
            # REST requests run in tasks: a stop must not wait for their answers.
            for path in self.trails.take(time.monotonic()):
                task = asyncio.ensure_future(_delete(session, path))
                forgetting.add(task)
                task.add_done_callback(forgetting.discard)
            await due.wait()

    def _up(self) -> None:
        if self._reached.is_set():
            log.warning("connected to the DotBot controller at %s again", self.url)
        self.lost_at_s, self.trouble = None, ""
        self._reached.set()

    def _down(self, words: str) -> None:
        if self.lost_at_s is None:
            self.lost_at_s = time.time()
            log.warning("lost the connection to the DotBot controller at %s (%s); trying again", self.url, words)
        self.trouble = words


def _socket(session: aiohttp.ClientSession, path: str) -> AbstractAsyncContextManager[aiohttp.ClientWebSocketResponse]:
    # Without compression: a compressed kilobyte may expand to a gigabyte.
    ends = aiohttp.ClientWSTimeout(ws_close=FLUSH_S / 2)
    return session.ws_connect(path, heartbeat=ALIVE_EVERY_S, max_msg_size=LONGEST_BYTES, timeout=ends)


async def _refuse(*_: object) -> None:
    """Refuse redirects: `ws_connect` has no option for it."""
    raise aiohttp.ClientError("it redirects")


async def _site(session: aiohttp.ClientSession) -> bytes:
    async with session.get(SITE, allow_redirects=False) as answer:
        if answer.status != 200:
            raise _Answered(SITE, answer.status)
        site = await answer.content.read(LONGEST_SITE_BYTES)
        if not answer.content.at_eof():
            raise TooLarge(f"it sent a site of more than {LONGEST_SITE_BYTES} bytes")
        return site


async def _delete(session: aiohttp.ClientSession, path: str) -> None:
    with contextlib.suppress(OSError, aiohttp.ClientError, TimeoutError):
        async with session.delete(path, allow_redirects=False):
            pass


async def _text(socket: aiohttp.ClientWebSocketResponse) -> str:
    """Return the next message. Raises: TooLarge; ConnectionError: the connection was closed."""
    said = await socket.receive()
    if said.type is aiohttp.WSMsgType.TEXT:
        return str(said.data)
    if isinstance(said.data, aiohttp.WebSocketError) and said.data.code == aiohttp.WSCloseCode.MESSAGE_TOO_BIG:
        raise TooLarge(f"it sent a message of more than {LONGEST_BYTES} bytes")
    raise ConnectionResetError


async def _hear_refusals(orders: aiohttp.ClientWebSocketResponse) -> None:
    """Log refused commands, rate-limited: the controller answers a command only if it refuses it."""
    pace = TokenBucket(*REFUSALS, time.monotonic())
    while True:
        words = await _text(orders)
        if not pace.wait_s(time.monotonic()):
            pace.use()
            log.warning("the DotBot controller refused a command: %s", ascii(words[:200]))


class _Answered(aiohttp.ClientError):
    def __init__(self, path: str, status: int) -> None:
        super().__init__(f"it answers {path} with status {status}: PyDotBot 0.33 or later is needed")


def _in_words(error: Exception) -> str:
    match error:
        case aiohttp.WSServerHandshakeError():
            return str(_Answered(error.request_info.url.path, error.status))
        case _Answered():
            return str(error)
        case PeerError():
            return f"not the protocol of PyDotBot 0.33: {error}"
        case TimeoutError():
            return "no answer"
        case OSError(errno=int(number)):
            return os.strerror(number)
        case ConnectionError() | aiohttp.ServerDisconnectedError():
            return "it closed the connection"
        case _:
            return type(error).__name__
