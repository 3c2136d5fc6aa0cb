"""Links: the ways by which visitors reach a gateway. A broker in mode qrkey is one, sessions are another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from phalanx.errors import PeerError
from phalanx.link import Command, Request
from phalanx.net.server import handler_failed


class Link(Protocol):
    """Carries commands and requests to the gateway's handlers, and what happens to all its visitors.

    A handler refuses by a `PeerError`, which is counted.
    """

    @property
    def is_published(self) -> bool:
        """Return whether its clients are those of the published packages, which read no state updates."""

    @property
    def answer_bytes(self) -> int:
        """Return the longest answer that it carries."""

    def on_command(self, name: str, /) -> Callable[[Callable[[Command], Any]], Any]:
        """Decorate the handler of a command."""

    def on_request(self, number: int, /) -> Callable[[Callable[[Request], Any]], Any]:
        """Decorate the handler of a request, which returns data or a `SharedAnswer`."""

    async def notify(self, payload: dict[str, Any], /) -> bool:
        """Send a notification to all visitors; return whether it was sent. Raises: UsageError: it is too long."""


def call_now(handler: Callable[[Command], Any], command: Command) -> None:
    """Call a handler of commands, which is a plain function here. Raises: PeerError, and HandlerFailed for others."""
    try:
        handler(command)
    except PeerError:
        raise
    except Exception as error:
        raise handler_failed(handler, error) from error
