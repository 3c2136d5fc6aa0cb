"""What every command that serves a link shares: its events, how long it waits for a broker, and how long it lives."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from typing import Any

from phalanx.errors import Unavailable
from phalanx.io import Server
from phalanx.io.server import Happening
from phalanx.io.session_broker import SessionBroker
from phalanx.link import Command, Epoch, Request
from phalanx.link.messages import Rejected

WAIT_QUIETLY_S = 1.5


@contextlib.asynccontextmanager
async def for_at_most(duration_s: float | None) -> AsyncIterator[None]:
    """The body is ended quietly after `duration_s`, if that is given; a TimeoutError of its own is passed on."""
    limit = asyncio.timeout(duration_s)
    try:
        async with limit:
            yield
    except TimeoutError:
        if not limit.expired():
            raise


async def connected_within(server: Server | SessionBroker, wait_s: float) -> None:
    """Wait for a server's broker. Raises: Unavailable: it does not answer in time, or refuses us."""
    try:
        await server.wait_connected(wait_s)
    except TimeoutError as error:
        raise Unavailable(str(error), "phalanx doctor --broker URL; to wait longer for it, --wait") from error


async def until_connected(server: Server | SessionBroker, say: Callable[[dict[str, Any]], None], wait_s: float) -> None:
    """The same; what takes long is said."""

    async def tell() -> None:
        await asyncio.sleep(WAIT_QUIETLY_S)
        say({"event": "waiting", "broker": str(server.broker), "trouble": server.trouble})

    telling = asyncio.ensure_future(tell())
    try:
        await connected_within(server, wait_s)
    finally:
        telling.cancel()


def tell_event(said: Happening, qr_url: Callable[[], str]) -> dict[str, Any] | None:
    """The event in JSON's types; None for what is no event. A rotation has the pin in it."""
    if isinstance(said, Epoch):
        return {"event": "rotation", "pin": said.pin.digits, "topic": said.topic, "qr_url": qr_url()}
    if isinstance(said, Command):
        return {"event": "command", "address": said.address, "name": said.name, "payload": said.payload}
    if isinstance(said, Request):
        return {"event": "request", "request": said.number, "client": said.client_id}
    if isinstance(said, Rejected):
        return {"event": "rejected", "reason": said.reason}
    return None
