"""The transports of sessions: the front end's websockets and optionally a broker, whose connections are negative."""

from __future__ import annotations

from collections import Counter
from collections.abc import AsyncIterator, Sequence
from typing import Protocol

from phalanx.link.session.events import Close, Publish, Send
from phalanx.net.front import Event
from phalanx.net.session_broker import BrokerOutput, SessionBroker


class FrontEnd(Protocol):
    """The part of `phalanx.net.front.Front` that sessions use."""

    def events(self) -> AsyncIterator[Event]:
        """Yield the events of connections."""

    def send(self, connection: int, data: bytes) -> None:
        """Send a message to one client."""

    def publish(self, connections: Sequence[int], data: bytes) -> None:
        """Send an update to many clients; a client that still sends the previous one misses this one."""

    def admitted(self, connection: int) -> None:
        """Stop counting a connection as an unfinished handshake."""

    def close(self, connection: int, reason: str) -> None:
        """Close a connection after its pending data is sent."""


class SessionTransports:
    """Carries out actions of a session server on the transport of each connection."""

    def __init__(self, front: FrontEnd, broker: SessionBroker | None) -> None:
        self._front, self.broker = front, broker
        self._admitted: set[int] = set()

    @property
    def rejected(self) -> Counter[str]:
        """Return the number of messages dropped unread, by reason."""
        return self.broker.rejected if self.broker else Counter()

    def events(self) -> list[AsyncIterator[Event]]:
        """Return the event streams of the transports."""
        return [self._front.events(), *([self.broker.events()] if self.broker else [])]

    def carry(self, action: BrokerOutput) -> None:
        """Carry out an action of the server."""
        match action:
            case Publish(connections, data):
                self._front.publish([each for each in connections if each > 0], data)
                if self.broker and any(each < 0 for each in connections):
                    self.broker.carry(action)
            case Send(connection, data) if connection > 0:
                self._front.send(connection, data)
            case Close(connection, reason) if connection > 0:
                self._admitted.discard(connection)
                self._front.close(connection, reason)
            case _ if self.broker:
                self.broker.carry(action)

    def admit(self, connection: int) -> None:
        """Stop counting a connection as an unfinished handshake."""
        if connection > 0 and connection not in self._admitted:
            self._admitted.add(connection)
            self._front.admitted(connection)

    def forget(self, connection: int) -> None:
        """Record that a connection has ended."""
        self._admitted.discard(connection)
