"""A connection to a broker that comes back by itself.

After every connect it subscribes again to whatever should be subscribed to *now*: a broker that was restarted remembers
nothing, and the published server, which does not ask again, stays deaf from then on.
"""

from __future__ import annotations

import asyncio
import logging
import os
import random
import ssl
from collections.abc import Awaitable, Callable, Iterable

import aiomqtt
from aiomqtt.client import ProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from phalanx.errors import Unavailable
from phalanx.link.messages import Ask, Publish, Subscribe

from .broker_url import BrokerUrl

log = logging.getLogger(__name__)

KEEPALIVE_S = 60
# From a broker's return to the first retry: the last wait before it, 1.5 s with jitter, well below the 5 s we promise.
FIRST_RETRY_S, LAST_RETRY_S = 0.2, 1.0
CONNECT_TIMEOUT_S = 5.0
INCOMING_LIMIT = 5_000
MAX_PACKET_BYTES = 2 * 1024 * 1024  # above the largest message a client reads: 1 MiB of plaintext, 4/3 of that sealed
# CONNACK codes of MQTT 3.1.1 and 5: bad credentials, not authorized; unacceptable protocol version.
REFUSED_LOGIN = frozenset({4, 5, 134, 135})
REFUSED_VERSION = frozenset({1, 132})


class Connection:
    """One MQTT client.

    Args:
        broker: where.
        name: for the log; the MQTT client id is random and known to nobody else, who could use it to take over.
        subscriptions: filters that should be subscribed to, asked at every connect.
        on_message: awaited with each message's topic and payload, in order.
        on_connect: called after each connect and subscribe; true for a reconnect.
        mqtt: protocol version to begin with, 5 or 4; the other is tried if the broker refuses it.
    """

    def __init__(
        self,
        broker: BrokerUrl,
        name: str,
        subscriptions: Callable[[], Iterable[str]],
        on_message: Callable[[str, bytes], Awaitable[None]],
        on_connect: Callable[[bool], Awaitable[None]],
        mqtt: int = 5,
    ) -> None:
        self.broker = broker
        self.mqtt = mqtt
        self.connected = asyncio.Event()
        self.reconnects = 0
        self.trouble = ""
        self._name = name
        self._subscriptions = subscriptions
        self._on_message = on_message
        self._on_connect = on_connect
        self._client: aiomqtt.Client | None = None
        self._ever = False

    async def run(self) -> None:
        """Stay connected until cancelled.

        Raises: Unavailable: before the first connect, the broker refused the login or its certificate is not trusted.
        """
        wait_s = FIRST_RETRY_S
        while True:
            try:
                await self._live()
            except (TimeoutError, aiomqtt.MqttError, OSError) as error:
                wait_s = FIRST_RETRY_S if self.connected.is_set() else min(wait_s * 2, LAST_RETRY_S)
                self._down(error)
            finally:
                self.connected.clear()
                self._client = None
            await asyncio.sleep(wait_s * random.uniform(0.5, 1.5))  # noqa: S311  # spreads retries, hides nothing

    async def send(self, asks: Iterable[Ask]) -> bool:
        """Carry out what a side of the link asks; false if the broker is away, and then it is not done later.

        Nothing is queued for a broker that is away: a joystick's command must not come true a minute late.
        """
        client = self._client
        if client is None:
            return False
        try:
            for ask in asks:
                if isinstance(ask, Publish):
                    await client.publish(ask.topic, ask.payload, qos=0, retain=False)
                elif isinstance(ask, Subscribe):
                    await client.subscribe(ask.topic, qos=0)
                else:
                    await client.unsubscribe(ask.topic)
        except (aiomqtt.MqttError, OSError, ValueError) as error:
            log.debug("%s: not sent: %s", self._name, error)
            return False
        return True

    async def _live(self) -> None:
        client = aiomqtt.Client(
            self.broker.host,
            self.broker.port,
            identifier=f"phalanx{os.urandom(8).hex()}",
            username=self.broker.login.username if self.broker.login else None,
            password=self.broker.login.password if self.broker.login else None,
            protocol=ProtocolVersion.V5 if self.mqtt == 5 else ProtocolVersion.V311,
            transport="websockets" if self.broker.websockets else "tcp",
            websocket_path=self.broker.path or None,
            tls_context=ssl.create_default_context() if self.broker.tls else None,
            keepalive=KEEPALIVE_S,
            timeout=CONNECT_TIMEOUT_S,
            max_queued_incoming_messages=INCOMING_LIMIT,
            properties=_connect_properties() if self.mqtt == 5 else None,
        )
        # paho connects in a thread that nothing can stop: an unreachable host would block Ctrl-C.
        await self._reach()
        async with client:
            for topic in self._subscriptions():
                await client.subscribe(topic, qos=0)
            self._client = client
            self.trouble = ""
            if self._ever:
                self.reconnects += 1
            log.info("connected to %s, MQTT %s", self.broker, "5" if self.mqtt == 5 else "3.1.1")
            self.connected.set()
            again, self._ever = self._ever, True
            await self._on_connect(again)
            async for message in client.messages:
                payload = message.payload
                await self._on_message(str(message.topic), payload if isinstance(payload, bytes) else b"")

    async def _reach(self) -> None:
        _, writer = await asyncio.wait_for(
            asyncio.open_connection(self.broker.host, self.broker.port), CONNECT_TIMEOUT_S
        )
        writer.close()

    def _down(self, error: BaseException) -> None:
        code = getattr(error, "rc", None)
        number = getattr(code, "value", code)
        words = str(error) or type(error).__name__
        if self._ever:
            log.warning("lost the broker at %s (%s); trying again", self.broker, words)
        elif number in REFUSED_LOGIN:
            raise Unavailable(
                f"the broker at {self.broker} refused the login",
                "set PHALANX_BROKER_USERNAME and PHALANX_BROKER_PASSWORD",
            ) from error
        elif "CERTIFICATE_VERIFY_FAILED" in words:
            raise Unavailable(
                f"cannot trust the certificate of the broker at {self.broker}",
                "check its host name and port, and that its authority is known to this machine",
            ) from error
        elif number in REFUSED_VERSION or (number is None and not words.startswith("[")):
            # Somebody was there and hung up (no errno): how a broker that only knows 3.1.1 refuses 5.
            self.mqtt = 9 - self.mqtt
        if not self._ever and not self.trouble:
            log.warning("no broker at %s yet (%s); waiting for it", self.broker, words)
        self.trouble = words


def _connect_properties() -> Properties:
    properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
    properties.MaximumPacketSize = MAX_PACKET_BYTES
    return properties
