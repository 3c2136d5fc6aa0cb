"""Connection of a session's client, over a websocket or a broker: connect, reconnect, resume, and store secrets."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import random
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

from phalanx.config.session import SessionConfig
from phalanx.errors import PeerError, Unavailable
from phalanx.link.session import EndReason, Invitation, Secret, SessionClient
from phalanx.link.session.events import Admitted, ClientEvent, Ended, KeepSecret, SetTopics, Transmit
from phalanx.link.session.invitation import BadInvitation
from phalanx.link.session.slots import SealRecord
from phalanx.wire.sessions import LINK_PATH, TAG_BYTES, UPDATE

from .resume_file import read_resume, write_resume
from .session_ways import CONNECTION_ERRORS, BrokerTransport, ClientTransport, WebsocketTransport
from .websocket import CLOSE_S

log = logging.getLogger(__name__)

LOST = "the connection to the swarm is lost", "wait: the client reconnects by itself"
RETRY_S = (0.25, 4.0)  # first and longest pause before reconnecting
REFUSALS = 3  # unanswered first messages after which an admitted client's session counts as over
RESUMED = (EndReason.OLD_KEYS, EndReason.CLOSING)  # end reasons after which a client resumes


class SessionOver(PeerError):
    """The session has ended; `why` is the swarm's reason, or None if it gave none."""

    def __init__(self, why: EndReason | None, message: str = "") -> None:
        self.why = why
        given = why.name.lower().replace("_", " ") if why else "the swarm does not admit this client"
        super().__init__(message or f"the session is over: {given}")


class SessionConnection:
    """Connection of one visitor, which reconnects when it is lost.

    Args:
        url: URL of the websocket; not used if the invitation names a broker.
        secret_file: file for the resume secret; None: only in memory.
        away_s: time after which a lost connection is given up.
        on_event: called with the protocol's events, in order.
        on_lost: called when the connection is lost, or the session is over.

    Attributes:
        failure: the error that ended the session; None while it goes on.
    Raises: Unavailable: the file cannot be read; UsageError: it is no session file.
    """

    def __init__(
        self,
        url: str,
        invitation: Invitation,
        *,
        name: str,
        config: SessionConfig,
        secret_file: Path | None,
        away_s: float,
        on_event: Callable[[ClientEvent], None],
        on_lost: Callable[[], None],
    ) -> None:
        self.url, self.invitation, self._name = url, invitation, name
        self._config, self._file, self._away_s = config, secret_file, away_s
        self._on_event, self._on_lost = on_event, on_lost
        self._secret: Secret | None = read_resume(secret_file, invitation) if secret_file else None
        self._was_admitted = self._spares_secret = False
        self._rejected: Counter[str] = Counter()
        self._way: ClientTransport | None = None
        self.protocol: SessionClient | None = None
        self.failure: PeerError | Unavailable | None = None

    @property
    def is_joined(self) -> bool:
        """Return whether records can be sent now."""
        return self._way is not None and self.protocol is not None and self.protocol.is_joined

    @property
    def rejected(self) -> Counter[str]:
        """Return the number of refused messages of the server, by reason."""
        return self._rejected + (self.protocol.rejected if self.protocol else Counter())

    def count(self, error: PeerError) -> None:
        """Count an authentic message with invalid content."""
        self._rejected[error.reason] += 1

    def fail(self, failure: PeerError | Unavailable) -> None:
        """End the session with this error, if it is not over."""
        if self.failure is None:
            self.failure = failure
            self._on_lost()

    async def transmit(self, say: SealRecord) -> None:
        """Seal a record, and send it. Raises: SessionOver; Unavailable: the connection is lost."""
        if self.failure:
            raise self.failure
        if self._way is None or not self.is_joined:
            raise Unavailable(*LOST)
        try:
            await self._way.send(say(_now_ms()))
        except CONNECTION_ERRORS as error:
            raise Unavailable(*LOST) from error

    async def leave(self) -> None:
        """End the session; the resume secret stays valid."""
        self.fail(SessionOver(None, "this client has left"))
        with contextlib.suppress(*CONNECTION_ERRORS):
            async with asyncio.timeout(CLOSE_S):
                if self.protocol and not self.protocol.is_over:
                    await self._carry_out(self.protocol.leave(_now_ms()))
                if self._way:
                    await self._way.close()

    async def run(self) -> None:
        """Connect, and reconnect when the connection is lost, until the session is over."""
        pause_s, refusals, lost_s = RETRY_S[0], 0, time.monotonic()
        while not self.failure:
            why = ""
            try:
                admitted = await self._connect()
            except (PeerError, Unavailable) as error:
                self.fail(error)
            except CONNECTION_ERRORS as error:
                why = f": {error}" if str(error) else ""
            else:
                if admitted:
                    pause_s, refusals, lost_s = RETRY_S[0], 0, time.monotonic()
                else:
                    refusals += 1
                    self._refused(refusals)
            self._way = None
            self._on_lost()
            if time.monotonic() - lost_s > self._away_s:
                self.fail(Unavailable(f"no connection to the swarm for {self._away_s:g} s{why}"))
            if not self.failure:
                log.info("reconnecting%s", why)
                await asyncio.sleep(pause_s * random.uniform(0.75, 1.25))  # noqa: S311  # jitter, not a secret
                pause_s = min(2 * pause_s, RETRY_S[1])

    async def _connect(self) -> bool:
        """Hold one connection until its end; return whether the server admitted this visitor."""
        config, invitation = self._config, self.invitation
        if self._secret and not self._spares_secret:
            invitation = replace(invitation, secret=self._secret)
        self._rejected = self.rejected
        self.protocol = protocol = SessionClient(config, invitation, os.urandom, self._name)
        longest = UPDATE.size + config.max_to_client_bytes + TAG_BYTES
        way: ClientTransport = (
            BrokerTransport(invitation, self._rejected)
            if invitation.broker
            else WebsocketTransport(self.url, longest, self._rejected)
        )
        admitted = False
        async with way:
            self._way = way
            await self._carry_out(protocol.start(_now_ms()))
            ticks = asyncio.create_task(self._tick(way, protocol))
            try:
                async for data in way.messages():
                    await self._carry_out(protocol.receive(data, _now_ms()))
                    admitted = admitted or protocol.is_joined
                    if protocol.is_over:
                        break
            finally:
                ticks.cancel()
        return admitted

    async def _tick(self, way: ClientTransport, protocol: SessionClient) -> None:
        while not protocol.is_over:
            await asyncio.sleep(1)
            with contextlib.suppress(*CONNECTION_ERRORS):  # the reading task handles the error
                await self._carry_out(protocol.tick(_now_ms()))
        await way.close()

    async def _carry_out(self, events: list[ClientEvent]) -> None:
        for event in events:
            match event:
                case Transmit() if self._way:
                    await self._way.send(event)
                case SetTopics(topics) if self._way:
                    await self._way.set_topics(topics)
                case KeepSecret(secret, lifetime_s):
                    await self._keep(secret, lifetime_s)
                case Ended(why):
                    self._ended(why)
                case Admitted():
                    self._was_admitted = True
            self._on_event(event)

    async def _keep(self, secret: Secret, lifetime_s: int) -> None:
        if self._file:
            try:
                await asyncio.to_thread(write_resume, self._file, self.invitation, secret, lifetime_s)
            except Unavailable as error:
                log.warning("cannot store the resume secret: %s", error)
                return  # the server still accepts the previous secret, which is in the file
        self._secret = secret
        if self.protocol and self.protocol.is_joined:
            await self._carry_out([self.protocol.stored(secret, _now_ms())])

    def _ended(self, why: EndReason | None) -> None:
        # The stored secret may be that of a removed visitor: then `_refused` tries the invitation.
        is_old = why is EndReason.NOT_ADMITTED and self._secret and not self._was_admitted
        if why is not None and why not in RESUMED and not is_old:
            self.fail(SessionOver(why))

    def _refused(self, times: int) -> None:
        """Handle a connection without admission: try another secret, or fail. On a broker the server may be down."""
        if self.invitation.broker:
            self._spares_secret = not self._was_admitted and not self._spares_secret
        elif self._secret and not self._was_admitted:
            self._secret = None
        elif times >= REFUSALS or not self._was_admitted:
            self.fail(SessionOver(None))


def websocket_url(url: str) -> str:
    """Return the websocket's URL at the origin of a page. Raises: BadInvitation."""
    try:
        parts = urlsplit(url.strip())
        host, port = parts.hostname, parts.port
    except ValueError:
        raise BadInvitation("the URL has no valid address") from None
    if parts.scheme not in ("http", "https") or not host or parts.username is not None:
        raise BadInvitation("the URL does not begin with http://host or https://host")
    name = f"[{host}]" if ":" in host else host
    return f"{'wss' if parts.scheme == 'https' else 'ws'}://{name}{f':{port}' if port else ''}{LINK_PATH}"


def _now_ms() -> int:
    return time.monotonic_ns() // 1_000_000
