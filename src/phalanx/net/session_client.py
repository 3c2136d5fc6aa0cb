"""Client of a swarm in mode session, for programs. Exported as `phalanx.link.Client`."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable, Sequence
from pathlib import Path
from typing import Any, Self

from phalanx.config.session import SessionConfig
from phalanx.errors import BadPayload, PeerError, Unavailable, UsageError
from phalanx.link.envelope import decode_json
from phalanx.link.session import Reason, parse_invitation
from phalanx.link.session.events import (
    Admitted,
    ClientEvent,
    Replied,
    StandingChanged,
    Transmit,
    Updated,
    WasRefused,
)
from phalanx.link.session.messages import Standing
from phalanx.link.session.slots import SealRecord, Slots
from phalanx.link.topics import ADDRESS, NAME, is_address

from .session_connection import LOST, SessionConnection, SessionOver, websocket_url
from .session_payloads import check_nickname, check_word, payload_bytes, wheels

__all__ = ["Client", "RequestRefused", "SessionOver"]

SLOT_S = 0.1  # time between two records while a robot is assigned or leased
FIRST_UPDATE_S = 1.0
REFUSED_WITHIN_S = 0.4  # wait for a refusal; refusals do not name their command
UNREAD, UNREAD_BYTES = 256, 4 * 1024 * 1024  # limits of the queue of unread updates
NO_ANSWER = "no answer from the swarm", "check that it runs, that this machine reaches it, and that the code is valid"
STILL_DRIVES = (Reason.LATE, Reason.TOO_MANY)  # refusals of one command after which the next may be accepted


class RequestRefused(PeerError):
    """The swarm refused a command or a request; `why` is its reason."""

    def __init__(self, what: str, why: Reason) -> None:
        self.why, self.reason = why, why.name.lower()  # type: ignore[misc]
        hint = "; another visitor drives it, and only that one and operators stop it" if why is Reason.BUSY else ""
        super().__init__(f"{what} was refused: {self.reason.replace('_', ' ')}{hint}")


class Client:
    """Client of one visitor. Use as `async with`: entered once it is admitted, or waits for approval.

    It reconnects and resumes the session by itself. While a robot is assigned to this visitor or leased, it sends one
    record every 0.1 s, whatever the commands, so that sizes and times of records reveal nothing.

    Args:
        url: URL of the QR code: `http://host:port/#j=…`.
        name: nickname; the swarm or the ticket may choose another.
        secret_file: file for the resume secret, readable by its owner alone, so that the next run is the same visitor.
        timeout_s: timeout of entering, and of requests.
        away_s: time after which a lost connection is given up.

    Attributes:
        visitor: id of the visitor; 0 before it is admitted.
        standing: current rights.
        commands: number of commands sent.
        refusals: number of refused commands and requests, by reason.
        dropped: number of updates dropped because they were not read in time.

    Raises: BadInvitation: URL; UsageError: name. On entering, Unavailable: no server; SessionOver: not admitted.
    Source: docs/spec/session.md.
    """

    def __init__(
        self,
        url: str,
        *,
        name: str = "",
        secret_file: Path | None = None,
        config: SessionConfig | None = None,
        timeout_s: float = 10.0,
        away_s: float = 60.0,
    ) -> None:
        check_nickname(name)
        invitation = parse_invitation(url)
        self.name, self.visitor = name, 0
        self.standing: Standing | None = None
        self.commands = 0
        self.refusals: Counter[str] = Counter()
        self.dropped = 0
        self._timeout_s = timeout_s
        self._connection = SessionConnection(
            "" if invitation.broker else websocket_url(url),
            invitation,
            name=name,
            config=config or SessionConfig(),
            secret_file=secret_file,
            away_s=away_s,
            on_event=self._on_event,
            on_lost=self._on_lost,
        )
        self._slots = Slots()
        self._driving: SealRecord | None = None  # the wheels of the newest `drive`
        self._tasks: list[asyncio.Task[None]] = []
        self._waiting: dict[int, asyncio.Future[bytes | Reason]] = {}  # pending replies, by request number
        self._pending: set[asyncio.Future[Any]] = set()  # futures that fail if the connection is lost
        self._refused: list[asyncio.Future[Reason]] = []  # futures of the next refusal of a command
        self._updates: deque[bytes] = deque()
        self._changed = asyncio.Event()  # set and replaced at each change of state
        self._has_seen = False  # an update has arrived in this connection

    @property
    def rejected(self) -> dict[str, int]:
        """Return the number of refused messages of the server, by reason."""
        return dict(self._connection.rejected)

    @property
    def is_joined(self) -> bool:
        """Return whether the session is established now."""
        return self._connection.is_joined

    async def __aenter__(self) -> Self:
        self._tasks = [asyncio.create_task(self._connection.run()), asyncio.create_task(self._pace())]
        try:
            await self._until(lambda: self.is_joined and self.standing is not None, self._timeout_s)
        except BaseException:
            await self.__aexit__()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.leave()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def leave(self) -> None:
        """End the session; the secret in the file stays valid for resuming."""
        await self._connection.leave()

    # --- requests ----------------------------------------------------------------------------------------------------

    async def request(self, name: str, payload: Any = None, *, timeout_s: float | None = None) -> Any:
        """Send a request, and return its reply.

        Raises: RequestRefused; BadPayload: the reply is not JSON; SessionOver; Unavailable: no reply, or the
            connection was lost; UsageError: the payload is not JSON or too long, or the name is not valid.
        """
        check_word(NAME, name, "a request's name")
        body = b"" if payload is None else payload_bytes(payload)
        answer = self._promise()

        def say(now_ms: int) -> Transmit:
            assert self._connection.protocol is not None
            number, record = self._connection.protocol.request(name, body, now_ms)
            self._waiting[number] = answer
            return record

        try:
            await self._say(say)
            async with asyncio.timeout(timeout_s or self._timeout_s):
                reply = await answer
        except TimeoutError as error:
            raise Unavailable(*NO_ANSWER) from error
        finally:
            answer.cancel()
            self._waiting = {number: each for number, each in self._waiting.items() if not each.done()}
        if isinstance(reply, Reason):
            raise RequestRefused(f"request {name}", reply)
        return decode_json(reply)

    async def robots(self) -> list[dict[str, Any]]:
        """Return the swarm's robots with valid addresses. Raises: as `request`; BadPayload: the reply is not a list."""
        robots = await self.request("robots")
        if not isinstance(robots, list):
            raise BadPayload("the answer is not a list of robots")
        return [each for each in robots if isinstance(each, dict) and is_address(each.get("address"))]

    async def updates(self) -> AsyncIterator[Any]:
        """Yield the swarm's updates as they arrive; the oldest unread ones are dropped if there are too many.

        Raises: SessionOver; Unavailable: the connection was lost for `away_s`.
        """
        while True:
            await self._until(lambda: bool(self._updates), None)
            try:
                yield decode_json(self._updates.popleft())
            except BadPayload as error:
                self._connection.count(error)

    # --- commands ----------------------------------------------------------------------------------------------------

    async def command(
        self, robot: str, name: str, payload: Any, *, stop: bool = False, refused_within_s: float = 0.0
    ) -> None:
        """Send a command to a robot. Commands are not acknowledged; wait for a refusal for `refused_within_s`.

        Raises: RequestRefused; SessionOver; Unavailable: connection lost; UsageError: an argument is not valid.
        """
        say = self._command(robot, name, payload, stop=stop)
        refused = self._next_refusal()
        try:
            await self._say(say, robot, stop=stop)
            if refused_within_s and (await asyncio.wait((refused,), timeout=refused_within_s))[0]:
                raise RequestRefused(f"{name} for {robot}", refused.result())
        finally:
            self._forget(refused)

    async def drive(self, robot: str, left_pct: float, right_pct: float, for_s: float = 1.0) -> bool:
        """Drive a robot for a time, then stop it; return false early if `stop` or another `drive` takes over.

        Raises: RequestRefused; else as `command`.
        """
        self._driving = say = self._command(robot, "move_raw", wheels(left_pct, right_pct))
        refused = self._next_refusal()
        await self._wait_for_update()
        end_s = time.monotonic() + for_s
        try:
            while self._driving is say and (left_s := end_s - time.monotonic()) > 0:
                if self._is_paced and self.is_joined:
                    self._slots.steady = say  # not queued, so that a stop removes it at once
                else:
                    await self._say(say, robot)
                await asyncio.wait((refused,), timeout=min(SLOT_S, left_s))
                if refused.done():
                    if refused.result() not in STILL_DRIVES:
                        raise RequestRefused(f"driving {robot}", refused.result())
                    refused = self._next_refusal()
            return self._driving is say
        finally:
            self._forget(refused)
            if self._driving is say:
                with contextlib.suppress(PeerError, Unavailable):
                    await self.stop(robot)

    async def route(self, robot: str, points_mm: Sequence[tuple[float, float]], threshold_mm: float = 100.0) -> None:
        """Send a robot along points; each counts as reached within the threshold. Raises: as `command`."""
        points = [{"x": x, "y": y, "z": 0} for x, y in points_mm]
        payload = {"threshold": threshold_mm, "waypoints": points}
        await self.command(robot, "waypoints", payload, refused_within_s=REFUSED_WITHIN_S)

    async def stop(self, robot: str, *, refused_within_s: float = 0.0) -> None:
        """Stop a robot, ahead of all queued records; a stop is never refused as late. Raises: as `command`."""
        self._driving = self._slots.steady = None
        await self.command(robot, "move_raw", wheels(0, 0), stop=True, refused_within_s=refused_within_s)

    def _command(self, robot: str, name: str, payload: Any, *, stop: bool = False) -> SealRecord:
        check_word(ADDRESS, robot, "a robot's address")
        check_word(NAME, name, "a command's name")
        body = payload_bytes(payload)

        def say(now_ms: int) -> Transmit:
            assert self._connection.protocol is not None
            self.commands += 1
            return self._connection.protocol.command(robot, name, body, now_ms, stop=stop)

        return say

    # --- sending -----------------------------------------------------------------------------------------------------

    @property
    def _is_paced(self) -> bool:
        return bool(self.standing and self.standing.robot)

    async def _say(self, say: SealRecord, robot: str = "", *, stop: bool = False) -> None:
        """Send a record at once, or in the next slot while a robot is assigned or leased; return when it is sent."""
        if not self._tasks:
            raise UsageError("the client is not entered", "use it as `async with client:`")
        if self._connection.failure:
            raise self._connection.failure
        if robot and not stop:
            await self._wait_for_update()
        if not (self._is_paced and self.is_joined):
            await self._connection.transmit(say)
            return
        sent = self._promise()

        def say_now(now_ms: int) -> Transmit:
            record = say(now_ms)
            if not sent.done():
                sent.set_result(None)
            return record

        def drop() -> None:
            if not sent.done():
                sent.set_exception(UsageError("a stop for the robot cancelled this command before it was sent"))

        if stop:
            self._slots.stop(say_now, robot)
        else:
            self._slots.put(say_now, robot, drop)
        await sent

    async def _wait_for_update(self) -> None:
        """Wait up to 1 s for the first update in this connection, because commands refer to an update."""
        if not self._has_seen:
            with contextlib.suppress(Unavailable):
                await self._until(lambda: self._has_seen, FIRST_UPDATE_S)

    async def _pace(self) -> None:
        """Send a record in each slot while a robot is assigned or leased, or records are queued."""
        due_s = time.monotonic()
        while not self._connection.failure:
            due_s = max(due_s + SLOT_S, time.monotonic())
            await asyncio.sleep(due_s - time.monotonic())
            if (self._is_paced or self._slots.waits) and self.is_joined and self._connection.protocol:
                with contextlib.suppress(PeerError, Unavailable):
                    await self._connection.transmit(self._slots.take(self._connection.protocol))

    def _promise(self) -> asyncio.Future[Any]:
        """Return a future that fails if the connection is lost."""
        promise: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._pending.add(promise)
        promise.add_done_callback(self._pending.discard)
        return promise

    def _next_refusal(self) -> asyncio.Future[Reason]:
        refused: asyncio.Future[Reason] = asyncio.get_running_loop().create_future()
        self._refused.append(refused)
        return refused

    def _forget(self, refused: asyncio.Future[Reason]) -> None:
        refused.cancel()
        self._refused = [each for each in self._refused if not each.done()]

    # --- receiving ---------------------------------------------------------------------------------------------------

    def _on_event(self, event: ClientEvent) -> None:
        match event:
            case Admitted(visitor, name):
                self.visitor, self.name = visitor, name
            case StandingChanged(standing):
                self.standing = standing
            case Updated(state):
                self._has_seen = True
                self._keep(state)
            case Replied(number, payload):
                self._answer(number, payload)
            case WasRefused(number, why):
                self.refusals[why.name.lower()] += 1
                if number:
                    self._answer(number, why)
                    return
                for each in self._refused:
                    if not each.done():
                        each.set_result(why)
        self._notify()

    def _on_lost(self) -> None:
        self._has_seen, self.standing = False, None
        self._slots.clear()
        for each in [each for each in self._pending if not each.done()]:
            each.set_exception(self._connection.failure or Unavailable(*LOST))
        self._notify()

    def _answer(self, number: int, reply: bytes | Reason) -> None:
        answer = self._waiting.get(number)
        if answer and not answer.done():
            answer.set_result(reply)

    def _keep(self, state: bytes) -> None:
        kept = self._updates
        kept.append(state)
        while len(kept) > UNREAD or (len(kept) > 1 and sum(map(len, kept)) > UNREAD_BYTES):
            kept.popleft()
            self.dropped += 1

    def _notify(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()

    async def _until(self, holds: Callable[[], bool], within_s: float | None) -> None:
        """Wait until `holds()`. Raises: Unavailable: not within the time; the failure that ended the session."""
        try:
            async with asyncio.timeout(within_s):
                while True:
                    if self._connection.failure:
                        raise self._connection.failure
                    if holds():
                        return
                    await self._changed.wait()
        except TimeoutError as error:
            raise Unavailable(*NO_ANSWER) from error
