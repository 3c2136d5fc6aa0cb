"""The two ways of sessions: the front end's websockets and, if there is one, a broker, with negative connections."""

from __future__ import annotations

from collections import Counter
from collections.abc import AsyncIterator, Sequence
from typing import Protocol

from phalanx.link.session.events import Close, Publish, Send
from phalanx.net.front import Event
from phalanx.net.session_broker import SessionBroker, Told


class FrontEnd(Protocol):
    """The part of `phalanx.net.front.Front` that sessions use."""

    def events(self) -> AsyncIterator[Event]:
        """Yield what happens to connections."""

    def send(self, connection: int, data: bytes) -> None:
        """Send a message to one client."""

    def publish(self, connections: Sequence[int], data: bytes) -> None:
        """Send an update to many; one that has not taken the last one misses this one."""

    def admitted(self, connection: int) -> None:
        """Count a connection no longer as an unfinished handshake."""

    def close(self, connection: int, reason: str) -> None:
        """End a connection after what was sent to it."""


class Ways:
    """Carries out what a server of sessions asks for, each connection by its way."""

    def __init__(self, front: FrontEnd, broker: SessionBroker | None) -> None:
        self._front, self.broker = front, broker
        self._admitted: set[int] = set()

    @property
    def rejected(self) -> Counter[str]:
        """Return how many messages were dropped unread, by reason."""
        return self.broker.rejected if self.broker else Counter()

    def events(self) -> list[AsyncIterator[Event]]:
        """Return what happens on each way."""
        return [self._front.events(), *([self.broker.events()] if self.broker else [])]

    def carry(self, told: Told) -> None:
        """Do what a server asks for."""
        match told:
            case Publish(connections, data):
                self._front.publish([each for each in connections if each > 0], data)
                if self.broker and any(each < 0 for each in connections):
                    self.broker.carry(told)
            case Send(connection, data) if connection > 0:
                self._front.send(connection, data)
            case Close(connection, reason) if connection > 0:
                self._admitted.discard(connection)
                self._front.close(connection, reason)
            case _ if self.broker:
                self.broker.carry(told)

    def admit(self, connection: int) -> None:
        """Count a connection no longer as an unfinished handshake."""
        if connection > 0 and connection not in self._admitted:
            self._admitted.add(connection)
            self._front.admitted(connection)

    def forget(self, connection: int) -> None:
        """Take note that a connection is over."""
        self._admitted.discard(connection)
