"""The broker's end of what the guard carries: a connection beside each visitor's own."""

from __future__ import annotations

import asyncio
import socket
from typing import Protocol

ASK_AGAIN_S = 0.01


async def connected(path: str) -> socket.socket:
    """A connection to the socket at `path`; asyncio takes one for connected that the other end had no room for.

    Raises: OSError.
    """
    connection = socket.socket(socket.AF_UNIX)
    connection.setblocking(False)
    try:
        while True:
            try:
                connection.connect(path)
            except BlockingIOError:
                await asyncio.sleep(ASK_AGAIN_S)
            else:
                return connection
    except BaseException:
        connection.close()
        raise


class Told(Protocol):
    """Whom the broker speaks to (visitor.Visitor is one)."""

    def tell(self, data: bytes) -> None:
        """The broker said something."""

    def hold_up(self) -> None:
        """It does not keep up."""

    def go_on(self) -> None:
        """It does again."""

    def say_goodbye(self) -> None:
        """It has hung up."""


class Broker(asyncio.Protocol):
    """The broker's end of a visitor's connection."""

    def __init__(self, visitor: Told) -> None:
        self._visitor = visitor

    def data_received(self, data: bytes) -> None:
        """For the visitor."""
        self._visitor.tell(data)

    def pause_writing(self) -> None:
        """It does not keep up."""
        self._visitor.hold_up()

    def resume_writing(self) -> None:
        """It does again."""
        self._visitor.go_on()

    def connection_lost(self, error: Exception | None) -> None:  # noqa: ARG002
        """It has hung up."""
        self._visitor.say_goodbye()
