"""Accepting of connections: round-robin over addresses, at a rate that leaves time for those that are admitted.

Half of the cost of a connection is the event loop's work after accept(). So accepted sockets wait here before it.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
import time
from collections.abc import Callable

from phalanx.config.front import FrontConfig
from phalanx.net.seats import place_of
from phalanx.pace import TokenBucket, TokenBuckets

from .newcomers import Newcomers
from .turns import Turns

OUT_OF_FILES_S = 1.0
AT_ONCE = 32  # connections accepted in one turn of the event loop
ARRIVALS_AT_ONCE = 8.0


class Arrival:
    """Accepted socket that waits, or is in its TLS handshake."""

    def __init__(self, sock: socket.socket, address: str, until_s: float) -> None:
        self.socket, self.address, self.until_s = sock, address, until_s
        self.task: asyncio.Task[None] | None = None
        self.has_begun = False  # the task runs, and closes the socket if it is cancelled

    def leave(self) -> None:
        """Close the socket."""
        if self.task:
            self.task.cancel()
        if not self.has_begun:
            self.socket.close()


class Arrivals:
    """Acceptor for listening sockets.

    Args:
        make: returns the protocol for a new connection.
        behind_proxy: all connections have the proxy's address, so limits count their requests instead.
    """

    def __init__(
        self,
        limits: FrontConfig,
        newcomers: Newcomers,
        make: Callable[[], asyncio.Protocol],
        tls: ssl.SSLContext | None,
        *,
        behind_proxy: bool,
    ) -> None:
        self._limits, self._newcomers, self._make, self._tls = limits, newcomers, make, tls
        self._behind_proxy = behind_proxy
        now_s = time.monotonic()
        own = TokenBuckets(limits.arrivals_per_s_per_address, limits.arrivals_at_once_per_address)
        self.turns: Turns[Arrival] = Turns(
            self._serve,
            Arrival.leave,
            TokenBucket(limits.arrivals_per_s, ARRIVALS_AT_ONCE, now_s),
            None if behind_proxy else own,
            waiting_max=limits.arrivals_waiting_max,
        )
        self._accepts = TokenBucket(limits.accepts_per_s, AT_ONCE, now_s)
        self._tasks: set[asyncio.Task[None]] = set()
        self._listening: list[socket.socket] = []

    def listen(self, listening: socket.socket) -> None:
        """Accept connections at a socket."""
        listening.setblocking(False)
        self._listening.append(listening)
        self._watch(listening)

    def close(self) -> None:
        """Stop accepting, and close waiting sockets."""
        for listening in self._listening:
            asyncio.get_running_loop().remove_reader(listening)
        self._listening.clear()
        self.turns.close()
        for task in self._tasks:
            task.cancel()

    def _watch(self, listening: socket.socket) -> None:
        if listening in self._listening:
            asyncio.get_running_loop().add_reader(listening, self._accept, listening)

    def _pause(self, listening: socket.socket, wait_s: float) -> None:
        loop = asyncio.get_running_loop()
        loop.remove_reader(listening)
        loop.call_later(wait_s, self._watch, listening)

    def _accept(self, listening: socket.socket) -> None:
        now_s = time.monotonic()
        for _ in range(AT_ONCE):
            if wait_s := self._accepts.wait_s(now_s):
                self._pause(listening, wait_s)
                return
            try:
                sock, peer = listening.accept()
            except (BlockingIOError, ConnectionError):
                return
            except OSError:  # out of file descriptors: try again later
                self._pause(listening, OUT_OF_FILES_S)
                return
            self._accepts.use()
            sock.setblocking(False)
            address = "" if self._behind_proxy else place_of(peer[0] if peer else "")
            self.turns.add(address, Arrival(sock, address, now_s + self._limits.head_s))

    def _serve(self, arrival: Arrival) -> None:
        arrival.until_s = time.monotonic() + self._limits.head_s
        arrival.task = asyncio.create_task(self._connect(arrival))
        self._tasks.add(arrival.task)
        arrival.task.add_done_callback(self._tasks.discard)
        if self._tls and not self._behind_proxy:
            self._newcomers.add(arrival.address, arrival)

    async def _connect(self, arrival: Arrival) -> None:
        arrival.has_begun = True
        timeout = {"ssl_handshake_timeout": self._limits.head_s} if self._tls else {}
        loop = asyncio.get_running_loop()
        try:
            with contextlib.suppress(OSError):  # the client has disconnected, or the TLS handshake failed
                await loop.connect_accepted_socket(self._make, arrival.socket, ssl=self._tls, **timeout)
        except asyncio.CancelledError:
            arrival.socket.close()
            raise
        finally:
            self._newcomers.remove(arrival)
