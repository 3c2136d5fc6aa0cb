"""Wait for a gateway's broker, and end a gateway after its duration."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from typing import Any

from phalanx.errors import Unavailable
from phalanx.net import Server
from phalanx.net.session_broker import SessionBroker

WAIT_QUIETLY_S = 1.5


@contextlib.asynccontextmanager
async def for_at_most(duration_s: float | None) -> AsyncIterator[None]:
    """End the body quietly after `duration_s`, if given; its own TimeoutErrors are passed on."""
    limit = asyncio.timeout(duration_s)
    try:
        async with limit:
            yield
    except TimeoutError:
        if not limit.expired():
            raise


async def until_connected(server: Server | SessionBroker, say: Callable[[dict[str, Any]], None], wait_s: float) -> None:
    """Wait for a server's broker; report long waits. Raises: Unavailable: unreachable, or it refuses us."""

    async def tell() -> None:
        await asyncio.sleep(WAIT_QUIETLY_S)
        say({"event": "waiting", "broker": str(server.broker), "trouble": server.trouble})

    telling = asyncio.ensure_future(tell())
    try:
        await server.wait_connected(wait_s)
    except TimeoutError as error:
        raise Unavailable(str(error), "check it: phalanx doctor --broker URL; or wait longer with --wait") from error
    finally:
        telling.cancel()
