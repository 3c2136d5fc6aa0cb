"""The gateway's end of the front end: events of connections in, messages out. It trusts nothing that comes from there.

The front end holds no keys. It is a child that is started again when it ends, stops, or sends what is malformed.
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
from phalanx.net.children import BEGINS_WITHIN_S, PROBE_TIMEOUT_S, a_python_child, kept
from phalanx.net.ports import listen
from phalanx.wire.front import NUMBERS_MAX, FromFront, ToFront, pack_numbers
from phalanx.wire.record import MalformedRecord

from .pipe import Pipe
from .tls import tls_context

log = logging.getLogger(__name__)

ADDRESS_BYTES = 64
REASON_BYTES = 64
# A front end that takes nothing: updates are dropped first, then it is started again.
UNSENT_UPDATES_BYTES = 1024 * 1024
UNSENT_BYTES = 32 * 1024 * 1024
AT_ONCE_S = 0.01  # for which messages are processed before anything else has its turn
UNREAD_BYTES = 64 * 1024  # in the system, of a client that we hold back
LONGEST_US = 1_000_000  # that a message counts for: who debugs a gateway stops it for minutes
IF_TAKEN = "another program has it; choose another with --port, or --port 0 for any"


@dataclass(frozen=True, slots=True)
class Opened:
    """A websocket sent its first message, which follows. `address` is what arrivals are counted by."""

    connection: int
    address: str


@dataclass(frozen=True, slots=True)
class Received:
    """A binary message of a websocket."""

    connection: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Closed:
    """A connection is over, whoever ended it; there is one for each `Opened`."""

    connection: int


Event = Opened | Received | Closed


class Front:
    """Runs the front end. Functions never block; what concerns a connection that is over is ignored.

    Attributes:
        port: of the page and of its websocket.
        restarts: of the child.

    Args:
        pages: folder of the visitors' page.
        policy: its Content-Security-Policy.
        tls: certificate and key, PEM; else plain http.
        behind_proxy: the last entry of X-Forwarded-For is a client's address.
        key: the swarm's public key, as the page asks for it at `/link-key`.
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
        self._highest = self._before = 0  # number of a connection, in all and before this child
        self._open: set[int] = set()  # that the other end has not closed
        self._ending: set[int] = set()  # of these, those that we closed
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
            # We listen, not the child: whoever comes while it starts waits, and nobody takes the port.
            self._listening = stack.enter_context(listen(self._host, self.port, IF_TAKEN))
            self._listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, UNREAD_BYTES)  # of each connection
            self.port = int(self._listening.getsockname()[1])
            await stack.enter_async_context(kept("the front end", self._child, self._serves, self._begins))
            self._stack = stack.pop_all()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._stack.aclose()
        self._over = True
        self._wakes.set()

    async def events(self) -> AsyncIterator[Event]:
        """Yield what happens; a message counts as processed when the next event is asked for."""
        while not self._over or self._events:
            until_s = time.monotonic() + AT_ONCE_S
            while self._events:
                event = self._events.popleft()
                began_s = time.monotonic()
                if began_s >= until_s:
                    await asyncio.sleep(0)  # the robots' tick is due as well
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
        """Send a message to one client; whoever does not take it in time is closed."""
        if self._serving(connection):
            self._put(ToFront.SEND, connection, data)

    def publish(self, connections: Sequence[int], data: bytes) -> None:
        """Send an update to many clients; one that has not taken the last one misses this one."""
        numbers = [each for each in connections if self._serving(each)]
        if numbers and self._pipe and self._pipe.unsent_bytes <= UNSENT_UPDATES_BYTES:
            self._put(ToFront.PUBLISH, len(numbers), pack_numbers(numbers), data)

    def admitted(self, connection: int) -> None:
        """Count a connection no longer as an unfinished handshake."""
        if self._serving(connection):
            self._put(ToFront.ADMITTED, connection)

    def close(self, connection: int, reason: str) -> None:
        """End a connection after what was sent to it; nothing more is received from it."""
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
            async with a_python_child("phalanx.net.front.serve", *words, pass_fds=numbers) as process:
                theirs.close()

                def lost(error: Exception | None) -> None:
                    if error:
                        log.warning("the front end is ended: %s", error)
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
        """Wait until the child serves. Raises: Unavailable: it does not."""
        alive, ended = self._probe(), asyncio.create_task(process.wait())
        try:
            await asyncio.wait((alive, ended), timeout=BEGINS_WITHIN_S, return_when=asyncio.FIRST_COMPLETED)
        finally:
            ended.cancel()
        if not alive.done():
            raise Unavailable("the front end does not start", "phalanx doctor")

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
        """Read a message of the child. Raises: MalformedRecord: an honest one sends nothing like it."""
        match kind:
            case FromFront.RECEIVED if number in self._open:
                self._in_flight += 1
                if self._in_flight > self._limits.in_flight:
                    raise MalformedRecord("more messages than there is room for")
                self._tell(Received(number, content))
            case FromFront.OPENED if self._is_next(number):
                if len(content) > ADDRESS_BYTES or not content.isascii():
                    raise MalformedRecord("an address that is none")
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
                raise MalformedRecord(f"message {kind} of connection {number}")

    def _is_next(self, number: int) -> bool:
        return self._highest < number <= NUMBERS_MAX and len(self._open) < self._limits.connections_max

    def _serving(self, connection: int) -> bool:
        return connection in self._open and connection not in self._ending

    def _tell(self, event: Event) -> None:
        # An honest one opens a connection only with a message that there is room for.
        if len(self._events) > 2 * (self._limits.in_flight + self._limits.connections_max):
            raise MalformedRecord("more events than there is room for")
        self._events.append(event)
        self._wakes.set()

    def _put(self, kind: ToFront, number: int, *content: bytes) -> None:
        if self._pipe:
            self._pipe.send(kind, number, *content)
            if self._pipe.unsent_bytes > UNSENT_BYTES:
                log.warning("the front end does not take what it is sent; starting it again")
                self._pipe.close()

    def _take(self, connection: int, took_s: float) -> None:
        if connection <= self._before:
            return  # of a child that has ended
        if not self._taken_us:
            asyncio.get_running_loop().call_soon(self._flush_taken)
        self._taken_us.append(min(int(took_s * 1e6), LONGEST_US))

    def _flush_taken(self) -> None:
        if self._taken_us:
            self._in_flight -= len(self._taken_us)
            self._put(ToFront.TAKEN, len(self._taken_us), pack_numbers(self._taken_us))
            self._taken_us.clear()
