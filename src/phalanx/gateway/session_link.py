"""Mode session: visitors with their own keys, over the front end's websockets and a broker.

The session identifies the visitor, so payloads have no names. No data is parsed before it is authenticated.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import os
import time
from collections import Counter, deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from dataclasses import replace
from typing import Any

from phalanx.config.session import SessionConfig
from phalanx.errors import BadPayload, HandlerFailed, Held, Late, Overrun, PeerError, Unknown, UsageError
from phalanx.link import Command, Request, SharedAnswer
from phalanx.link.envelope import encode_json
from phalanx.link.session import Invitation, Now, Operations, Reason, Role, SessionServer, Store
from phalanx.link.session.errors import EndReason, NotAllowed, TooMany
from phalanx.link.session.events import (
    Close,
    Commanded,
    CommandRefused,
    Joined,
    Left,
    Publish,
    Requested,
    Send,
    ServerEvent,
    SetConnectionTopics,
)
from phalanx.link.session.store import GroupedStore
from phalanx.link.session.visitors import Visitor
from phalanx.link.topics import CommandTopic
from phalanx.net.answers import Answers
from phalanx.net.front import Closed, Event, Opened, Received
from phalanx.net.server import call_handler
from phalanx.net.session_broker import HELLO_CONNECTION, SessionBroker
from phalanx.net.session_store import LinkKeys

from . import vocabulary
from .links import call_handler_now
from .payloads import parse_payload, request_words
from .trail import Trail
from .ways import FrontEnd, SessionTransports

log = logging.getLogger(__name__)

TICK_S = 0.1
LOOK_EVERY = 10  # ticks, to look for robots that joined or left
ASKED_BYTES = 256  # longest payload of a request that waits
CLOSING_S = 0.1  # for the last messages to be sent
# Updates are padded, so that their length does not reveal whether a robot moves. Every robot's place is in one of ten
# updates. In longer updates a single robot does not matter.
EQUAL_TICKS, EQUAL_BYTES = 100, 2040
_REASONS: dict[type[PeerError], Reason] = {
    BadPayload: Reason.BAD,
    Held: Reason.HELD,
    HandlerFailed: Reason.FAILED,
    Late: Reason.LATE,
    NotAllowed: Reason.NOT_ALLOWED,
    Overrun: Reason.TOO_MANY,
    TooMany: Reason.TOO_MANY,
    Unknown: Reason.UNKNOWN,
}
EventSink = Callable[[dict[str, Any]], None]
# Handler of operators' requests: takes the request's name, its payload, and the visitor's id.
Operate = Callable[[str, dict[str, Any], int], dict[str, Any] | Awaitable[dict[str, Any]]]


class SessionLink:
    """A `Link` over sessions.

    Attributes:
        server: all sessions.
        static: the swarm's public key.
        operations: operators' actions; pass their result to `carry`.
        counters: commands, requests and notifications.
        say: receives events: joined, left, command, refused.
        operate: answers operators' requests.

    Args:
        robots: returns the addresses of the current robots.
        broker: for visitors who cannot reach the front end; named in invitations.
    """

    is_published = False

    def __init__(
        self,
        front: FrontEnd,
        store: Store,
        keys: LinkKeys,
        robots: Callable[[], Iterable[str]],
        trail: Trail,
        config: SessionConfig | None = None,
        open_role: Role = Role.DRIVE,
        broker: SessionBroker | None = None,
    ) -> None:
        self.config = config or SessionConfig()
        self._store = GroupedStore(store)
        self._held: dict[int, list[Send | Close]] = {}  # by connection: answers that wait until the store is flushed
        self.server = SessionServer(self.config, keys.static, keys.signer, self._store, os.urandom, now(), open_role)
        self.operations = Operations(self.server)
        self.counters: Counter[str] = Counter()
        self.say: EventSink = lambda _: None
        self.operate: Operate | None = None
        self.trail = trail
        self.static = keys.static.public_key().public_bytes_raw()
        self._ways = SessionTransports(front, broker)
        self._robots = robots
        self._commands: dict[str, Callable[[Command], Any]] = {}
        self._requests: dict[str, Callable[[Request], Any]] = {}
        # One request per connection and name may wait, so that busy visitors do not displace others' requests.
        most = len(vocabulary.REQUEST_NAMES) * self.config.connections_max
        self._answers = Answers[Requested](lambda each: self._settle(each, self._answered(each)), most)
        self._encoded: dict[str, tuple[SharedAnswer, bytes]] = {}  # by the request's name
        self._operating: set[asyncio.Task[None]] = set()
        self._lengths: deque[int] = deque(maxlen=EQUAL_TICKS)  # of updates

    @property
    def answer_bytes(self) -> int:
        """Return the size of the longest JSON answer that fits a message to a client."""
        return self.config.max_to_client_bytes - 64

    @property
    def rejected(self) -> Counter[str]:
        """Return the number of refused messages, by reason."""
        return self.server.rejected + self._ways.rejected

    @property
    def invitation(self) -> Invitation:
        """Return the invitation with the current open code."""
        mqtt = self._ways.broker.mqtt if self._ways.broker else 0
        return Invitation(self.static, self.server.door.code, self.config.broker, self.config.root, mqtt)

    def on_command(self, name: str, /) -> Callable[[Callable[[Command], Any]], Any]:
        """Register the decorated function as the handler of a command."""
        return lambda handler: self._commands.setdefault(name, handler)

    def on_request(self, number: int, /) -> Callable[[Callable[[Request], Any]], Any]:
        """Register the decorated function as the handler of a request, given its number in mode qrkey."""
        return lambda handler: self._requests.setdefault(vocabulary.REQUEST_NAMES[number], handler)

    async def notify(self, payload: dict[str, Any], /) -> bool:
        """Encrypt an update once for all visitors, and send it. Raises: UsageError: it is too long."""
        try:
            state = encode_json(payload)
        except (TypeError, ValueError, RecursionError) as error:
            raise UsageError(f"an update is not JSON: {error}") from error
        self._lengths.append(min(len(state), EQUAL_BYTES))
        state = state.ljust(max(self._lengths))
        self.carry([self.server.publish(state, now())])
        self.counters["notifications"] += 1
        return True

    async def run(self) -> None:
        """Serve until cancelled."""
        work = [self._tick(), self._answers.run(), *map(self._read, self._ways.events())]
        if self._ways.broker:
            work.append(self._ways.broker.run())
        await asyncio.gather(*work)

    async def close(self) -> None:
        """End all sessions; visitors can resume when the gateway runs again."""
        self._commit()
        connections = list(self.server.connections)
        for connection in connections:
            self.carry(self.server.end(connection, EndReason.CLOSING, now()))
        if connections:
            await asyncio.sleep(CLOSING_S)

    def carry(self, events: Iterable[ServerEvent]) -> None:
        """Carry out the actions that the server or an operation returned, and report events."""
        for event in events:
            if isinstance(event, Send | Close) and event.connection in self._held:
                self._held[event.connection].append(event)
            else:
                self._carry_out(event)

    def _carry_out(self, event: ServerEvent) -> None:
        match event:
            case Send() | SetConnectionTopics() | Close():
                self._ways.carry(event)
            case Publish(connections):
                self._ways.carry(
                    replace(event, connections=tuple(each for each in connections if each not in self._held))
                )
            case Joined():
                self._joined(event)
            case Left(visitor):
                self.trail.left(visitor)
                self.say({"event": "left", "visitor": visitor})
            case Commanded():
                self._command(event)
            case Requested():
                self._ask(event)
            case CommandRefused(visitor, robot, reason):
                self._refused(visitor, robot, reason)

    # --- events of connections ------------------------------------------------------------------------------------

    async def _read(self, events: AsyncIterator[Event]) -> None:
        async for event in events:
            try:
                self._on_event(event)
            except Exception as error:
                # An error of one connection must not affect the others.
                log.exception("a connection is closed (%s)", type(error).__name__)
                self._fail(event.connection)

    def _fail(self, connection: int) -> None:
        self.carry([Close(connection, "failed"), *self.server.closed(connection, now())])

    def _on_event(self, event: Event) -> None:
        match event:
            case Opened(connection, address):
                self.carry(self.server.opened(connection, address, now()))
            case Received(connection, data) if connection == HELLO_CONNECTION:
                self.carry(self.server.receive_hello(data, now()))
            case Received(connection, data):
                self.carry(self._receive(connection, data))
                known = self.server.connections.find(connection)
                if known and known.visitor:
                    self._ways.admit(connection)
            case Closed(connection):
                self._ways.forget(connection)
                self.carry(self.server.closed(connection, now()))

    def _receive(self, connection: int, data: bytes) -> list[ServerEvent]:
        """Pass a message to the server. Its writes are flushed before its answers are sent, in the next loop turn."""
        before = self._store.writes
        self._store.is_grouping = True
        try:
            return self.server.receive(connection, data, now())
        finally:
            self._store.is_grouping = False
            if self._store.writes != before:
                if not self._held:
                    asyncio.get_running_loop().call_soon(self._commit)
                self._held.setdefault(connection, [])

    def _commit(self) -> None:
        """Flush the writes of all messages of this turn at once, and send the answers that waited for it."""
        held, self._held = self._held, {}
        try:
            self._store.flush()
        except Exception as error:  # noqa: BLE001 - connected visitors are served even if the disk fails
            log.error("visitors cannot be stored and are not admitted: %s", error)  # noqa: TRY400
            for connection in held:
                self._fail(connection)
            return
        for events in held.values():
            self.carry(events)

    async def _tick(self) -> None:
        known: list[str] = []
        for ticks in itertools.count():
            try:
                # Only once a second: a thousand robots take five milliseconds.
                if ticks % LOOK_EVERY == 0 and known != (known := sorted(self._robots())):
                    self.server.assignment.set_robots(known, now().ms)
                code = self.server.door.code
                self.carry(self.server.tick(now()))
                if self.server.door.code is not code:
                    self.say({"event": "rotation"})
                self.trail.tick(time.monotonic())
            except Exception as error:
                log.exception("sessions: a tick failed (%s)", type(error).__name__)
            await asyncio.sleep(TICK_S)

    def _joined(self, joined: Joined) -> None:
        words: dict[str, Any] = {"name": joined.name, "role": joined.role.name.lower()}
        words |= {"resumed": not joined.is_new, "waiting": joined.waiting}
        self.trail.joined(joined.visitor, **words)
        self.say({"event": "joined", "visitor": joined.visitor, **words})

    def _command(self, command: Commanded) -> None:
        robot = command.robot.upper()
        try:
            payload = None if command.is_stop else parse_payload(command.payload)
            if command.name == "waypoints" and not command.is_stop:
                self._count_route(command.visitor, robot, payload)
            handler = self._commands.get(command.name)
            if handler is None:
                raise Unknown(f"no command {command.name!r}")
            topic = CommandTopic(robot, vocabulary.APPLICATION, command.name)
            by = self.name_of(command.visitor)
            call_handler_now(handler, Command(topic, payload, by=by, is_stop=command.is_stop))
        except PeerError as error:
            reason = self._reject(error)
            self.carry(self.server.refuse(command.visitor, 0, reason))
            self._refused(command.visitor, robot, reason)
            return
        self.carry(self.server.accept(command, now()))
        self.counters["commands"] += 1
        if command.is_stop:
            self.trail.stops(command.visitor, robot, time.monotonic())
        else:
            self.trail.drives(command.visitor, robot, command.name, time.monotonic())
        words = {"address": robot, "name": command.name, "payload": payload, "visitor": command.visitor, "by": by}
        self.say({"event": "command", **words})

    def _count_route(self, visitor: int, robot: str, payload: Any) -> None:
        """Count a route. Raises: TooMany: more routes or points than one visitor may send."""
        points = payload.get("waypoints") if isinstance(payload, dict) else None
        if isinstance(points, list):
            self.server.caps.of(visitor, now().ms).route(robot, len(points), now().ms)

    def _ask(self, request: Requested) -> None:
        known = self.server.visitors.find(request.visitor)
        if known is None:
            return
        try:
            if request.name not in self._requests:
                answer = self._operated(known, request)
                if isinstance(answer, dict):
                    self._reply(request, encode_json(answer))
                else:
                    task = asyncio.ensure_future(self._settle(request, answer))
                    self._operating.add(task)
                    task.add_done_callback(self._operating.discard)
                return
            if len(request.payload) > ASKED_BYTES:
                raise TooMany(f"a request of {len(request.payload)} bytes, limit {ASKED_BYTES}")
            before = self._answers.ask((request.visitor, request.name), len(request.payload), request)
            if before:
                self.carry(self.server.refuse(before.visitor, before.number, Reason.TOO_MANY))
        except PeerError as error:
            self._refuse_request(request, error)
        except UsageError as error:
            self._refuse_request(request, BadPayload(str(error)))

    def _reply(self, request: Requested, payload: bytes) -> None:
        self.carry(self.server.reply(request.visitor, request.number, payload))
        self.counters["requests"] += 1

    async def _settle(self, request: Requested, answer: Awaitable[bytes | dict[str, Any]]) -> None:
        try:
            payload = await answer
            self._reply(request, payload if isinstance(payload, bytes) else encode_json(payload))
        except PeerError as error:
            self._refuse_request(request, error)
        except UsageError as error:
            log.warning("request %s: %s", request.name, error)
            self._refuse_request(request, BadPayload(str(error)))

    async def _answered(self, request: Requested) -> bytes:
        words = request_words(request.payload)
        data = await call_handler(
            self._requests[request.name], Request(request.number, "", words, len(request.payload))
        )
        if not isinstance(data, SharedAnswer):
            return encode_json(data)
        shared, encoded = self._encoded.get(request.name, (None, b""))
        if shared is not data:
            encoded = encode_json(data.data)
            self._encoded[request.name] = data, encoded
        return encoded

    def _operated(self, visitor: Visitor, request: Requested) -> dict[str, Any] | Awaitable[dict[str, Any]]:
        """Answer an operator without the queue: a stop must not wait for other visitors' requests."""
        if self.operate is None:
            raise Unknown("no such request")
        if visitor.role is not Role.OPERATE:
            raise NotAllowed("a request of operators")
        return self.operate(request.name, request_words(request.payload), visitor.id)

    def _refuse_request(self, request: Requested, error: PeerError) -> None:
        reason = self._reject(error)
        self.carry(self.server.refuse(request.visitor, request.number, reason))

    def _refused(self, visitor: int, robot: str, reason: Reason) -> None:
        self.trail.refused(visitor, robot, reason.name.lower(), time.monotonic())

    def _reject(self, error: PeerError) -> Reason:
        self.server.rejected[error.reason] += 1
        return next((reason for kind, reason in _REASONS.items() if isinstance(error, kind)), Reason.BAD)

    def is_driven(self, robot: str) -> bool:
        """Return whether a visitor drives the robot now, or has it assigned."""
        return self.server.assignment.driver_of(robot, now().ms) is not None

    def drivers(self) -> dict[str, str]:
        """Return the name of the visitor of each robot that somebody drives or has assigned."""
        return {robot: self.name_of(visitor) for robot, visitor in self.server.assignment.drivers(now().ms).items()}

    def name_of(self, visitor: int) -> str:
        """Return a visitor's nickname, or "" if the visitor was removed."""
        known = self.server.visitors.find(visitor)
        return known.name if known else ""


def now() -> Now:
    """Return the current time, monotonic and wall clock, for sessions."""
    return Now(time.monotonic_ns() // 1_000_000, int(time.time()))
