"""Transports of a session's client: a websocket at the origin of the page, or an untrusted broker."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator
from typing import Protocol, Self

import aiohttp

from phalanx.errors import PeerError
from phalanx.link.messages import Ask, Publish, Subscribe, Unsubscribe
from phalanx.link.session import Invitation
from phalanx.link.session.events import Transmit

from .broker_url import parse_broker_url
from .connection import Connection
from .websocket import CLOSE_S, end_websocket

CONNECT_S = 10.0
HEARTBEAT_S = 20.0
UNREAD = 256  # messages in the queue; further ones wait in the broker's connection, which may drop them
# Errors that are raised without a connection.
CONNECTION_ERRORS = (OSError, aiohttp.ClientError, TimeoutError)


class ClientTransport(Protocol):
    """One connection. Use as `async with`: entered once it is established."""

    async def __aenter__(self) -> Self:
        """Connect. Raises: CONNECTION_ERRORS; Unavailable: the broker refuses the connection."""

    async def __aexit__(self, *_: object) -> None:
        """Disconnect."""

    def messages(self) -> AsyncIterator[bytes]:
        """Yield received messages until the connection is closed."""

    async def send(self, message: Transmit) -> None:
        """Send a message. Raises: CONNECTION_ERRORS."""

    async def set_topics(self, topics: tuple[str, ...]) -> None:
        """Set the topics to receive from to exactly these."""

    async def close(self) -> None:
        """End `messages`."""


class WebsocketTransport:
    """Websocket. `max_bytes` limits a message; `rejected` counts messages that are not binary."""

    def __init__(self, url: str, max_bytes: int, rejected: Counter[str]) -> None:
        self._url, self._max_bytes, self._rejected = url, max_bytes, rejected
        self._http = aiohttp.ClientSession()
        self._socket: aiohttp.ClientWebSocketResponse | None = None

    async def __aenter__(self) -> Self:
        try:
            async with asyncio.timeout(CONNECT_S):
                self._socket = await self._http.ws_connect(
                    self._url, max_msg_size=self._max_bytes, heartbeat=HEARTBEAT_S
                )
        except BaseException:
            await self._http.close()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        try:
            await self.close()
        finally:  # also if `close` is cancelled
            await self._http.close()

    async def messages(self) -> AsyncIterator[bytes]:
        """Yield binary messages until the socket is closed."""
        assert self._socket is not None, "it is entered first"
        async for message in self._socket:
            if message.type is aiohttp.WSMsgType.BINARY:
                yield message.data
            else:
                self._rejected["unexpected"] += 1

    async def send(self, message: Transmit) -> None:
        """Send a message. Raises: CONNECTION_ERRORS."""
        assert self._socket is not None, "it is entered first"
        await self._socket.send_bytes(message.data)

    async def set_topics(self, topics: tuple[str, ...]) -> None:
        """Do nothing: there are no topics here."""

    async def close(self) -> None:
        """Close the socket."""
        if self._socket:
            await end_websocket(self._socket)


class BrokerTransport:
    """Topics on an invitation's broker. A connection does not mean that the swarm is reachable."""

    def __init__(self, invitation: Invitation, rejected: Counter[str]) -> None:
        self._root, self._rejected = invitation.root, rejected
        self._topics: tuple[str, ...] = ()
        self._came: asyncio.Queue[bytes | None] = asyncio.Queue(UNREAD)
        where = parse_broker_url(invitation.broker)
        self._link = Connection(
            where, "visitor", lambda: self._topics, self._on_message, None, invitation.mqtt, self._dropped
        )
        self._running: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._running = self._link.start()
        try:
            await self._link.wait_connected(CONNECT_S)
        except BaseException:
            await self.__aexit__()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._running:
            self._running.cancel()
            await asyncio.wait((self._running,), timeout=CLOSE_S)

    async def messages(self) -> AsyncIterator[bytes]:
        """Yield messages of the current topics until `close`; a lost broker is reconnected."""
        while (data := await self._came.get()) is not None:
            yield data

    async def send(self, message: Transmit) -> None:
        """Send a message. Raises: CONNECTION_ERRORS."""
        if not await self._link.send((Publish(f"{self._root}/{message.topic}", message.data),)):
            raise ConnectionError("the broker is unreachable")

    async def set_topics(self, topics: tuple[str, ...]) -> None:
        """Set the subscriptions to exactly these topics; a reconnect repeats those that failed."""
        wanted, before = tuple(f"{self._root}/{each}" for each in topics), self._topics
        self._topics = wanted
        asks: list[Ask] = [Subscribe(each) for each in wanted if each not in before]
        asks += [Unsubscribe(each) for each in before if each not in wanted]
        await asyncio.gather(*(self._link.send((ask,)) for ask in asks))

    async def close(self) -> None:
        """End `messages`, and drop unread ones."""
        while self._came.full():
            self._came.get_nowait()
        self._came.put_nowait(None)

    async def _on_message(self, topic: str, payload: bytes) -> None:
        if topic in self._topics:
            await self._came.put(payload)

    def _dropped(self, error: PeerError) -> None:
        self._rejected[error.reason] += 1
