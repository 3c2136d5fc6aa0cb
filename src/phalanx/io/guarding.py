"""The guard before a broker of ours: started, and started again when it ends or does not serve."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import socket
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from functools import partial
from pathlib import Path

from phalanx.errors import Unavailable

from .children import a_child, answer, kill_unless, repeat
from .listeners import Listeners
from .ports import LOOPBACK, PortTaken

log = logging.getLogger(__name__)

RESTART_S = 0.3
HELLO, WELCOME = b"\x10\x0c\x00\x04MQTT\x04\x02\x00\x0a\x00\x00", b"\x20\x02\x00\x00"  # CONNECT, CONNACK


@contextlib.asynccontextmanager
async def guarded(at: Listeners, broker: Path) -> AsyncIterator[None]:
    """Visitors are let in where `at` says, and passed on to the broker's socket, for as long as the context lasts.

    Raises: PortTaken. Unavailable: it cannot listen there.
    """
    # We listen, not the guard: who comes while it starts again waits for a moment, and nobody takes its ports.
    with _listening(LOOPBACK, at.visitors_port) as tcp, _listening(at.ws_host, at.ws_port) as websockets:
        keeper = asyncio.create_task(_keep(broker, tcp, websockets))
        try:
            yield
        finally:
            keeper.cancel()
            await asyncio.gather(keeper, return_exceptions=True)


@contextlib.contextmanager
def _listening(host: str, port: int) -> Iterator[socket.socket]:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listening = socket.create_server((host, port), family=family, backlog=1024, dualstack_ipv6=host == "::")
    except OSError as error:
        failure = PortTaken if error.errno == errno.EADDRINUSE else Unavailable
        raise failure(f"mosquitto does not start: {host} port {port}: {error.strerror}", "phalanx doctor") from error
    with listening:
        yield listening


async def _keep(broker: Path, *listening: socket.socket) -> None:
    numbers = [each.fileno() for each in listening]
    words = (sys.executable, "-m", "phalanx.io.guard", str(broker), *map(str, numbers))
    while True:
        try:
            async with a_child(*words, pass_fds=numbers) as process:
                watching = asyncio.create_task(_watch(process, partial(_serves, listening[0])))
                try:
                    await repeat(process, "guard")
                finally:
                    watching.cancel()
                log.warning("the guard ended (%s); starting it again", await process.wait())
        except OSError as error:  # out of files or processes, for the moment
            log.error("%s; trying again", error)  # noqa: TRY400  # the trace says nothing more
        await asyncio.sleep(RESTART_S)


async def _watch(process: asyncio.subprocess.Process, serves: Callable[[], Awaitable[bool]]) -> None:
    while not await serves():  # noqa: ASYNC110  # on a busy machine it takes its time to begin
        await asyncio.sleep(RESTART_S)
    await kill_unless(serves, process, "the guard")


async def _serves(tcp: socket.socket) -> bool:
    """Whether a visitor gets through, in time."""
    host, port = tcp.getsockname()[:2]
    return await answer(host, port, HELLO, len(WELCOME)) == WELCOME
