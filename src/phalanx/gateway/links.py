"""Links connect visitors to a gateway: a broker in mode qrkey is one, sessions are another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from phalanx.errors import PeerError
from phalanx.link import Command, Request
from phalanx.net.server import handler_failed


class Link(Protocol):
    """Passes commands and requests to the gateway's handlers, and notifications to all its visitors.

    A handler refuses by raising a `PeerError`, which is counted.
    """

    @property
    def is_published(self) -> bool:
        """Return whether its clients are the published packages, which cannot read state updates."""

    @property
    def answer_bytes(self) -> int:
        """Return the size of the longest answer that the link can carry."""

    def on_command(self, name: str, /) -> Callable[[Callable[[Command], Any]], Any]:
        """Register the decorated function as the handler of a command."""

    def on_request(self, number: int, /) -> Callable[[Callable[[Request], Any]], Any]:
        """Register the decorated function as the handler of a request; it returns data or a `SharedAnswer`."""

    async def notify(self, payload: dict[str, Any], /) -> bool:
        """Send a notification to all visitors; return whether it was sent. Raises: UsageError: too long."""


def call_handler_now(handler: Callable[[Command], Any], command: Command) -> None:
    """Call the synchronous handler of a command. Raises: PeerError; HandlerFailed for any other error."""
    try:
        handler(command)
    except PeerError:
        raise
    except Exception as error:
        raise handler_failed(handler, error) from error
