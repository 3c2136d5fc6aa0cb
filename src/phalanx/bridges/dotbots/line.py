"""The line to PyDotBot's controller: one site by REST, its stream and its orders by websocket.

It has a thread and an event loop of its own, so that nothing which holds up the gateway's holds up a stop
(docs/adr/0023-brakes.md). What the controller sends is limited in length before it is read.
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
from phalanx.pace import Pace

from .told import ANY_AREA_MM, TRAIL_POINTS, Dotbot, Fleet, area_of

log = logging.getLogger(__name__)

DEFAULT_PORT = 8000
HINT = f"dotbot://HOST:PORT, where `dotbot run controller` serves its API: dotbot://127.0.0.1:{DEFAULT_PORT}"
STREAM = f"/controller/ws/stream?hz=10&trail={TRAIL_POINTS}"
ORDERS = "/controller/ws/dotbots"
SITE = "/controller/site"
# A part of a snapshot tells of a hundred robots, each with a trail of 200 points: 1 MB.
LONGEST_BYTES = 4 * 1024 * 1024
LONGEST_SITE_BYTES = 1024 * 1024
ANSWER_S = 5.0
ALIVE_EVERY_S = 4.0  # half of that without an answer, and the controller is gone
AGAIN_S = (0.2, 3.0)  # the first and the longest wait before the next try
FLUSH_S = 1.0
REFUSALS = (0.1, 5.0)  # of those that are logged: a second, and at once


@dataclass(frozen=True, slots=True)
class DotbotUrl:
    """A controller's address."""

    host: str  # name or address, IPv6 without brackets
    port: int

    @property
    def is_here(self) -> bool:
        """Whether only this machine reaches it."""
        try:
            return ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    @property
    def http(self) -> str:
        """Where its API is."""
        return f"http{str(self).removeprefix('dotbot')}"

    def __str__(self) -> str:
        return f"dotbot://{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"


def parse_dotbot_url(url: str) -> DotbotUrl:
    """Parse a controller's URL. Raises: UsageError: not such a URL."""
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        raise UsageError("the swarm's URL has a bad host or port", HINT) from error
    if parts.scheme != "dotbot":
        raise UsageError(f"a swarm at {url!r} is not known", did_you_mean(f"{parts.scheme}://", ["dotbot://"]) + HINT)
    more = (parts.username, parts.password, parts.path.strip("/"), parts.query, parts.fragment)
    if not parts.hostname or port == 0 or any(more):
        raise UsageError("the swarm's URL has no host, or more than host and port", HINT)
    return DotbotUrl(parts.hostname, port or DEFAULT_PORT)


class Orders:
    """For any thread. `wake` is called, in the thread that orders, when something is to be sent."""

    def __init__(self) -> None:
        self.wake: Callable[[], None] = lambda: None
        self._lock = threading.Lock()
        self._due: dict[tuple[str, str], tuple[tuple[Any, ...], float]] = {}

    def put(self, address: str, about: str, *words: Any, until_s: float = math.inf) -> None:
        """These, in this order, instead of what still waits about the same; nothing after `until_s` of uptime."""
        with self._lock:
            self._due[address, about] = words, until_s
        self.wake()

    def take(self, uptime_s: float) -> list[Any]:
        """What is due, oldest first; it waits no longer."""
        with self._lock:
            due, self._due = self._due, {}
        return [said for words, until_s in due.values() if uptime_s <= until_s for said in words]


class Line:
    """A controller, reached again whenever it was lost, while the context lasts.

    `robots` are those of the last that was heard, `area_mm` its site, `lost_at_s` when it was lost, seconds since 1970,
    or None. `orders` are sent as they come, `trails` are addresses whose trail is to be forgotten.
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
        """Wait until all robots are known. Raises: Unavailable: they are not in that time."""
        if not self._reached.wait(timeout_s):
            raise Unavailable(
                f"no controller of DotBots at {self.url} within {timeout_s:g} s ({self.trouble or 'no answer'})",
                "start it: dotbot run controller, or without robots dotbot run simulator --headless;"
                " to wait longer for it, --wait",
            )

    def _run(self) -> None:
        asyncio.run(self._live())

    async def _live(self) -> None:
        loop, due = asyncio.get_running_loop(), asyncio.Event()

        def wake() -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended, and with it the line
                loop.call_soon_threadsafe(due.set)

        self.orders.wake = self.trails.wake = wake
        again_s = AGAIN_S[0]
        while not self._over.is_set():
            try:
                await self._connected(due)
            # An address that it names may raise a ValueError; a line that has ended would stop no robot.
            except (OSError, aiohttp.ClientError, TimeoutError, PeerError, ValueError) as error:
                if self.lost_at_s is None:
                    again_s = AGAIN_S[0]
                self._down(_in_words(error))
            due.clear()
            if not self._over.is_set():
                with contextlib.suppress(TimeoutError):  # a stop that was said meanwhile is worth a try at once
                    await asyncio.wait_for(due.wait(), again_s)
            again_s = min(2 * again_s, AGAIN_S[1])

    async def _connected(self, due: asyncio.Event) -> None:
        """One connection, until it is lost or all is over."""
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
            # REST, beside: a stop must not wait for an answer.
            for path in self.trails.take(time.monotonic()):
                task = asyncio.ensure_future(_delete(session, path))
                forgetting.add(task)
                task.add_done_callback(forgetting.discard)
            await due.wait()

    def _up(self) -> None:
        if self._reached.is_set():
            log.warning("the controller of the DotBots at %s is back", self.url)
        self.lost_at_s, self.trouble = None, ""
        self._reached.set()

    def _down(self, words: str) -> None:
        if self.lost_at_s is None:
            self.lost_at_s = time.time()
            log.warning("lost the controller of the DotBots at %s (%s); trying again", self.url, words)
        self.trouble = words


def _socket(session: aiohttp.ClientSession, path: str) -> AbstractAsyncContextManager[aiohttp.ClientWebSocketResponse]:
    # Without compression: a kilobyte of it may be a gigabyte.
    ends = aiohttp.ClientWSTimeout(ws_close=FLUSH_S / 2)
    return session.ws_connect(path, heartbeat=ALIVE_EVERY_S, max_msg_size=LONGEST_BYTES, timeout=ends)


async def _refuse(*_: object) -> None:
    """A websocket's session can be told in no other way to go nowhere else."""
    raise aiohttp.ClientError("it sends us elsewhere")


async def _site(session: aiohttp.ClientSession) -> bytes:
    async with session.get(SITE, allow_redirects=False) as answer:
        if answer.status != 200:
            raise _Answered(SITE, answer.status)
        site = await answer.content.read(LONGEST_SITE_BYTES)
        if not answer.content.at_eof():
            raise TooLarge("a site without an end")
        return site


async def _delete(session: aiohttp.ClientSession, path: str) -> None:
    with contextlib.suppress(OSError, aiohttp.ClientError, TimeoutError):
        async with session.delete(path, allow_redirects=False):
            pass


async def _text(socket: aiohttp.ClientWebSocketResponse) -> str:
    """The next message. Raises: TooLarge, and ConnectionError: there is none."""
    said = await socket.receive()
    if said.type is aiohttp.WSMsgType.TEXT:
        return str(said.data)
    if isinstance(said.data, aiohttp.WebSocketError) and said.data.code == aiohttp.WSCloseCode.MESSAGE_TOO_BIG:
        raise TooLarge(f"a message of more than {LONGEST_BYTES} bytes")
    raise ConnectionResetError


async def _hear_refusals(orders: aiohttp.ClientWebSocketResponse) -> None:
    """The controller answers an order only to refuse it."""
    pace = Pace(*REFUSALS, time.monotonic())
    while True:
        words = await _text(orders)
        if not pace.wait_s(time.monotonic()):
            pace.use()
            log.warning("the controller of the DotBots refused an order: %s", ascii(words[:200]))


class _Answered(aiohttp.ClientError):
    def __init__(self, path: str, status: int) -> None:
        super().__init__(f"it answers {status} to {path}: is it PyDotBot's, 0.33 or later?")


def _in_words(error: Exception) -> str:
    match error:
        case aiohttp.WSServerHandshakeError():
            return str(_Answered(error.request_info.url.path, error.status))
        case _Answered():
            return str(error)
        case PeerError():
            return f"it says what PyDotBot 0.33 would not: {error}"
        case TimeoutError():
            return "no answer"
        case OSError(errno=int(number)):
            return os.strerror(number)
        case ConnectionError() | aiohttp.ServerDisconnectedError():
            return "it ended the connection"
        case _:
            return type(error).__name__
