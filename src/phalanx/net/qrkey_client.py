"""Client of a swarm in mode qrkey, for programs. Exported as `phalanx.link.QrkeyClient`."""

from __future__ import annotations

import asyncio
import logging
import os
import random
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable
from typing import Any, Self

from phalanx.config import LinkConfig
from phalanx.errors import OpenError, Stale, Unavailable, UsageError
from phalanx.link.client_side import ClientSide
from phalanx.link.messages import Moved, Notification, Rejected, Reply
from phalanx.link.qrurl import Login, QrUrl, parse_qr_url
from phalanx.link.topics import CommandTopic

from .broker_url import BrokerUrl, parse_broker_url
from .connection import Connection

log = logging.getLogger(__name__)

# Limits of the queue of notifications, in sealed bytes. Parsed, that many bytes of JSON can take 76 MB.
UNREAD, UNREAD_BYTES = 256, 4 * 1024 * 1024
# An unanswered request is sent again, so that a client that missed a rotation gets the new pin (ADR 0004).
ASK_AGAIN_S = 1.5


class QrkeyClient:
    """Client of one visitor. Use as `async with`: entered once the broker is connected.

    Args:
        qr: link of the QR code, or the result of `parse_qr_url`.
        broker: URL of the broker, if not the websocket in the link.
        login: login for a broker that requires one.
        config: parameters of the protocol; by default with the root of `qr`.
        timeout_s: timeout for connecting to the broker on entering.
        clock: returns seconds since 1970; for tests.
    Raises: BadQrUrl, UsageError: a bad link or broker. Unavailable, on entering: no broker within the time, or it
        refused the login.
    Source: Qrkey §III.
    """

    def __init__(
        self,
        qr: str | QrUrl,
        *,
        broker: str | BrokerUrl | None = None,
        login: Login | None = None,
        config: LinkConfig | None = None,
        timeout_s: float = 10.0,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.qr = parse_qr_url(qr) if isinstance(qr, str) else qr
        self.skew_s: float | None = None
        broker = broker or self.qr.broker
        self._broker = parse_broker_url(broker, login or self.qr.login) if isinstance(broker, str) else broker
        self._timeout_s = timeout_s
        self._clock = clock
        client_id = f"phalanx_{os.urandom(8).hex()}"
        self._side = ClientSide(config or LinkConfig(root=self.qr.root), os.urandom, self.qr.pin, client_id)
        self._link: Connection | None = None
        self._running: asyncio.Task[None] | None = None
        self._waiting: dict[int, list[asyncio.Future[Any]]] = {}
        self._unread: asyncio.Queue[tuple[Any, int]] = asyncio.Queue()
        self._unread_bytes = 0
        self.dropped = 0  # notifications dropped because they were not read in time
        self.moves = 0  # changes to another epoch

    @property
    def rejected(self) -> dict[str, int]:
        """Return the number of refused messages, by reason."""
        return dict(self._side.rejected + Counter(overrun=self._link.overruns if self._link else 0))

    @property
    def client_id(self) -> str:
        """Return the client id, which names the topic for answers."""
        return self._side.client_id

    @property
    def epoch_topic(self) -> str:
        """Return the topic of the current epoch; it changes when the client follows a rotation."""
        return self._side.epoch.topic

    async def __aenter__(self) -> Self:
        self._link = Connection(
            self._broker,
            self.client_id,
            self._side.subscriptions,
            self._on_message,
            None,
            self.qr.mqtt,
            self._side.reject,
        )
        self._running = self._link.start()
        try:
            await self._link.wait_connected(self._timeout_s)
        except BaseException as error:
            await self.__aexit__()
            if isinstance(error, TimeoutError):
                raise Unavailable(str(error), "check that the swarm runs and that this machine reaches it") from error
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._running is not None
        self._running.cancel()
        await asyncio.gather(self._running, return_exceptions=True)

    async def command(self, address: str, name: str, payload: Any, application: str = "0") -> bool:
        """Send a command to one robot; return false if the broker is unreachable. Not acknowledged (QoS 0).

        Raises: UsageError: not entered; not JSON, or longer than servers accept. WrongTopic: bad address or name.
        Source: Qrkey Table I.
        """
        link = self._entered()
        return await link.send((self._side.command(CommandTopic(address, application, name), payload, self._clock()),))

    async def request(self, number: int, *, timeout_s: float = 10.0, **words: Any) -> Any:
        """Return the server's answer to request `number`; the request is repeated until then.

        Raises: UsageError: not entered. Unavailable: no answer in time; the message says if the clock is the cause.
        Source: docs/adr/0004.
        """
        link = self._entered()
        answer: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._waiting.setdefault(number, []).append(answer)
        deadline = time.monotonic() + timeout_s
        try:
            while (left_s := deadline - time.monotonic()) > 0:
                asked = self._side.epoch
                await link.send((self._side.request(number, self._clock(), **words),))
                # Jitter, so that many clients do not send at the same moment when a broker is back.
                wait_s = ASK_AGAIN_S * random.uniform(0.75, 1.25)  # noqa: S311  # not a secret
                done, _ = await asyncio.wait((answer,), timeout=min(wait_s, left_s))
                if done:
                    return answer.result()
                if moved := self._side.fall_back(asked):
                    await link.send(moved.asks)
        finally:
            answer.cancel()
            self._waiting[number].remove(answer)
        if self.skew_s is not None:
            raise Unavailable(
                f"this machine's clock is {abs(self.skew_s):.0f} s "
                f"{'behind' if self.skew_s > 0 else 'ahead of'} the swarm's",
                "set the clock, best by NTP",
            )
        raise Unavailable(
            f"no answer from the swarm within {timeout_s:g} s",
            "scan the code again, as it may have changed; otherwise see the operator's page",
        )

    async def notifications(self) -> AsyncIterator[Any]:
        """Yield payloads of notifications as they arrive; the oldest unread ones are dropped if there are too many."""
        while True:
            payload, size = await self._unread.get()
            self._unread_bytes -= size
            yield payload

    def _entered(self) -> Connection:
        if self._link is None:
            raise UsageError("the client is not entered", "use it as `async with client:`")
        return self._link

    async def _on_message(self, topic: str, token: bytes) -> None:
        event = self._side.receive(topic, token, self._clock())
        if isinstance(event, Rejected):
            log.debug("refused a message: %s", event.reason)
            if isinstance(event.error, OpenError) and isinstance(event.error.cause, Stale):
                self.skew_s = event.error.cause.skew_s
            return
        if isinstance(event, Moved):
            self.moves += 1
            await self._entered().send(event.asks)
            return
        self.skew_s = None
        if isinstance(event, Notification):
            self._keep(event.payload, len(token))
        else:
            self._on_answer(event)

    def _keep(self, payload: Any, size: int) -> None:
        self._unread.put_nowait((payload, size))
        self._unread_bytes += size
        while self._unread.qsize() > UNREAD or (self._unread_bytes > UNREAD_BYTES and self._unread.qsize() > 1):
            self._unread_bytes -= self._unread.get_nowait()[1]
            self.dropped += 1

    def _on_answer(self, reply: Reply) -> None:
        for answer in self._waiting.get(reply.number, ()):
            if not answer.done():
                answer.set_result(reply.data)
