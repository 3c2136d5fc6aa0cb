"""Server side of all sessions, without I/O: bytes and a time in, events and bytes out.

Refused messages are counted, and change nothing. A visitor is admitted with its first valid record, so that a
replayed first message has no effect.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey

from phalanx.config.session import SessionConfig
from phalanx.errors import Late, PeerError

from .assignment import Assignment
from .connections import Connection, Connections, is_record
from .door import Grant, InvitationRegistry
from .errors import Busy, EndReason, NotAllowed, Reason, TooMany, Unexpected, UnknownSecret
from .events import Close, Commanded, CommandRefused, Joined, Left, Now, Publish, Requested, ServerEvent
from .limits import Joins, LimitsByVisitor
from .messages import (
    Command,
    End,
    FromClient,
    FromServer,
    Join,
    Leave,
    NewSecret,
    Ready,
    Refused,
    Reply,
    Request,
    Role,
    Stored,
    Welcome,
    decode_from_client,
)
from .nickname import clean_nickname, is_reserved
from .secret import NO_ID, RESUME_BYTES, Kind, Secret, topic_name
from .standings import Standings
from .store import Store
from .updates import UpdateWriter
from .visitors import NO_SECRET, Visitor, Visitors


class SessionServer:
    """All sessions of a swarm.

    Attributes:
        rejected: refused messages, by reason.
        door, visitors, assignment: state that operators change through `Operations`.
        caps: rate limits of each visitor.

    Args:
        static: the swarm's private key; invitations contain its public half.
        signer: private key that signs updates.
        random_bytes: returns n bytes from a cryptographic source.
        open_role: role that the open code and the room code grant.
    """

    def __init__(
        self,
        config: SessionConfig,
        static: X25519PrivateKey,
        signer: Ed25519PrivateKey,
        store: Store,
        random_bytes: Callable[[int], bytes],
        now: Now,
        open_role: Role = Role.DRIVE,
    ) -> None:
        self.config = config
        self.rejected: Counter[str] = Counter()
        self.visitors = Visitors(config, store)
        self.door = InvitationRegistry(config, store, random_bytes, now.ms, open_role)
        self.assignment = Assignment(config)
        self.caps = LimitsByVisitor(config)
        self.updates = UpdateWriter(config, signer, random_bytes, now.ms)
        self.connections = Connections(config, static, random_bytes, self._find_secret, now)
        self._random_bytes = random_bytes
        self._away: dict[int, int] = {}  # time at which visitors disconnected, while they keep their robots
        self._joins = Joins(config)
        self._standings = Standings(self.assignment)

    # --- connections -------------------------------------------------------------------------------------------------

    def opened(self, number: int, address: str, now: Now) -> list[ServerEvent]:
        """Add a websocket; `number` is positive and new; limits of joins and room codes count for `address`."""
        try:
            self.connections.open(number, address, now)
        except TooMany as error:
            self._reject(error)
            return [Close(number, error.reason)]
        return []

    def closed(self, number: int, now: Now, *, keep: bool = True) -> list[ServerEvent]:
        """Remove a closed connection; with `keep` the visitor keeps its robot for a while."""
        connection = self.connections.drop(number)
        if connection is None or not connection.visitor:
            return []
        self._away[connection.visitor] = now.ms - (0 if keep else self.config.lease_ms)
        self._standings.forget(connection.visitor)
        return [Left(connection.visitor)]

    def receive(self, number: int, raw: bytes, now: Now) -> list[ServerEvent]:
        """Process a message of a connection. Never raises for its content."""
        connection = self.connections.find(number)
        if connection is None:
            return []  # closed, and the client has not noticed yet
        try:
            if not is_record(raw):
                return self._hello(connection, raw, now)
            return self._record(connection, raw, now)
        except PeerError as error:
            self._reject(error)
            return self._refuse_bytes(connection, error, now)

    def receive_hello(self, raw: bytes, now: Now) -> list[ServerEvent]:
        """Process a message on the broker's topic for first messages."""
        try:
            return self.connections.answer_on_broker(raw, lambda secret: self._count_hello(secret, now), now)
        except PeerError as error:
            self._reject(error)
            return []

    def tick(self, now: Now) -> list[ServerEvent]:
        """Process timeouts and changes that are due; call ten times a second."""
        self.door.tick(now.ms)
        events: list[ServerEvent] = []
        for connection in self.connections:
            events += self._overdue(connection, now)
        epoch = self.updates.tick(now.ms)
        if epoch:
            events += self.send_to_all_visitors(epoch)
        for visitor, since_ms in list(self._away.items()):
            if now.ms - since_ms >= self.config.lease_ms:  # until then a reloaded page keeps its robot
                del self._away[visitor]
                self.assignment.leave(visitor, now.ms)
        self.assignment.tick(now.ms)
        return events + self.standings(now)

    # --- to visitors -------------------------------------------------------------------------------------------------

    def publish(self, state: bytes, now: Now) -> Publish:
        """Encrypt the state of the swarm for all visitors. Raises: UsageError: it is too long."""
        topic = topic_name(self.updates.topic)
        update = self.updates.seal(state, now.ms)
        return Publish(tuple(each.number for each in self.connections if self._reads(each)), update, topic)

    def reply(self, visitor: int, number: int, payload: bytes) -> list[ServerEvent]:
        """Answer a request. Raises: UsageError: it is too long."""
        return self.send_to_visitor(visitor, Reply(number, payload))

    def accept(self, command: Commanded, now: Now) -> list[ServerEvent]:
        """Take or renew the lease for a command that was carried out."""
        visitor, connection = self.visitors.find(command.visitor), self.connections.of_visitor(command.visitor)
        if visitor is None or connection is None:
            return []
        self.assignment.claim(visitor, command.robot, now.ms, is_stop=command.is_stop)
        return self._tell_standing(connection, now)

    def refuse(self, visitor: int, number: int, reason: Reason) -> list[ServerEvent]:
        """Refuse a request, or with number 0 a command."""
        return self.send_to_visitor(visitor, Refused(number, reason))

    def send_to_visitor(self, visitor: int, *messages: FromServer) -> list[ServerEvent]:
        """Send messages to a visitor, if it is connected."""
        connection = self.connections.of_visitor(visitor)
        return self.connections.seal(connection, *messages) if connection and connection.channel.is_open else []

    def send_to_all_visitors(self, *messages: FromServer) -> list[ServerEvent]:
        """Send messages to all visitors that do not wait for approval."""
        return [
            event for each in self.connections if self._reads(each) for event in self.connections.seal(each, *messages)
        ]

    def end(self, connection: Connection, reason: EndReason, now: Now) -> list[ServerEvent]:
        """End a connection, with the reason as a message if there are keys."""
        sent = self.connections.seal(connection, End(reason)) if connection.channel.is_open else []
        return [*sent, *self.closed(connection.number, now), Close(connection.number, reason.name.lower())]

    def forget(self, visitor: int, now: Now) -> None:
        """Free the robots of a removed visitor at once."""
        self._away.pop(visitor, None)
        self.assignment.leave(visitor, now.ms)

    def standings(self, now: Now) -> list[ServerEvent]:
        """Send visitors the changes of their rights."""
        return [event for connection in self.connections for event in self._tell_standing(connection, now)]

    def _tell_standing(self, connection: Connection, now: Now) -> list[ServerEvent]:
        visitor = self.visitors.find(connection.visitor)
        standing = self._standings.changed(visitor, now.ms) if visitor else None
        return self.connections.seal(connection, standing) if standing else []

    # --- handshakes --------------------------------------------------------------------------------------------------

    def _hello(self, connection: Connection, raw: bytes, now: Now) -> list[ServerEvent]:
        if connection.on_broker or connection.is_pending:
            raise Unexpected("a first message during a handshake, or by the wrong topic")
        # Counted only if the visitor is connected here: others may replay its first messages, to exhaust its limit.
        if connection.visitor:
            self.caps.of(connection.visitor, now.ms).handshake(now.ms)
        events = self.connections.answer(connection, raw, now)
        secret = connection.secret
        if connection.visitor and (
            secret is None or secret.kind is not Kind.RESUME or self._resumes(secret.id, now).id != connection.visitor
        ):
            connection.channel.withdraw()
            connection.secret = None
            raise Unexpected("a first message with another visitor's secret")
        return events

    def _find_secret(self, kind: Kind, secret_id: bytes, address: str, now: Now) -> Secret:
        if kind is Kind.RESUME:
            return self.visitors.by_secret(secret_id, now.unix_s)[1]
        return self.door.secret(kind, secret_id, address, now.ms, now.unix_s)

    def _count_hello(self, secret: Secret, now: Now) -> int:
        """Count a first message on a broker; return the id of the visitor that resumes, or 0. Raises: TooMany."""
        if secret.kind is Kind.TICKET:
            self.door.count_hello(secret.id, now.ms)
        if secret.kind is not Kind.RESUME:
            return 0
        visitor = self._resumes(secret.id, now)
        self.caps.of(visitor.id, now.ms).handshake(now.ms)
        return visitor.id

    def _resumes(self, secret_id: bytes, now: Now) -> Visitor:
        return self.visitors.by_secret(secret_id, now.unix_s)[0]

    def _confirm(self, connection: Connection, message: FromClient, now: Now) -> list[ServerEvent]:
        """Admit or resume the visitor that has sent this first record."""
        secret, connection.secret = connection.secret, None
        if secret is None:
            raise Unexpected("a first record without a handshake")
        try:
            if secret.kind is Kind.RESUME:
                visitor, events = self._resume(secret, connection, now), list[ServerEvent]()
            else:
                visitor, events = self._admit(secret, connection, message, now)
        except (UnknownSecret, TooMany) as error:
            self._reject(error)
            full = isinstance(error, TooMany)
            return self.end(connection, EndReason.FULL if full else EndReason.NOT_ADMITTED, now)
        before = self.connections.of_visitor(visitor.id)
        if before and before is not connection:
            events += self.end(before, EndReason.REPLACED, now)
        if before is not connection:
            events.append(Joined(visitor.id, visitor.name, visitor.role, visitor.is_new, visitor.waiting))
        self.connections.attach(connection, visitor.id)
        self._away.pop(visitor.id, None)
        self._standings.forget(visitor.id)
        self.assignment.arrive(visitor, now.ms)
        welcome = Welcome(visitor.id, self.updates.public, visitor.name)
        secrets = NewSecret(visitor.pending, self.config.resume_s)
        epochs = [] if visitor.waiting else self.updates.epochs()
        events += self.connections.listen(connection)
        events += self.connections.seal(connection, welcome, secrets, *epochs)
        # Other visitors get their changes with the next tick, because that takes a loop over all connections.
        return events + self._tell_standing(connection, now)

    def _admit(
        self, secret: Secret, connection: Connection, message: FromClient, now: Now
    ) -> tuple[Visitor, list[ServerEvent]]:
        if not isinstance(message, Join):
            raise Unexpected("the first message of a newcomer must be `join`")
        grant: Grant = self.door.use(secret, now.ms, now.unix_s)
        waiting = self.visitors.approval and grant.role is not Role.OPERATE
        wish = clean_nickname(message.name)
        name = grant.name or ("" if is_reserved(wish) and grant.role is not Role.OPERATE else wish)
        expires_s, pending = now.unix_s + self.config.resume_s, self._random_bytes(RESUME_BYTES)
        made = Visitor(0, name, grant.role, waiting, grant.robots, grant.ticket, expires_s, NO_SECRET, pending)
        if grant.ticket == NO_ID and not connection.on_broker:
            self._joins.count(connection.address, now.ms)
        connected = self.connections.visitors()
        replaced = self.visitors.replaced(grant.ticket, grant.uses, connected)
        caps = self.caps.of(replaced, now.ms) if replaced else None
        if caps:
            caps.handshake(now.ms)
        visitor = self.visitors.admit(made, connected, now.unix_s, replaced)
        self.door.used(secret, connection.address)
        before = self.connections.of_visitor(replaced)
        events = self.end(before, EndReason.REPLACED, now) if before else []
        if caps:
            self.caps.give(visitor.id, caps)
            self.forget(replaced, now)
        return visitor, events

    def _resume(self, secret: Secret, connection: Connection, now: Now) -> Visitor:
        visitor = self._resumes(secret.id, now)
        # Otherwise the handshake was counted with its first message.
        if not connection.on_broker and connection.visitor != visitor.id:
            self.caps.of(visitor.id, now.ms).handshake(now.ms)
        fresh = self._random_bytes(RESUME_BYTES)
        return self.visitors.renew(visitor.id, secret.raw, fresh, now.unix_s, self.door.spend)

    # --- records -----------------------------------------------------------------------------------------------------

    def _record(self, connection: Connection, raw: bytes, now: Now) -> list[ServerEvent]:
        content, is_first, in_order = connection.channel.open(raw, now.ms)
        connection.heard_ms = now.ms
        message = decode_from_client(content)
        if is_first:
            events = self._confirm(connection, message, now)
            # On a broker `ready` may be lost, or arrive after later messages.
            if isinstance(message, Join | Ready):
                return events
            return [*events, *self._message(connection, message, now, in_order=in_order)]
        return self._message(connection, message, now, in_order=in_order)

    def _message(self, connection: Connection, message: FromClient, now: Now, *, in_order: bool) -> list[ServerEvent]:
        visitor = self.visitors.find(connection.visitor)
        if visitor is None:
            raise Unexpected("a record without an admitted visitor")
        match message:
            case Command():
                return self._command(visitor, connection, message, now, in_order=in_order)
            case Request(number) if visitor.waiting:
                return self._refused(connection, NotAllowed("a request before approval"), number, Reason.NOT_ALLOWED)
            case Request(number) if not in_order:
                return self._refused(connection, Late("an old request after newer ones"), number, Reason.LATE)
            case Request(number, name, payload):
                try:
                    self.caps.of(visitor.id, now.ms).request(now.ms)
                except TooMany as error:
                    return self._refused(connection, error, number, Reason.TOO_MANY)
                return [Requested(visitor.id, number, name, payload)]
            case Stored(secret_id):
                self.visitors.stored(visitor.id, secret_id, self.door.spend)
            case Leave(keep) if in_order:  # a late one may be from before a reload of the page
                return [*self.closed(connection.number, now, keep=keep), Close(connection.number, "leave")]
            case Join() | Ready():
                raise Unexpected("a first message in an open session")
        return []

    def _command(
        self, visitor: Visitor, connection: Connection, command: Command, now: Now, *, in_order: bool
    ) -> list[ServerEvent]:
        try:
            self.caps.of(visitor.id, now.ms).command(now.ms)
            # A delayed command must not undo a newer one while the update that it refers to is still recent.
            if not command.stop and not (in_order and self.updates.is_recent(command.seen, command.digest, now.ms)):
                raise Late("a command based on an old update, or older than another one")
            self.assignment.check(visitor, command.robot, now.ms)
            return [Commanded(visitor.id, command.robot, command.name, command.payload, command.stop)]
        except (TooMany, Late, NotAllowed, Busy) as error:
            self._reject(error)
            reasons = {TooMany: Reason.TOO_MANY, Late: Reason.LATE, Busy: Reason.BUSY}
            refused = reasons.get(type(error), Reason.NOT_ALLOWED)
        sent = self.connections.seal(connection, Refused(0, refused))
        return [*sent, CommandRefused(visitor.id, command.robot, refused)]

    def _refused(self, connection: Connection, error: PeerError, number: int, reason: Reason) -> list[ServerEvent]:
        self._reject(error)
        return self.connections.seal(connection, Refused(number, reason))

    # --- what is due -------------------------------------------------------------------------------------------------

    def _overdue(self, connection: Connection, now: Now) -> list[ServerEvent]:
        config = self.config
        connection.channel.expire(now.ms)
        if connection.is_pending and now.ms - connection.offered_ms >= config.handshake_ms:
            connection.channel.withdraw()
            connection.secret = None
        if not connection.visitor and not connection.is_pending and now.ms - connection.heard_ms >= config.handshake_ms:
            return [*self.closed(connection.number, now), Close(connection.number, "handshake")]
        if connection.on_broker and now.ms - connection.heard_ms >= config.silent_ms:
            return self.end(connection, EndReason.CLOSING, now)
        if connection.visitor and now.ms - connection.channel.made_ms >= config.key_max_ms:
            return self.end(connection, EndReason.OLD_KEYS, now)
        return []

    def _reads(self, connection: Connection) -> bool:
        visitor = self.visitors.find(connection.visitor)
        return visitor is not None and not visitor.waiting

    def _reject(self, error: PeerError) -> None:
        self.rejected[error.reason] += 1

    def _refuse_bytes(self, connection: Connection, error: PeerError, now: Now) -> list[ServerEvent]:
        # On a broker anybody may publish to these topics, and must not be able to end a session.
        if connection.on_broker:
            return []
        connection.bad += 1
        if connection.visitor and connection.bad < self.config.bad_records_max:
            return []
        return [*self.closed(connection.number, now), Close(connection.number, error.reason)]
