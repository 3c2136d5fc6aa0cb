"""amqtt in this process, an extra: the broker for machines without mosquitto. Slower, and MQTT 3.1.1 only."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import hmac
import logging
from collections.abc import AsyncIterator
from functools import partial
from typing import Any

import websockets
from amqtt.broker import Broker
from amqtt.contexts import Action, BrokerConfig, ListenerConfig, ListenerType
from amqtt.errors import BrokerError

from phalanx.errors import Unavailable

from .files import a_share
from .listeners import Listeners
from .packets import MAX_PACKET_BYTES, MAX_TOPIC_BYTES
from .ports import LOOPBACK, PortTaken
from .visitor_packets import MAX_KEEPALIVE_S, is_one_topic

# Write buffers stop growing here (asyncio's and websockets' high-water marks); what comes later waits in tasks.
STALLED_BYTES = 32 * 1024
STALLED_CHECKS = 3
CHECK_S = 1.0
PROGRAMS, BROWSERS = 200, 1000  # connections, by TCP and by websocket
SUBSCRIPTIONS = 32  # of one client; a visitor has two, and two more while it follows a rotation
DENIED = 0x80  # SUBACK


class _CappedBroker(Broker):  # type: ignore[misc]  # amqtt is not typed
    """amqtt that keeps nothing for who is away, hangs up on who does not read, and lets visitors do little.

    As it comes it sends retained messages to clients that never subscribed, and buffers without limit for stalled ones.
    """

    def __init__(self, config: BrokerConfig, at: Listeners) -> None:
        super().__init__(config)
        self._at = at

    async def _initialize_client_session(self, *connection: Any) -> Any:
        handler, session = await super()._initialize_client_session(*connection)
        session.clean_session = True  # gone with its connection
        session.keep_alive = min(session.keep_alive or MAX_KEEPALIVE_S, MAX_KEEPALIVE_S)
        return handler, session

    async def _authenticate(self, session: Any, _: Any) -> bool:
        login = self._at.login
        if session.username != login.username:
            return True  # a visitor, whatever it says
        return hmac.compare_digest((session.password or "").encode(), login.password.encode())

    async def add_subscription(self, subscription: tuple[str, int], session: Any) -> int:
        """At QoS 0, and not without end; a visitor's names one topic."""
        held = sum(session is holder for holders in self._subscriptions.values() for holder, _ in holders)
        if held >= SUBSCRIPTIONS or len(subscription[0]) > MAX_TOPIC_BYTES:
            return DENIED
        if session.username != self._at.login.username and not is_one_topic(subscription[0].encode()):
            return DENIED
        code: int = await super().add_subscription((subscription[0], 0), session)
        return code

    async def _topic_filtering(self, session: Any, topic: str, action: Action) -> bool:
        if session.username == self._at.login.username or action is Action.SUBSCRIBE:
            return True
        return self._at.may_write(topic) if action is Action.PUBLISH else self._at.may_read(topic)

    async def retain_message(self, *_: Any, **__: Any) -> None:
        """Retain nothing."""

    async def _create_server_instance(
        self, listener_name: str, listener_type: ListenerType, address: str | None, port: int, ssl_context: Any
    ) -> Any:
        if listener_type is not ListenerType.WS:
            return await super()._create_server_instance(listener_name, listener_type, address, port, ssl_context)
        return await websockets.serve(
            partial(self.ws_connected, listener_name=listener_name),
            address,
            port,
            subprotocols=[websockets.Subprotocol("mqtt")],
            # MQTT has a keepalive of its own; paho answers a websocket's ping unmasked, and is hung up on for it.
            ping_interval=None,
            max_size=MAX_PACKET_BYTES,
        )

    async def hang_up_on_stalled_readers(self) -> None:
        """Close connections whose buffer stays full for three checks in a row; runs until cancelled."""
        full: dict[int, int] = {}
        while True:
            await asyncio.sleep(CHECK_S)
            now: dict[int, int] = {}
            for _, handler in list(self._sessions.values()):
                transport = _transport(handler)
                if transport is None or transport.get_write_buffer_size() < STALLED_BYTES:
                    continue
                now[id(transport)] = full.get(id(transport), 0) + 1
                if now[id(transport)] >= STALLED_CHECKS:
                    transport.abort()
            full = now


def _transport(handler: Any) -> asyncio.WriteTransport | None:
    """The transport below amqtt's adapters, by TCP or websocket."""
    writer = getattr(handler, "writer", None)
    inner = getattr(writer, "_writer", None) or getattr(writer, "_protocol", None)
    transport = getattr(inner, "transport", None)
    return transport if isinstance(transport, asyncio.WriteTransport) else None


@contextlib.asynccontextmanager
async def amqtt(at: Listeners) -> AsyncIterator[None]:
    """A running amqtt, for as long as the context lasts. Raises: Unavailable: it does not start (a port taken, say)."""
    # It reports every packet as information, and every client that leaves as a warning with a trace.
    for name in ("amqtt", "transitions", "websockets"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    own, browsers = a_share(PROGRAMS, 2), a_share(BROWSERS, 2)
    config = BrokerConfig(
        listeners={
            "default": ListenerConfig(type=ListenerType.TCP, bind=f"{LOOPBACK}:{at.gateway_port}", max_connections=own),
            "browsers": ListenerConfig(
                type=ListenerType.WS, bind=f"{at.ws_host}:{at.ws_port}", max_connections=browsers
            ),
        },
        plugins={"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}},
    )
    broker = _CappedBroker(config, at)
    try:
        await broker.start()
    except (BrokerError, OSError) as error:
        for server in broker._servers.values():  # noqa: SLF001  # the listeners that it had opened by then
            await server.close_instance()
        cause = error.__cause__ or error
        taken = isinstance(cause, OSError) and cause.errno == errno.EADDRINUSE
        failure = PortTaken if taken else Unavailable
        raise failure(f"amqtt does not start: {error}", "phalanx doctor") from error
    watch = asyncio.create_task(broker.hang_up_on_stalled_readers())
    try:
        yield
    finally:
        watch.cancel()
        with contextlib.suppress(asyncio.TimeoutError, asyncio.CancelledError, BrokerError):
            await asyncio.wait_for(broker.shutdown(), 1.0)
