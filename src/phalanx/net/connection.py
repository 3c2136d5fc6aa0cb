"""A connection to a broker that comes back by itself.

After every connect it subscribes again to whatever should be subscribed to *now*: a broker that was restarted remembers
nothing, and the published server, which does not ask again, stays deaf from then on.
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
from .packets import READ_FOR_S, CheckedClient, Emptied
from .websocket import by_websocket

log = logging.getLogger(__name__)
_SILENT = logging.getLogger(f"{__name__}.paho")
_SILENT.setLevel(logging.CRITICAL + 1)  # it quotes what peers send

KEEPALIVE_S = 60
# From a broker's return to the first retry: the last wait before it, 1.5 s with jitter, well below the 5 s we promise.
FIRST_RETRY_S, LAST_RETRY_S = 0.2, 1.0
CONNECT_TIMEOUT_S = 5.0
# CONNACK codes of MQTT 3.1.1 and 5: bad credentials, not authorized; unacceptable protocol version.
REFUSED_LOGIN = frozenset({4, 5, 134, 135})
REFUSED_VERSION = frozenset({1, 132})
LOGIN_HINT = "--broker-login, or set PHALANX_BROKER_USERNAME and PHALANX_BROKER_PASSWORD"
_ERRNO = re.compile(r"\[Errno (-?\d+)\]")
_CODE = re.compile(r"^\[code:\d+\] ")
_MISTRUST = re.compile(r"certificate verify failed: (.*?)\.?(?: \(_ssl|$)")
# What libraries say that only they understand.
_PLAIN = {
    "WRONG_VERSION_NUMBER": "no TLS there",
    "Disconnected during message iteration": "it hung up",
}
DENIED = 0x80  # SUBACK codes from here on are refusals, in 3.1.1 and 5


class LoginRefused(Unavailable):
    """The broker takes nobody of this name and password."""


class _DeniedError(aiomqtt.MqttError):
    """The broker answered a subscription, and did not grant it."""


class Connection:
    """One MQTT client.

    Args:
        broker: where.
        name: for the log; the MQTT client id is random and known to nobody else, who could use it to take over.
        subscriptions: filters that should be subscribed to, asked at every connect.
        on_message: awaited with each message's topic and payload, in order.
        on_connect: called after each connect and subscribe; true for a reconnect.
        mqtt: protocol version to begin with, 5 or 4; the other is tried if the broker refuses it.
        on_dropped: called for every message that was dropped unread, for it is too large, say; overruns are counted.
        stale_s: what waits longer, with many behind it, is dropped.
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
        self.overruns = 0  # messages that came faster than they were read: only counted, for they come in thousands
        self.trouble = ""
        self.waited_s = 0.0  # how long the message being handled lay here unread
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
        self._told_later = 0  # who waits for a time only, and is told then what is wrong

    def start(self) -> asyncio.Task[None]:
        """Stay connected until the task that this returns is cancelled.

        It ends with `Unavailable` if the broker refuses the login or cannot be trusted before the first connect.
        """
        self._running = asyncio.create_task(self._run())
        return self._running

    async def wait_connected(self, timeout_s: float | None = None) -> None:
        """Wait for the broker, for ever unless told otherwise.

        Raises: TimeoutError: says which broker, and what is wrong. Unavailable: it refused the login, or cannot be
            trusted.
        """
        assert self._running is not None, "start() comes first"
        connected = asyncio.create_task(self.connected.wait())
        self._told_later += timeout_s is not None
        try:
            done, _ = await asyncio.wait(
                (connected, self._running), timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED
            )
        finally:
            connected.cancel()
            self._told_later -= timeout_s is not None
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
        """Carry out what a side of the link asks; false if the broker is away: then it is not done, now or later.

        Nothing is queued for a broker that is away: a joystick's command must not come true a minute late. Only what
        should be subscribed to is made good: by connecting anew, if a subscription fails.
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
        # paho connects in a thread that nothing can stop: an unreachable host would block Ctrl-C.
        await self._reach()
        async with contextlib.AsyncExitStack() as stack:
            way = None
            if self.broker.websockets:
                async with asyncio.timeout(CONNECT_TIMEOUT_S):
                    way = await stack.enter_async_context(by_websocket(self.broker))
            await self._speak(way)

    async def _speak(self, way: socket.socket | None) -> None:
        emptied = Emptied()
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
            # No await from the last look at the subscriptions to here: what changes later finds a client to tell.
            self._client = client
            self.trouble = ""
            if self._ever:
                self.reconnects += 1
            level = logging.WARNING if self._ever else logging.INFO  # who read that it was lost reads that it is back
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
                    # aiomqtt takes some turns of the loop for each; as many more may have come in each.
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
        """The broker knows what should be subscribed to now, which may have changed while it was told."""
        known: tuple[str, ...] = ()
        while (wanted := tuple(self._subscriptions())) != known:
            # All at once: on a broker there are topics of a thousand sessions, and it may be far.
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
        words = _in_words(error)
        if isinstance(error, _DeniedError):
            told = f"the broker at {self.broker} {words}; trying again"
        elif self._ever:
            told = f"lost the broker at {self.broker} ({words}); trying again"
        else:
            self._not_yet(error, words)
            told = f"no broker at {self.broker} yet ({words}); waiting for it"
        if words != self.trouble:  # once, not at every try
            log.log(logging.WARNING if self._ever or not self._told_later else logging.INFO, "%s", told)
        self.trouble = words

    def _not_yet(self, error: BaseException, words: str) -> None:
        """Deal with a broker that was never reached: end if waiting is no use, or try its other version."""
        code = getattr(error, "rc", None)
        number = getattr(code, "value", code)
        if number in REFUSED_LOGIN:
            raise LoginRefused(
                f"the broker at {self.broker} refused the login",
                "its name or password is wrong" if self.broker.login else LOGIN_HINT,
            ) from error
        if mistrust := _MISTRUST.search(words):
            raise Unavailable(
                f"cannot trust the certificate of the broker at {self.broker}: {mistrust[1].lower()}",
                "check its host name and port; SSL_CERT_FILE names the file of an authority of your own",
            ) from error
        if number in REFUSED_VERSION or (number is None and not _ERRNO.search(str(error))):
            # Somebody was there and hung up (no errno): how a broker that only knows 3.1.1 refuses 5.
            self.mqtt = 9 - self.mqtt


def _in_words(error: BaseException) -> str:
    """What is wrong, in the system's words without its numbers; once, however many addresses were tried."""
    text = str(error)
    number = _ERRNO.search(text)
    if plain := next((plain for said, plain in _PLAIN.items() if said in text), ""):
        return plain
    if number is None:
        text = _CODE.sub("", text)
        return text or ("no answer" if isinstance(error, TimeoutError) else type(error).__name__)
    # Names that are not found have numbers of their own, below 0.
    return os.strerror(int(number[1])).lower() if int(number[1]) > 0 else text.partition("] ")[2].lower()


async def _subscribe(client: aiomqtt.Client, topic: str) -> None:
    granted = await client.subscribe(topic, qos=0)
    if any(getattr(code, "value", code) >= DENIED for code in granted):
        raise _DeniedError(f"denies us the subscription to {topic}: see its access control")


def _heed_cancelling(before: int = 0) -> None:
    # aiomqtt may answer a cancellation with an MqttError (no answer to its DISCONNECT), or with success (wait_for
    # before Python 3.12): we would live on, and whoever waits for our end, for ever.
    if _cancellations() > before:
        raise asyncio.CancelledError


def _cancellations() -> int:
    task = asyncio.current_task()
    return task.cancelling() if task else 0


def _connect_properties() -> Properties:
    properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
    properties.MaximumPacketSize = MAX_PACKET_BYTES
    return properties
