"""The gateway's interface to the front end: yields events of connections, and sends messages.

The front end is a child process without keys, and not trusted. It is restarted when it ends, hangs, or sends a
malformed message.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import socket
import time
from collections import deque
from collections.abc import AsyncIterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

from phalanx.config.front import FrontConfig
from phalanx.errors import Unavailable
from phalanx.net.children import BEGINS_WITHIN_S, PROBE_TIMEOUT_S, run_python_child, supervise_child
from phalanx.net.ports import listen
from phalanx.wire.front import NUMBERS_MAX, FromFront, ToFront, pack_numbers
from phalanx.wire.record import MalformedRecord

from .pipe import Pipe
from .tls import tls_context

log = logging.getLogger(__name__)

ADDRESS_BYTES = 64
REASON_BYTES = 64
# Limits of unread data to the front end: beyond the first, updates are dropped; beyond the second, it is restarted.
UNSENT_UPDATES_BYTES = 1024 * 1024
UNSENT_BYTES = 32 * 1024 * 1024
AT_ONCE_S = 0.01  # longest time for messages before other tasks of the event loop run
UNREAD_BYTES = 64 * 1024  # receive buffer of each connection in the kernel
LONGEST_US = 1_000_000  # limit of a message's time: a debugger may stop the gateway for minutes
IF_TAKEN = "another program uses it: choose another with --port, or --port 0 for any"


@dataclass(frozen=True, slots=True)
class Opened:
    """A websocket has sent its first message, which follows. Limits of arrivals count for `address`."""

    connection: int
    address: str


@dataclass(frozen=True, slots=True)
class Received:
    """A binary message of a websocket."""

    connection: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Closed:
    """A connection was closed by either side; one follows for each `Opened`."""

    connection: int


Event = Opened | Received | Closed


class Front:
    """Front end process, as seen by the gateway. Methods never block, and ignore closed connections.

    Attributes:
        port: port of the page and its websocket.
        restarts: number of restarts of the child.

    Args:
        pages: folder of the visitors' page.
        policy: Content-Security-Policy of the page.
        tls: certificate and key, PEM; None: plain http.
        behind_proxy: the last entry of X-Forwarded-For is the client's address.
        key: the swarm's public key, which the page reads at `/link-key`.
        operator: folder of the operator's page, served below `/operator/`.
    """

    def __init__(
        self,
        pages: Path,
        policy: str,
        host: str,
        port: int,
        limits: FrontConfig,
        tls: tuple[Path, Path] | None = None,
        behind_proxy: bool = False,
        key: str = "",
        operator: Path | None = None,
    ) -> None:
        self.port = port
        self.restarts = -1
        self._host = host
        self._limits = limits
        limits_json, proxy_json = json.dumps(asdict(limits)), json.dumps(bool(behind_proxy))
        self._words = (str(pages), str(operator or ""), policy, limits_json, proxy_json, key)
        self._tls = tuple(map(str, tls or ()))
        self._pipe: Pipe | None = None
        self._listening: socket.socket | None = None
        self._highest = self._before = 0  # highest connection number, in total and before this child
        self._open: set[int] = set()  # connections that the front end has not closed
        self._ending: set[int] = set()  # of these, those that the gateway has closed
        self._in_flight = 0
        self._events: deque[Event] = deque()
        self._wakes = asyncio.Event()
        self._taken_us: list[int] = []
        self._alive: asyncio.Future[None] | None = None
        self._over = False
        self._stack = contextlib.AsyncExitStack()

    async def __aenter__(self) -> Self:
        """Listen and start the child.

        Raises: PortTaken, Unavailable: it cannot listen there, or does not start. UsageError: certificate or key.
        """
        if self._tls:
            tls_context(*self._tls)
        async with contextlib.AsyncExitStack() as stack:
            # The gateway listens, not the child: clients wait during a restart, and no other program takes the port.
            self._listening = stack.enter_context(listen(self._host, self.port, IF_TAKEN))
            self._listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, UNREAD_BYTES)  # of each connection
            self.port = int(self._listening.getsockname()[1])
            await stack.enter_async_context(supervise_child("the front end", self._child, self._serves, self._begins))
            self._stack = stack.pop_all()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._stack.aclose()
        self._over = True
        self._wakes.set()

    async def events(self) -> AsyncIterator[Event]:
        """Yield events; a message counts as processed when the next event is requested."""
        while not self._over or self._events:
            until_s = time.monotonic() + AT_ONCE_S
            while self._events:
                event = self._events.popleft()
                began_s = time.monotonic()
                if began_s >= until_s:
                    await asyncio.sleep(0)  # lets other tasks run, such as the robots' tick
                    began_s = time.monotonic()
                    until_s = began_s + AT_ONCE_S
                if type(event) is not Received:
                    yield event
                    continue
                if event.connection not in self._ending:
                    yield event
                self._take(event.connection, time.monotonic() - began_s)
            self._wakes.clear()
            if not self._over:
                await self._wakes.wait()

    def send(self, connection: int, data: bytes) -> None:
        """Send a message to one client, which is closed if it does not read it in time."""
        if self._serving(connection):
            self._put(ToFront.SEND, connection, data)

    def publish(self, connections: Sequence[int], data: bytes) -> None:
        """Send an update to many clients, except those that have not read the last one."""
        numbers = [each for each in connections if self._serving(each)]
        if numbers and self._pipe and self._pipe.unsent_bytes <= UNSENT_UPDATES_BYTES:
            self._put(ToFront.PUBLISH, len(numbers), pack_numbers(numbers), data)

    def admitted(self, connection: int) -> None:
        """Mark a connection as admitted, so that limits of newcomers no longer apply."""
        if self._serving(connection):
            self._put(ToFront.ADMITTED, connection)

    def close(self, connection: int, reason: str) -> None:
        """Close a connection after all messages to it; further messages from it are ignored."""
        if self._serving(connection):
            self._ending.add(connection)
            self._put(ToFront.CLOSE, connection, reason.encode("ascii", "replace")[:REASON_BYTES])

    # --- the child ---------------------------------------------------------------------------------------------------

    @contextlib.asynccontextmanager
    async def _child(self) -> AsyncIterator[asyncio.subprocess.Process]:
        assert self._listening is not None
        ours, theirs = socket.socketpair()
        with ours, theirs:
            numbers = (theirs.fileno(), self._listening.fileno())
            words = (*map(str, (*numbers, self._highest + 1)), *self._words, *self._tls)
            async with run_python_child("phalanx.net.front.serve", *words, pass_fds=numbers) as process:
                theirs.close()

                def lost(error: Exception | None) -> None:
                    if error:
                        log.warning("ending the front end: %s", error)
                    with contextlib.suppress(ProcessLookupError):
                        process.kill()

                longest = max(ADDRESS_BYTES, self._limits.message_bytes)
                pipe = Pipe(longest, self._on_message, lost)
                await asyncio.get_running_loop().create_unix_connection(lambda: pipe, sock=ours)
                self._pipe = pipe
                self.restarts += 1
                try:
                    yield process
                finally:
                    self._pipe = None
                    pipe.close()
                    self._lose_all()

    async def _begins(self, process: asyncio.subprocess.Process) -> None:
        """Wait until the child serves. Raises: Unavailable: it does not start."""
        alive, ended = self._probe(), asyncio.create_task(process.wait())
        try:
            await asyncio.wait((alive, ended), timeout=BEGINS_WITHIN_S, return_when=asyncio.FIRST_COMPLETED)
        finally:
            ended.cancel()
        if not alive.done():
            raise Unavailable("the front end does not start", "run phalanx doctor")

    async def _serves(self) -> bool | None:
        """Return whether the child answers in time."""
        alive = self._probe()
        await asyncio.wait((alive,), timeout=PROBE_TIMEOUT_S)
        return alive.done()

    def _probe(self) -> asyncio.Future[None]:
        self._alive = asyncio.get_running_loop().create_future()
        self._put(ToFront.PROBE, 0)
        return self._alive

    def _lose_all(self) -> None:
        self._events += map(Closed, sorted(self._open))
        self._wakes.set()
        self._open.clear()
        self._ending.clear()
        self._before, self._in_flight = self._highest, 0
        self._taken_us.clear()

    # --- messages ----------------------------------------------------------------------------------------------------

    def _on_message(self, kind: int, number: int, content: bytes) -> None:
        """Process a message of the child. Raises: MalformedRecord: it violates the protocol."""
        match kind:
            case FromFront.RECEIVED if number in self._open:
                self._in_flight += 1
                if self._in_flight > self._limits.in_flight:
                    raise MalformedRecord("more messages in flight than allowed")
                self._tell(Received(number, content))
            case FromFront.OPENED if self._is_next(number):
                if len(content) > ADDRESS_BYTES or not content.isascii():
                    raise MalformedRecord("malformed address")
                self._highest = number
                self._open.add(number)
                self._tell(Opened(number, content.decode("ascii")))
            case FromFront.CLOSED if number in self._open:
                self._open.discard(number)
                self._ending.discard(number)
                self._tell(Closed(number))
            case FromFront.ALIVE:
                if self._alive and not self._alive.done():
                    self._alive.set_result(None)
            case _:
                raise MalformedRecord(f"unexpected message {kind} of connection {number}")

    def _is_next(self, number: int) -> bool:
        return self._highest < number <= NUMBERS_MAX and len(self._open) < self._limits.connections_max

    def _serving(self, connection: int) -> bool:
        return connection in self._open and connection not in self._ending

    def _tell(self, event: Event) -> None:
        # A correct front end opens a connection only with a message that is within the limit.
        if len(self._events) > 2 * (self._limits.in_flight + self._limits.connections_max):
            raise MalformedRecord("more events than allowed")
        self._events.append(event)
        self._wakes.set()

    def _put(self, kind: ToFront, number: int, *content: bytes) -> None:
        if self._pipe:
            self._pipe.send(kind, number, *content)
            if self._pipe.unsent_bytes > UNSENT_BYTES:
                log.warning("the front end does not read its messages; restarting it")
                self._pipe.close()

    def _take(self, connection: int, took_s: float) -> None:
        if connection <= self._before:
            return  # a connection of a previous child
        if not self._taken_us:
            asyncio.get_running_loop().call_soon(self._flush_taken)
        self._taken_us.append(min(int(took_s * 1e6), LONGEST_US))

    def _flush_taken(self) -> None:
        if self._taken_us:
            self._in_flight -= len(self._taken_us)
            self._put(ToFront.TAKEN, len(self._taken_us), pack_numbers(self._taken_us))
            self._taken_us.clear()
