"""Client side of a session, without I/O: bytes and a time in, events and bytes out.

Refused messages are counted, and change nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PublicKey

from phalanx.config.session import SessionConfig
from phalanx.errors import PeerError, UsageError
from phalanx.wire.sessions import ACCEPT, HELLO, SIGNED_HELLO

from .channel import Channel
from .connections import is_record
from .errors import EndReason, Unexpected
from .events import (
    Admitted,
    ClientEvent,
    Ended,
    KeepSecret,
    Replied,
    SetTopics,
    StandingChanged,
    Transmit,
    Updated,
    WasRefused,
)
from .invitation import Invitation
from .messages import (
    Alive,
    Command,
    End,
    Epoch,
    FromClient,
    FromServer,
    Join,
    Leave,
    NewSecret,
    Ready,
    Refused,
    Reply,
    Request,
    Standing,
    Stored,
    Welcome,
    decode_from_server,
    encode,
)
from .noise import KEY_BYTES, Initiator
from .secret import Kind, Secret, hello_topic, prologue, record_topic, topic_name
from .updates import UpdateReader, is_update

ALIVE_MS = 4_000  # longest time between two records to a broker
# On a broker only silence reveals a lost server or session. A visitor waiting for approval gets no updates.
QUIET_MS, QUIET_WAITING_MS = 5_000, 60_000
EPOCHS_KEPT = 2  # epochs kept that arrive before `welcome`


@dataclass(frozen=True, slots=True)
class _Handshake:
    initiator: Initiator = field(repr=False)
    secret: Secret
    accept_topic: str
    begun_ms: int


class SessionClient:
    """Session of one visitor.

    Attributes:
        rejected: refused messages, by reason.
        is_over: the session has ended; a new client may resume.

    Args:
        invitation: from the QR code or a room code, or with a resume secret.
        random_bytes: returns n bytes from a cryptographic source.
        name: requested nickname; the server may choose another.
    """

    def __init__(
        self, config: SessionConfig, invitation: Invitation, random_bytes: Callable[[int], bytes], name: str = ""
    ) -> None:
        self.config, self.invitation, self.name = config, invitation, name
        self.rejected: Counter[str] = Counter()
        self.is_over = False
        self._random_bytes = random_bytes
        self._secret = invitation.secret
        self._on_broker = bool(invitation.broker)
        self._channel = Channel(
            is_server=False,
            max_receive_bytes=config.max_to_client_bytes,
            max_send_bytes=config.max_to_server_bytes,
            overlap_ms=config.overlap_ms,
        )
        self._handshake: _Handshake | None = None
        self._adopted_ms: int | None = None  # when new keys were adopted, until `welcome` confirms them
        self._is_joined = False
        self._signer = b""
        self._reader: UpdateReader | None = None
        self._early: list[Epoch] = []
        self._early_secret: list[ClientEvent] = []  # secret received before `welcome`: it cannot be confirmed yet
        self._requests = 0
        self._said_ms = self._heard_ms = 0
        self._is_waiting = False

    @property
    def is_joined(self) -> bool:
        """Return whether the server has admitted this visitor."""
        return self._is_joined and not self.is_over

    def start(self, now_ms: int) -> list[ClientEvent]:
        """Begin a handshake: the first, or one for new keys."""
        invitation, secret = self.invitation, self._secret
        opening = prologue(secret.kind, secret.id, invitation.root, invitation.broker)
        initiator = Initiator(opening, invitation.static, secret.psk, self._random_bytes(KEY_BYTES))
        hello = HELLO.encode(kind=secret.kind, id=secret.id, noise=initiator.write())
        topic = secret.accept_topic(hello) if self._on_broker else ""
        self._handshake = _Handshake(initiator, secret, topic, now_ms)
        if not self._on_broker:
            return [Transmit(hello)]
        values = HELLO.decode(hello)
        signed = SIGNED_HELLO.encode(**values, mac1=secret.mac1(hello))
        static = X25519PublicKey.from_public_bytes(invitation.static)
        return [*self._hear(), Transmit(signed, hello_topic(static))]

    def receive(self, raw: bytes, now_ms: int) -> list[ClientEvent]:
        """Process a message that claims to be from the server. Never raises for its content."""
        if self.is_over:
            return []
        try:
            if is_record(raw):
                return self._record(raw, now_ms)
            if is_update(raw):
                return self._update(raw, now_ms)
            return self._accept(raw, now_ms)
        except PeerError as error:
            self.rejected[error.reason] += 1
            return []

    def tick(self, now_ms: int) -> list[ClientEvent]:
        """Process timeouts and key changes; call once a second, and first of all after a sleep."""
        if self.is_over:
            return []
        config = self.config
        quiet_ms = QUIET_WAITING_MS if self._is_waiting else QUIET_MS
        if self._is_joined and self._on_broker and now_ms - self._heard_ms >= quiet_ms:
            return self._end(None)
        self._channel.expire(now_ms)
        begun_ms = self._handshake.begun_ms if self._handshake else None
        since = [each for each in (self._adopted_ms, begun_ms) if each is not None]
        if since and now_ms - min(since) >= config.handshake_ms:
            if not self._is_joined:
                return self._end(None)
            if now_ms - max(since) >= 2 * config.handshake_ms:  # the server has dropped the previous handshake
                self._adopted_ms = None
                return self.start(now_ms)
            return []
        if self._is_joined and not since and now_ms - self._channel.made_ms >= config.rekey_ms:
            return self.start(now_ms)
        if self._is_joined and self._on_broker and now_ms - self._said_ms >= ALIVE_MS:
            return [self._send(Alive(), now_ms)]
        return []

    def command(self, robot: str, name: str, payload: bytes, now_ms: int, *, stop: bool = False) -> Transmit:
        """Seal a command for one robot, based on the newest update. Raises: UsageError: not joined, or too long."""
        reader = self._joined()
        return self._send(Command(stop, reader.seen, reader.digest, robot, name, payload), now_ms)

    def request(self, name: str, payload: bytes, now_ms: int) -> tuple[int, Transmit]:
        """Seal a request; return its number and the record. Raises: UsageError: not joined, or too long."""
        self._joined()
        self._requests += 1
        return self._requests, self._send(Request(self._requests, name, payload), now_ms)

    def alive(self, now_ms: int) -> Transmit:
        """Seal a keep-alive. Raises: UsageError: not joined."""
        self._joined()
        return self._send(Alive(), now_ms)

    def stored(self, secret: Secret, now_ms: int) -> Transmit:
        """Confirm that a secret is stored, so that the server drops the old one. Raises: UsageError: not joined."""
        self._joined()
        return self._send(Stored(secret.id), now_ms)

    def leave(self, now_ms: int) -> list[ClientEvent]:
        """End the session and free its robot; the resume secret stays valid."""
        sent = [self._send(Leave(keep=False), now_ms)] if self._channel.is_open else []
        return [*sent, *self._end(None)]

    def _accept(self, raw: bytes, now_ms: int) -> list[ClientEvent]:
        fields = ACCEPT.decode(raw)
        handshake = self._handshake
        if handshake is None:
            raise Unexpected("an answer without a handshake")
        _, keys = handshake.initiator.read(fields["noise"])
        self._channel.adopt(fields["generation"], keys, now_ms)
        self._handshake, self._adopted_ms = None, now_ms
        first = Ready() if handshake.secret.kind is Kind.RESUME else Join(self.name)
        return [*self._hear(), self._send(first, now_ms)]

    def _record(self, raw: bytes, now_ms: int) -> list[ClientEvent]:
        if not self._channel.is_open:
            raise Unexpected("a record before the handshake")
        content, _, in_order = self._channel.open(raw, now_ms)
        self._heard_ms = now_ms
        message = decode_from_server(content)
        # Delivered late, these would undo newer messages of the server.
        if isinstance(message, NewSecret | Standing) and not in_order:
            raise Unexpected("the server's record is older than ones already read")
        return self._read(message)

    def _read(self, message: FromServer) -> list[ClientEvent]:
        match message:
            case Welcome(visitor, signer, name):
                return self._welcome(visitor, signer, name)
            case NewSecret(secret, lifetime_s):
                return self._keep(Secret(Kind.RESUME, secret), lifetime_s)
            case Epoch():
                if self._reader is None:
                    self._early = [*self._early, message][-EPOCHS_KEPT:]
                    return []
                self._reader.learn(message)
                return self._hear()
            case Standing():
                self._is_waiting = message.waiting
                return [StandingChanged(message)]
            case Reply(number, payload):
                return [Replied(number, payload)]
            case Refused(number, reason):
                return [WasRefused(number, reason)]
            case End(reason):
                return self._end(reason)

    def _welcome(self, visitor: int, signer: bytes, name: str) -> list[ClientEvent]:
        if self._reader is None or signer != self._signer:
            self._reader, self._signer = UpdateReader(self.config, signer), signer
        for epoch in self._early:
            self._reader.learn(epoch)
        self._early, self._adopted_ms, self._is_joined = [], None, True
        keep, self._early_secret = self._early_secret, []
        return [*self._hear(), Admitted(visitor, name), *keep]

    def _keep(self, secret: Secret, lifetime_s: int) -> list[ClientEvent]:
        self._secret = secret
        keep: list[ClientEvent] = [KeepSecret(secret, lifetime_s)]
        if self._is_joined:
            return keep
        self._early_secret = keep
        return []

    def _update(self, raw: bytes, now_ms: int) -> list[ClientEvent]:
        if self._reader is None:
            raise Unexpected("an update before admission")
        state = self._reader.open(raw)
        self._heard_ms = now_ms
        return [Updated(state)]

    def _joined(self) -> UpdateReader:
        if self._reader is None or not self.is_joined:
            raise UsageError("the server has not admitted this visitor, or the session is over")
        return self._reader

    def _send(self, message: FromClient, now_ms: int) -> Transmit:
        self._said_ms = now_ms
        topic = record_topic(self._channel.send_cipher()) if self._on_broker else ""
        return Transmit(self._channel.seal(encode(message)), topic)

    def _hear(self) -> list[ClientEvent]:
        if not self._on_broker:
            return []
        topics = [record_topic(cipher) for cipher in self._channel.receive_ciphers()]
        topics += [topic_name(topic) for topic in (self._reader.topics() if self._reader else ())]
        if self._handshake:
            topics.append(self._handshake.accept_topic)
        return [SetTopics(tuple(topics))]

    def _end(self, reason: EndReason | None) -> list[ClientEvent]:
        self.is_over, self._handshake = True, None
        return [Ended(reason)]
