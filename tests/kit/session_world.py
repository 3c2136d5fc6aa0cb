"""A server of sessions and its clients in memory: bytes travel at once, or as a hostile transport lets them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from hashlib import sha256
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey

from phalanx.config.session import SessionConfig
from phalanx.link.session import (
    Invitation,
    Kind,
    MemoryStore,
    Now,
    Operations,
    Role,
    Secret,
    SessionClient,
    SessionServer,
)
from phalanx.link.session.events import Close, Commanded, KeepSecret, Publish, Send, Transmit

STATIC = X25519PrivateKey.from_private_bytes(bytes(range(32)))
PUBLIC = STATIC.public_key().public_bytes_raw()
UNIX_S = 1_700_000_000


def random_source(seed: str) -> Callable[[int], bytes]:
    """Bytes that look random, and are the same in every run."""
    count = 0

    def take(n: int) -> bytes:
        nonlocal count
        made = b""
        while len(made) < n:
            count += 1
            made += sha256(f"{seed} {count}".encode()).digest()
        return made[:n]

    return take


@dataclass
class Phone:
    """A client with its connection, and what it has reported."""

    client: SessionClient
    connection: int
    events: list[Any] = field(default_factory=list)
    kept: Secret | None = None
    closed: str | None = None

    def last(self, kind: type) -> Any:
        return next((each for each in reversed(self.events) if isinstance(each, kind)), None)

    def all(self, kind: type) -> list[Any]:
        return [each for each in self.events if isinstance(each, kind)]


class World:
    """One server on direct, its phones, and a clock."""

    def __init__(self, store: MemoryStore | None = None, seed: str = "world", **config: Any) -> None:
        self.config = SessionConfig(**config)
        self.ms, self.unix_s = 1000, UNIX_S
        self.store = store or MemoryStore()
        self.random = random_source(f"server {seed}")
        self.phones: dict[int, Phone] = {}
        self.happened: list[Any] = []
        self.wire: list[tuple[str, int, bytes]] = []  # all that was sent
        self.boot()

    def boot(self) -> None:
        """Start the server, as after a kill: all that is not in the store is lost."""
        signer = Ed25519PrivateKey.from_private_bytes(self.random(32))
        self.server = SessionServer(self.config, STATIC, signer, self.store, self.random, self.now)
        self.operations = Operations(self.server)
        for phone in self.phones.values():
            phone.closed = phone.closed or "reset"

    @property
    def now(self) -> Now:
        return Now(self.ms, self.unix_s)

    def invitation(self, secret: Secret | None = None) -> Invitation:
        return Invitation(PUBLIC, secret or self.server.door.code)

    def dial(self, invitation: Invitation | None = None, name: str = "", address: str = "10.0.0.1") -> Phone:
        """Open a connection, without a handshake yet."""
        number = len(self.phones) + 1
        client = SessionClient(self.config, invitation or self.invitation(), random_source(f"client {number}"), name)
        self.phones[number] = Phone(client, number)
        self.carry(self.server.opened(number, address, self.now))
        return self.phones[number]

    def join(self, invitation: Invitation | None = None, name: str = "", address: str = "10.0.0.1") -> Phone:
        phone = self.dial(invitation, name, address)
        self.do(phone, phone.client.start(self.ms))
        return phone

    def resume(self, secret: Secret, address: str = "10.0.0.1") -> Phone:
        assert secret.kind is Kind.RESUME
        return self.join(self.invitation(secret), address=address)

    def do(self, phone: Phone, events: list[Any]) -> None:
        """Carry out a client's events."""
        for event in events:
            phone.events.append(event)
            if isinstance(event, Transmit):
                self.wire.append(("up", phone.connection, event.data))
                if phone.closed is None:
                    self.carry(self.server.receive(phone.connection, event.data, self.now))
            elif isinstance(event, KeepSecret):
                phone.kept = event.secret
                if phone.client.is_joined:
                    self.do(phone, [phone.client.stored(event.secret, self.ms)])

    def carry(self, events: list[Any]) -> None:
        """Carry out the server's events."""
        for event in events:
            self.happened.append(event)
            if isinstance(event, Send):
                self.deliver(event.connection, event.data)
            elif isinstance(event, Publish):
                for number in event.connections:
                    self.deliver(number, event.data)
            elif isinstance(event, Close):
                self.phones[event.connection].closed = event.reason
            elif isinstance(event, Commanded):
                self.carry(self.server.accept(event, self.now))

    def deliver(self, number: int, data: bytes) -> None:
        self.wire.append(("down", number, data))
        phone = self.phones[number]
        if phone.closed is None:
            self.do(phone, phone.client.receive(data, self.ms))

    def publish(self, state: bytes = b"state") -> bytes:
        event = self.server.publish(state, self.now)
        self.carry([event])
        return event.data

    def wait(self, ms: int, step_ms: int = 1000) -> None:
        """Let time pass, with everybody's ticks."""
        end = self.ms + ms
        while self.ms < end:
            self.ms = min(end, self.ms + step_ms)
            self.unix_s = UNIX_S + self.ms // 1000
            self.carry(self.server.tick(self.now))
            for phone in self.phones.values():
                if phone.closed is None:
                    self.do(phone, phone.client.tick(self.ms))

    def drive(self, phone: Phone, robot: str = "R1", payload: bytes = b"{}", *, stop: bool = False) -> Any:
        """Send a command; return the server's last event that is not a send."""
        before = len(self.happened)
        self.do(phone, [phone.client.command(robot, "move_raw", payload, self.ms, stop=stop)])
        return next((each for each in self.happened[before:] if not isinstance(each, Send)), None)

    def ticket(self, role: Role = Role.DRIVE, uses: int = 1, lifetime_s: int = 3600, **more: Any) -> Invitation:
        from phalanx.link.session import Ticket

        secret = Secret(Kind.TICKET, self.random(16))
        self.server.door.add_ticket(Ticket(secret, role, uses, self.unix_s + lifetime_s, **more), self.unix_s)
        return self.invitation(secret)
