"""A broker of somebody else's, a session server on it, and visitors."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from phalanx.link.session import Invitation, Secret, SessionClient
from phalanx.link.session.events import (
    Close,
    Commanded,
    KeepSecret,
    Publish,
    Send,
    SetConnectionTopics,
    SetTopics,
    Transmit,
)
from phalanx.link.session.secret import hello_topic
from session_world import PUBLIC, STATIC, World, random_source

WHERE = {"broker": "wss://broker.example/mqtt", "root": "/lab"}
HELLO_TOPIC = hello_topic(STATIC.public_key())


@dataclass
class Visitor:
    client: SessionClient
    topics: tuple[str, ...] = ()
    events: list[Any] = field(default_factory=list)
    kept: Secret | None = None

    def last(self, kind: type) -> Any:
        return next((each for each in reversed(self.events) if isinstance(each, kind)), None)


class Broker:
    """A broker of somebody else's, a server, and visitors."""

    def __init__(self, **config: Any) -> None:
        self.world = World(**WHERE, **config)
        self.server = self.world.server
        self.server.assignment.set_robots(["R1", "R2"], 0)
        self.visitors: list[Visitor] = []
        self.listens: dict[int, tuple[str, ...]] = {}
        self.happened: list[Any] = []
        self.seen: list[tuple[str, bytes]] = []
        self.loses = lambda topic, data: False
        self.makes: Any = SessionClient

    def publish(self, topic: str, data: bytes) -> None:
        self.seen.append((topic, data))
        if self.loses(topic, data):
            return
        if topic == HELLO_TOPIC:
            self.carry(self.server.receive_hello(data, self.world.now))
        for connection, topics in list(self.listens.items()):
            if topic in topics:
                self.carry(self.server.receive(connection, data, self.world.now))
        for visitor in self.visitors:
            if topic in visitor.topics:
                self.do(visitor, visitor.client.receive(data, self.world.ms))

    def carry(self, events: list[Any]) -> None:
        for event in events:
            self.happened.append(event)
            match event:
                case Send(_, data, topic):
                    self.publish(topic, data)
                case Publish(_, data, topic):
                    self.publish(topic, data)
                case SetConnectionTopics(connection, topics):
                    self.listens[connection] = topics
                case Close(connection):
                    self.listens.pop(connection, None)

    def do(self, visitor: Visitor, events: list[Any]) -> None:
        for event in events:
            visitor.events.append(event)
            match event:
                case Transmit(data, topic):
                    self.publish(topic, data)
                case SetTopics(topics):
                    visitor.topics = topics
                case KeepSecret(secret):
                    visitor.kept = secret
                    if visitor.client.is_joined:
                        self.do(visitor, [visitor.client.stored(secret, self.world.ms)])

    def join(self, secret: Secret | None = None) -> Visitor:
        invitation = Invitation(PUBLIC, secret or self.server.door.code, WHERE["broker"], WHERE["root"], 5)
        client = self.makes(self.world.config, invitation, random_source(f"v{len(self.visitors)}"))
        self.visitors.append(Visitor(client))
        self.do(self.visitors[-1], client.start(self.world.ms))
        return self.visitors[-1]

    def state(self, state: bytes = b"state") -> None:
        self.carry([self.server.publish(state, self.world.now)])

    def drive(self, visitor: Visitor, payload: bytes = b"{}") -> list[Any]:
        before = len(self.happened)
        self.do(visitor, [visitor.client.command("R1", "move_raw", payload, self.world.ms)])
        return [event for event in self.happened[before:] if isinstance(event, Commanded)]

    def wait(self, ms: int, step_ms: int = 1000, *, updates: bool = True) -> None:
        for _ in range(0, ms, step_ms):
            self.world.ms += step_ms
            self.world.unix_s += step_ms // 1000
            self.carry(self.server.tick(self.world.now))
            if updates:
                self.state()
            for visitor in self.visitors:
                self.do(visitor, visitor.client.tick(self.world.ms))
