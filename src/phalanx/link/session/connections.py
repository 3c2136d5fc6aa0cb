"""Connections of a server: handshakes, and encryption and decryption of records.

A connection is a websocket, or one client's topics on a broker. Before a client is authenticated, only the header of
its first message is parsed.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey

from phalanx.config.session import SessionConfig
from phalanx.errors import Replayed
from phalanx.pace import TokenBucket
from phalanx.wire import MalformedRecord
from phalanx.wire.sessions import ACCEPT, HELLO, RECORD, SIGNED_HELLO

from .channel import Channel
from .errors import TooMany, Unexpected
from .events import Close, Now, Send, ServerEvent, SetConnectionTopics
from .messages import FromServer, encode
from .noise import KEY_BYTES, respond
from .secret import Kind, Secret, prologue, record_topic

HELLOS_REMEMBERED = 1024  # first messages on a broker whose repetition is refused before the Diffie-Hellman
FindSecret = Callable[[Kind, bytes, str, Now], Secret]


@dataclass(slots=True)
class Connection:
    """Connection of one client."""

    number: int
    address: str
    on_broker: bool
    channel: Channel
    opened_ms: int
    heard_ms: int
    secret: Secret | None = field(default=None, repr=False)  # secret of the handshake that waits for its first record
    offered_ms: int = 0  # when that handshake was answered
    visitor: int = 0  # visitor id; 0: not admitted yet
    bad: int = 0  # number of refused records

    @property
    def is_pending(self) -> bool:
        """Return whether an answered handshake waits for its first record."""
        return self.secret is not None


class Connections:
    """All connections, by number: positive numbers, chosen by the caller, for websockets; negative ones on a broker.

    Args:
        find_secret: returns the secret with the kind and id of a first message, or raises a PeerError.
    """

    def __init__(
        self,
        config: SessionConfig,
        static: X25519PrivateKey,
        random_bytes: Callable[[int], bytes],
        find_secret: FindSecret,
        now: Now,
    ) -> None:
        self._config, self._static, self._random_bytes, self._find_secret = config, static, random_bytes, find_secret
        self._all: dict[int, Connection] = {}
        self._of_visitor: dict[int, int] = {}
        self._on_broker = 0
        self._hellos: OrderedDict[bytes, None] = OrderedDict()
        self._budgets = {kind: TokenBucket(config.hellos_per_s, config.hellos_per_s, now.ms / 1000) for kind in Kind}
        self._budgets[Kind.OPEN] = TokenBucket(config.open_hellos_per_s, config.open_hellos_at_once, now.ms / 1000)

    def __iter__(self) -> Iterator[Connection]:
        return iter(list(self._all.values()))

    def find(self, number: int) -> Connection | None:
        """Return a connection, or None if it was closed."""
        return self._all.get(number)

    def of_visitor(self, visitor: int) -> Connection | None:
        """Return a visitor's connection, or None if the visitor is not connected."""
        return self._all.get(self._of_visitor.get(visitor, 0))

    def visitors(self) -> dict[int, int]:
        """Return the numbers of visitors' connections, by visitor id."""
        return self._of_visitor

    def open(self, number: int, address: str, now: Now, *, on_broker: bool = False) -> Connection:
        """Add a new connection. Raises: TooMany."""
        if len(self._all) >= self._config.connections_max:
            raise TooMany("connections")
        channel = Channel(
            is_server=True,
            max_receive_bytes=self._config.max_to_server_bytes,
            max_send_bytes=self._config.max_to_client_bytes,
            overlap_ms=self._config.overlap_ms,
        )
        self._all[number] = Connection(number, address, on_broker, channel, now.ms, now.ms)
        return self._all[number]

    def drop(self, number: int) -> Connection | None:
        """Remove a connection and return it; further messages from it are ignored."""
        connection = self._all.pop(number, None)
        if connection and self._of_visitor.get(connection.visitor) == number:
            del self._of_visitor[connection.visitor]
        return connection

    def attach(self, connection: Connection, visitor: int) -> None:
        """Associate a connection with a visitor."""
        connection.visitor = visitor
        self._of_visitor[visitor] = connection.number

    def answer(self, connection: Connection, raw: bytes, now: Now) -> list[ServerEvent]:
        """Answer a first message on a websocket. Raises: PeerError: it is refused."""
        fields = HELLO.decode(raw)
        kind = _kind(fields["kind"])
        secret = self._find_secret(kind, fields["id"], connection.address, now)
        return self._accept(connection, secret, fields["noise"], now)

    def answer_on_broker(self, raw: bytes, count: Callable[[Secret], int], now: Now) -> list[ServerEvent]:
        """Answer a first message on a broker; only its sender can tell that it was answered.

        Args:
            count: counts it for the secret's owner; returns the id of the visitor that resumes, or 0. Raises: TooMany.
        Raises: PeerError: it is refused.
        """
        fields = SIGNED_HELLO.decode(raw)
        kind = _kind(fields["kind"])
        if kind is Kind.ROOM:
            raise Unexpected("a room code on a broker")
        secret = self._find_secret(kind, fields["id"], "", now)
        hello = raw[: HELLO.size]
        secret.check_mac1(hello, fields["mac1"])
        if hello in self._hellos:
            raise Replayed("first message received before")
        # The sender's own limit comes first, or one visitor could exhaust the limit that all share.
        resumed = count(secret)
        if not self._budgets[kind].take(now.ms / 1000):
            raise TooMany("first messages of this kind")
        self._hellos[hello] = None
        if len(self._hellos) > HELLOS_REMEMBERED:
            self._hellos.popitem(last=False)
        connection = self.of_visitor(resumed)
        dropped: list[ServerEvent] = []
        if connection is None or not connection.on_broker:
            dropped = self._make_room()
            self._on_broker -= 1
            connection = self.open(self._on_broker, "", now, on_broker=True)
        topic = secret.accept_topic(hello)
        return [*dropped, *self._accept(connection, secret, fields["noise"], now, topic)]

    def seal(self, connection: Connection, *messages: FromServer) -> list[ServerEvent]:
        """Encrypt messages to a connection that has keys."""
        topic = record_topic(connection.channel.send_cipher()) if connection.on_broker else ""
        return [Send(connection.number, connection.channel.seal(encode(each)), topic) for each in messages]

    def listen(self, connection: Connection) -> list[ServerEvent]:
        """Return the event that sets the subscriptions of a connection on a broker."""
        if not connection.on_broker:
            return []
        return [SetConnectionTopics(connection.number, tuple(map(record_topic, connection.channel.receive_ciphers())))]

    def _accept(
        self, connection: Connection, secret: Secret, noise: bytes, now: Now, topic: str = ""
    ) -> list[ServerEvent]:
        where = (self._config.root, self._config.broker) if connection.on_broker else ("", "")
        opening = prologue(secret.kind, secret.id, *where)
        _, answer, keys = respond(opening, self._static, secret.psk, self._random_bytes(KEY_BYTES), noise)
        generation = connection.channel.next_generation
        connection.channel.offer(keys, now.ms)
        connection.secret, connection.offered_ms = secret, now.ms
        accept = ACCEPT.encode(generation=generation, noise=answer)
        # Subscribe before the answer: the client's first record follows at once.
        return [*self.listen(connection), Send(connection.number, accept, topic)]

    def _make_room(self) -> list[ServerEvent]:
        """Drop the oldest unconfirmed handshake on the broker if there are too many connections."""
        if len(self._all) >= self._config.connections_max:
            waiting = [each for each in self._all.values() if each.on_broker and not each.visitor]
            if waiting:
                oldest = min(waiting, key=lambda each: each.offered_ms)
                self.drop(oldest.number)
                return [Close(oldest.number, "handshake")]
        return []


def is_record(raw: bytes) -> bool:
    """Return whether a message has the tag of a record."""
    return raw[:1] == RECORD.encode(generation=0, counter=0, sealed=b"")[:1]


def _kind(number: int) -> Kind:
    try:
        return Kind(number)
    except ValueError as error:
        raise MalformedRecord("unknown kind of secret") from error
