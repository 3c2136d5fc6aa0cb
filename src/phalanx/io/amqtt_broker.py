"""amqtt in this process, an extra: the broker for machines without mosquitto. Slower, and MQTT 3.1.1 only.

Visitors come by way of the guard, as to mosquitto.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import hmac
import logging
from collections.abc import AsyncIterator
from typing import Any

from amqtt.adapters import StreamReaderAdapter, StreamWriterAdapter
from amqtt.broker import Broker
from amqtt.contexts import Action, BrokerConfig, ListenerConfig, ListenerType
from amqtt.errors import BrokerError

from phalanx.errors import Unavailable

from .files import a_share
from .guarding import guarded
from .heard import Heard
from .listeners import Listeners
from .ports import LOOPBACK, PortTaken
from .private_folder import private_folder

VISITORS, GUARD = "visitors", "the guard"  # the listener for whom the guard lets in, and the address that all have
PROGRAMS = 200  # connections at the gateway's own door


class _CappedBroker(Broker):  # type: ignore[misc]  # amqtt is not typed
    """amqtt that keeps nothing for who is away, and lets visitors do little.

    As it comes it sends retained messages to clients that never subscribed.
    """

    def __init__(self, config: BrokerConfig, at: Listeners) -> None:
        super().__init__(config)
        self._at = at

    async def _authenticate(self, session: Any, _: Any) -> bool:
        login = self._at.login
        if session.remote_address == GUARD:
            return bool(session.username != login.username)
        said = session.username or "", session.password or ""
        return all(map(_is, said, (login.username, login.password)))

    async def add_subscription(self, subscription: tuple[str, int], session: Any) -> int:
        """At QoS 0: nothing waits for who does not answer."""
        code: int = await super().add_subscription((subscription[0], 0), session)
        return code

    async def _topic_filtering(self, session: Any, topic: str, action: Action) -> bool:
        if session.username == self._at.login.username or action is Action.SUBSCRIBE:
            return True
        return self._at.may_write(topic) if action is Action.PUBLISH else self._at.may_read(topic)

    async def retain_message(self, *_: Any, **__: Any) -> None:
        """Retain nothing."""


def _is(said: str, known: str) -> bool:
    return hmac.compare_digest(said.encode(), known.encode())


class _Unnamed(StreamWriterAdapter):  # type: ignore[misc]  # amqtt is not typed
    """Of a connection by a socket's path, whose other end has no address."""

    def get_peer_info(self) -> tuple[str, int]:
        """Something, or amqtt hangs up."""
        return GUARD, 0


@contextlib.asynccontextmanager
async def amqtt(at: Listeners) -> AsyncIterator[Heard]:
    """A running amqtt, for as long as the context lasts; yields what the gateway shall tell the guard before it.

    Raises: Unavailable: it does not start (a port taken, say).
    """
    # It reports every packet as information, and every client that leaves as a warning with a trace.
    for name in ("amqtt", "transitions"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    door = {"bind": f"{LOOPBACK}:{at.gateway_port}", "max_connections": a_share(PROGRAMS, 2)}
    listeners = {
        "default": ListenerConfig(type=ListenerType.TCP, **door),  # a name that amqtt insists on
        VISITORS: ListenerConfig(type=ListenerType.EXTERNAL),
    }
    plugins = {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}}
    broker = _CappedBroker(BrokerConfig(listeners=listeners, plugins=plugins), at)
    try:
        await broker.start()
    except (BrokerError, OSError) as error:
        for server in broker._servers.values():  # noqa: SLF001  # the listeners that it had opened by then
            await server.close_instance()
        cause = error.__cause__ or error
        taken = isinstance(cause, OSError) and cause.errno == errno.EADDRINUSE
        failure = PortTaken if taken else Unavailable
        raise failure(f"amqtt does not start: {error}", "phalanx doctor") from error

    async def come(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(ConnectionError):  # gone before its answer: asyncio would print a trace
            await broker.external_connected(StreamReaderAdapter(reader), _Unnamed(writer), VISITORS)

    try:
        with private_folder() as folder:
            async with (
                await asyncio.start_unix_server(come, folder / VISITORS),
                guarded(at, folder / VISITORS, folder) as heard,
            ):
                yield heard
    finally:
        with contextlib.suppress(asyncio.TimeoutError, asyncio.CancelledError, BrokerError):
            await asyncio.wait_for(broker.shutdown(), 1.0)
