"""A visitor of mode qrkey, for programs. Use it as `phalanx.link.QrkeyClient`."""

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

# What may wait for whoever reads notifications. Of so many sealed bytes, all of them {}, json made 76 MB.
UNREAD, UNREAD_BYTES = 256, 4 * 1024 * 1024
# A request without an answer is sent again: so a client that slept through a rotation finds its way (ADR 0004).
ASK_AGAIN_S = 1.5


class QrkeyClient:
    """One visitor of a swarm. Use as `async with`: entered once the broker is connected.

    Args:
        qr: the QR code's link, or what `parse_qr_url` made of it.
        broker: where to connect, if not to the websocket in the link: a URL, or a parsed one.
        login: for a broker that asks for one.
        config: the link's parameters; the root is the link's.
        timeout_s: how long entering waits for the broker.
        clock: seconds since 1970; for tests.
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
        self.dropped = 0  # notifications that nobody read in time
        self.moves = 0

    @property
    def rejected(self) -> dict[str, int]:
        """Refused messages by reason."""
        return dict(self._side.rejected + Counter(overrun=self._link.overruns if self._link else 0))

    @property
    def client_id(self) -> str:
        """Name under which answers come."""
        return self._side.client_id

    @property
    def epoch_topic(self) -> str:
        """Topic of the epoch this client lives in; changes when it follows a rotation."""
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
                raise Unavailable(str(error), "is the swarm up, and does this machine reach it?") from error
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._running is not None
        self._running.cancel()
        await asyncio.gather(self._running, return_exceptions=True)

    async def command(self, address: str, name: str, payload: Any, application: str = "0") -> bool:
        """Send a command to one robot; false if the broker is away. Nobody confirms that it arrived (QoS 0).

        Raises: UsageError: not entered; not JSON, or more than a server reads. WrongTopic: not an address or name.
        Source: Qrkey Table I.
        """
        link = self._entered()
        return await link.send((self._side.command(CommandTopic(address, application, name), payload, self._clock()),))

    async def request(self, number: int, *, timeout_s: float = 10.0, **words: Any) -> Any:
        """The data that the server answers to request `number`; asked again now and then until it does.

        Raises: UsageError: not entered. Unavailable: no answer in time; says so if this machine's clock is the reason.
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
                # Many clients that lost one broker shall not all ask in the moment in which it is back.
                wait_s = ASK_AGAIN_S * random.uniform(0.75, 1.25)  # noqa: S311  # spreads, hides nothing
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
            "the code may have changed: scan again; if it has not, the operator's page may say what is in the way",
        )

    async def notifications(self) -> AsyncIterator[Any]:
        """Payloads that the server sends to everybody, as they come; if nobody reads, the oldest are `dropped`."""
        while True:
            payload, size = await self._unread.get()
            self._unread_bytes -= size
            yield payload

    def _entered(self) -> Connection:
        if self._link is None:
            raise UsageError("the client is not entered", "async with client: …")
        return self._link

    async def _on_message(self, topic: str, token: bytes) -> None:
        said = self._side.receive(topic, token, self._clock())
        if isinstance(said, Rejected):
            log.debug("refused a message: %s", said.reason)
            if isinstance(said.error, OpenError) and isinstance(said.error.cause, Stale):
                self.skew_s = said.error.cause.skew_s
            return
        if isinstance(said, Moved):
            self.moves += 1
            await self._entered().send(said.asks)
            return
        self.skew_s = None
        if isinstance(said, Notification):
            self._keep(said.payload, len(token))
        else:
            self._on_answer(said)

    def _keep(self, payload: Any, size: int) -> None:
        self._unread.put_nowait((payload, size))
        self._unread_bytes += size
        while self._unread.qsize() > UNREAD or (self._unread_bytes > UNREAD_BYTES and self._unread.qsize() > 1):
            self._unread_bytes -= self._unread.get_nowait()[1]
            self.dropped += 1

    def _on_answer(self, said: Reply) -> None:
        for answer in self._waiting.get(said.number, ()):
            if not answer.done():
                answer.set_result(said.data)
