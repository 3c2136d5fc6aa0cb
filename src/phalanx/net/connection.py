"""MQTT connection that reconnects by itself.

After every connect it subscribes to all current topics: a restarted broker has lost the subscriptions. The published
server does not subscribe again, and receives nothing after such a restart.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import os
import random
import re
import socket
import ssl
import time
from collections.abc import Awaitable, Callable, Iterable
from typing import cast

import aiomqtt
from aiomqtt.client import ProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from phalanx.errors import PeerError, Unavailable
from phalanx.link.messages import Ask, Publish, Subscribe

from .broker_packets import MAX_PACKET_BYTES, Arrived
from .broker_url import BrokerUrl
from .incoming import INCOMING_MESSAGES, Incoming
from .packets import READ_FOR_S, CheckedClient, SocketEmptiedAt
from .websocket import websocket_as_socket

log = logging.getLogger(__name__)
_SILENT = logging.getLogger(f"{__name__}.paho")
_SILENT.setLevel(logging.CRITICAL + 1)  # paho's log contains messages of peers

KEEPALIVE_S = 60
# A broker that is back is retried within the last wait, at most 1.5 s with jitter; the promise is 5 s.
FIRST_RETRY_S, LAST_RETRY_S = 0.2, 1.0
CONNECT_TIMEOUT_S = 5.0
# CONNACK codes of MQTT 3.1.1 and 5: bad credentials, not authorized; unacceptable protocol version.
REFUSED_LOGIN = frozenset({4, 5, 134, 135})
REFUSED_VERSION = frozenset({1, 132})
LOGIN_HINT = "use --broker-login, or set PHALANX_BROKER_USERNAME and PHALANX_BROKER_PASSWORD"
_ERRNO = re.compile(r"\[Errno (-?\d+)\]")
_CODE = re.compile(r"^\[code:\d+\] ")
_MISTRUST = re.compile(r"certificate verify failed: (.*?)\.?(?: \(_ssl|$)")
# Clear texts for error messages of libraries.
_PLAIN = {
    "WRONG_VERSION_NUMBER": "no TLS there",
    "Disconnected during message iteration": "it closed the connection",
}
DENIED = 0x80  # SUBACK codes from here on are refusals, in 3.1.1 and 5


class LoginRefused(Unavailable):
    """The broker refused the user name and password, or requires a login."""


class _DeniedError(aiomqtt.MqttError):
    """The broker refused a subscription."""


class Connection:
    """MQTT client that stays connected to one broker.

    Args:
        broker: address of the broker.
        name: for the log. The MQTT client id is random and secret: another client with the same id could replace it.
        subscriptions: returns the filters to subscribe to; called at every connect.
        on_message: awaited with each message's topic and payload, in order.
        on_connect: awaited after each connect and subscribe; its argument is true for a reconnect.
        mqtt: protocol version to try first, 5 or 4; the other follows if the broker refuses it.
        on_dropped: called for each message dropped unread, such as one that is too large; overruns are only counted.
        stale_s: age beyond which a queued message is dropped if many wait behind it.
    """

    def __init__(
        self,
        broker: BrokerUrl,
        name: str,
        subscriptions: Callable[[], Iterable[str]],
        on_message: Callable[[str, bytes], Awaitable[None]],
        on_connect: Callable[[bool], Awaitable[None]] | None,
        mqtt: int = 5,
        on_dropped: Callable[[PeerError], object] = lambda _: None,
        stale_s: float = math.inf,
    ) -> None:
        self._stale_s = stale_s
        self.broker = broker
        self.mqtt = mqtt
        self.connected = asyncio.Event()
        self.reconnects = 0
        self.overruns = 0  # messages dropped because the queue was full; only counted, as there may be thousands
        self.trouble = ""  # error of the last attempt, or ""
        self.waited_s = 0.0  # time that the current message waited in the queue
        self._name = name
        self._subscriptions = subscriptions
        self._on_message = on_message
        self._on_connect = on_connect
        self._on_dropped = on_dropped
        self._running: asyncio.Task[None] | None = None
        self._client: aiomqtt.Client | None = None
        self._cut: BaseException | None = None
        self._lifetime = asyncio.timeout(None)
        self._ever = False
        self._waits = 0  # callers with a timeout in wait_connected, which report the error themselves

    def start(self) -> asyncio.Task[None]:
        """Start the task that keeps the connection until it is cancelled.

        Before the first connect it raises `Unavailable` if the broker refuses the login or has no valid certificate.
        """
        self._running = asyncio.create_task(self._run())
        return self._running

    async def wait_connected(self, timeout_s: float | None = None) -> None:
        """Wait until the broker is connected.

        Raises: TimeoutError: with the broker's address and the last error. Unavailable: it refused the login, or has
            no valid certificate.
        """
        assert self._running is not None, "start() comes first"
        connected = asyncio.create_task(self.connected.wait())
        self._waits += timeout_s is not None
        try:
            done, _ = await asyncio.wait(
                (connected, self._running), timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED
            )
        finally:
            connected.cancel()
            self._waits -= timeout_s is not None
        if self._running in done:
            self._running.result()
        if not done:
            raise TimeoutError(f"no broker at {self.broker} within {timeout_s:g} s ({self.trouble or 'no answer'})")

    async def _run(self) -> None:
        wait_s = FIRST_RETRY_S
        while True:
            try:
                await self._live()
            except (TimeoutError, aiomqtt.MqttError, OSError) as error:
                _heed_cancelling()
                wait_s = FIRST_RETRY_S if self.connected.is_set() else min(wait_s * 2, LAST_RETRY_S)
                self._down(self._cut or error)
            finally:
                self._cut = None
                self.connected.clear()
                self._client = None
            await asyncio.sleep(wait_s * random.uniform(0.5, 1.5))  # noqa: S311  # spreads retries, hides nothing

    async def send(self, asks: Iterable[Ask]) -> bool:
        """Carry out requests to the broker; return false if it is unreachable: then they are dropped.

        Nothing is queued for an unreachable broker, because a joystick's command must not take effect a minute late.
        A failed subscription leads to a reconnect, which subscribes to all current topics.
        """
        before = _cancellations()
        sent = await self._send(asks)
        _heed_cancelling(before)
        return sent

    async def _send(self, asks: Iterable[Ask]) -> bool:
        client = self._client
        if client is None:
            return False
        try:
            for ask in asks:
                if isinstance(ask, Publish):
                    await client.publish(ask.topic, ask.payload, qos=0, retain=False)
                elif isinstance(ask, Subscribe):
                    await _subscribe(client, ask.topic)
                else:
                    await client.unsubscribe(ask.topic)
        except (aiomqtt.MqttError, OSError, ValueError) as error:
            log.debug("%s: not sent: %s", self._name, error)
            if isinstance(ask, Subscribe) and self._client is client:
                self._cut = error
                self._client = None
                self._lifetime.reschedule(asyncio.get_running_loop().time())
            return False
        return True

    async def _live(self) -> None:
        # paho connects in a thread that cannot be cancelled: with an unreachable host it would block Ctrl-C.
        await self._reach()
        async with contextlib.AsyncExitStack() as stack:
            way = None
            if self.broker.websockets:
                async with asyncio.timeout(CONNECT_TIMEOUT_S):
                    way = await stack.enter_async_context(websocket_as_socket(self.broker))
            await self._speak(way)

    async def _speak(self, way: socket.socket | None) -> None:
        emptied = SocketEmptiedAt()
        incoming = Incoming(self._overrun, emptied, self._note_wait, INCOMING_MESSAGES, stale_s=self._stale_s)
        client = CheckedClient(
            self.broker.host,
            self.broker.port,
            identifier=f"phalanx{os.urandom(8).hex()}",
            username=self.broker.login.username if self.broker.login else None,
            password=self.broker.login.password if self.broker.login else None,
            protocol=ProtocolVersion.V5 if self.mqtt == 5 else ProtocolVersion.V311,
            tls_context=ssl.create_default_context() if self.broker.tls and not way else None,
            keepalive=KEEPALIVE_S,
            timeout=CONNECT_TIMEOUT_S,
            queue_type=cast("type[asyncio.Queue[aiomqtt.Message]]", lambda maxsize: incoming),  # noqa: ARG005
            properties=_connect_properties() if self.mqtt == 5 else None,
            logger=_SILENT,
            way=way,
            arrived=incoming.put_nowait,
            on_dropped=self._on_dropped,
            emptied=emptied,
        )
        async with client, asyncio.timeout(None) as self._lifetime:
            await self._subscribe_to_all(client)
            _heed_cancelling()
            # No await between the last check of the subscriptions and here, so that no later change is missed.
            self._client = client
            self.trouble = ""
            if self._ever:
                self.reconnects += 1
            level = logging.WARNING if self._ever else logging.INFO  # same level as the message of the loss
            log.log(level, "connected to %s, MQTT %s", self.broker, "5" if self.mqtt == 5 else "3.1.1")
            self.connected.set()
            again, self._ever = self._ever, True
            watching = asyncio.create_task(emptied.watch())
            try:
                if self._on_connect:
                    await self._on_connect(again)
                async for first in client.messages:
                    until_s, message = time.monotonic() + READ_FOR_S, cast("Arrived", first)
                    await self._on_message(*message)
                    # aiomqtt needs some turns of the event loop per message: process all queued ones in this turn.
                    while not incoming.empty() and time.monotonic() < until_s:
                        await self._on_message(*incoming.get_nowait())
            finally:
                watching.cancel()
                self._client = None

    def _overrun(self) -> None:
        self.overruns += 1

    def _note_wait(self, waited_s: float) -> None:
        self.waited_s = waited_s

    async def _subscribe_to_all(self, client: aiomqtt.Client) -> None:
        """Subscribe to all current topics, until they no longer change in the meantime."""
        known: tuple[str, ...] = ()
        while (wanted := tuple(self._subscriptions())) != known:
            # Concurrently: there may be topics of a thousand sessions, and a long round trip.
            await asyncio.gather(
                *(_subscribe(client, topic) for topic in wanted if topic not in known),
                *(client.unsubscribe(topic) for topic in known if topic not in wanted),
            )
            known = wanted

    async def _reach(self) -> None:
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            _, writer = await asyncio.open_connection(self.broker.host, self.broker.port)
        writer.close()

    def _down(self, error: BaseException) -> None:
        reason = _in_words(error)
        if isinstance(error, _DeniedError):
            message = f"the broker at {self.broker} {reason}; trying again"
        elif self._ever:
            message = f"lost the broker at {self.broker} ({reason}); trying again"
        else:
            self._not_yet(error, reason)
            message = f"no broker at {self.broker} yet ({reason}); waiting for it"
        if reason != self.trouble:  # once, not at every attempt
            log.log(logging.WARNING if self._ever or not self._waits else logging.INFO, "%s", message)
        self.trouble = reason

    def _not_yet(self, error: BaseException, reason: str) -> None:
        """Handle an error before the first connect: raise if retrying cannot help, or try the other MQTT version."""
        code = getattr(error, "rc", None)
        number = getattr(code, "value", code)
        if number in REFUSED_LOGIN:
            raise LoginRefused(
                f"the broker at {self.broker} refused the login",
                "check user name and password" if self.broker.login else LOGIN_HINT,
            ) from error
        if mistrust := _MISTRUST.search(reason):
            raise Unavailable(
                f"cannot trust the certificate of the broker at {self.broker}: {mistrust[1].lower()}",
                "check its host name and port; set SSL_CERT_FILE for a certificate authority of your own",
            ) from error
        if number in REFUSED_VERSION or (number is None and not _ERRNO.search(str(error))):
            # The connection was accepted and closed (no errno): so a broker with only 3.1.1 refuses 5.
            self.mqtt = 9 - self.mqtt


def _in_words(error: BaseException) -> str:
    """Return a short text for an error: the system's message without numbers, and for one address only."""
    text = str(error)
    number = _ERRNO.search(text)
    if plain := next((plain for phrase, plain in _PLAIN.items() if phrase in text), ""):
        return plain
    if number is None:
        text = _CODE.sub("", text)
        return text or ("no answer" if isinstance(error, TimeoutError) else type(error).__name__)
    # Errors of name resolution have negative numbers.
    return os.strerror(int(number[1])).lower() if int(number[1]) > 0 else text.partition("] ")[2].lower()


async def _subscribe(client: aiomqtt.Client, topic: str) -> None:
    granted = await client.subscribe(topic, qos=0)
    if any(getattr(code, "value", code) >= DENIED for code in granted):
        raise _DeniedError(f"denies the subscription to {topic}: check its access control")


def _heed_cancelling(before: int = 0) -> None:
    # aiomqtt may turn a cancellation into an MqttError (no answer to its DISCONNECT) or into success (wait_for before
    # Python 3.12): this task would go on, and its canceller would wait for ever.
    if _cancellations() > before:
        raise asyncio.CancelledError


def _cancellations() -> int:
    task = asyncio.current_task()
    return task.cancelling() if task else 0


def _connect_properties() -> Properties:
    properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
    properties.MaximumPacketSize = MAX_PACKET_BYTES
    return properties
