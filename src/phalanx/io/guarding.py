"""The guard before a broker of ours: started, and started again when it ends or does not serve."""

from __future__ import annotations

import contextlib
import errno
import socket
import sys
from collections.abc import AsyncIterator, Iterator
from functools import partial
from pathlib import Path

from phalanx.errors import Unavailable

from .children import a_child, answer, kept
from .heard import Heard
from .listeners import Listeners
from .ports import LOOPBACK, PortTaken

HELLO, WELCOME = b"\x10\x0c\x00\x04MQTT\x04\x02\x00\x0a\x00\x00", b"\x20\x02\x00\x00"  # CONNECT, CONNACK


@contextlib.asynccontextmanager
async def guarded(at: Listeners, broker: Path, folder: Path) -> AsyncIterator[Heard]:
    """Visitors are let in where `at` says, and passed on to the broker's socket, for as long as the context lasts.

    Yields what the gateway shall tell the guard. We ourselves come to see whether it serves at a path in `folder`: a
    place that we share with nobody, for a guard that has much to do with others still serves.

    Raises: PortTaken. Unavailable: it cannot listen there.
    """
    heard, watched = Heard(folder / "heard"), folder / "watched"
    # We listen, not the guard: who comes while it starts again waits for a moment, and nobody takes its ports.
    with (
        _listening_to_us(watched) as us,
        _listening(LOOPBACK, at.visitors_port) as tcp,
        _listening(at.ws_host, at.ws_port) as websockets,
    ):
        numbers = [each.fileno() for each in (us, tcp, websockets)]
        words = (sys.executable, "-m", "phalanx.io.guard", str(broker), str(heard.path), *map(str, numbers))
        async with kept("the guard", partial(a_child, *words, pass_fds=numbers), partial(_serves, watched)):
            yield heard


@contextlib.contextmanager
def _listening(host: str, port: int) -> Iterator[socket.socket]:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listening = socket.create_server((host, port), family=family, backlog=1024, dualstack_ipv6=host == "::")
    except OSError as error:
        failure = PortTaken if error.errno == errno.EADDRINUSE else Unavailable
        raise failure(f"the broker does not start: {host} port {port}: {error.strerror}", "phalanx doctor") from error
    with listening:
        yield listening


@contextlib.contextmanager
def _listening_to_us(path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(path))
        path.chmod(0o600)
        listening.listen()
        yield listening


async def _serves(watched: Path) -> bool | None:
    """Whether we get through, in time; None if we do not know."""
    said = await answer(watched, HELLO, len(WELCOME))
    return None if said is None else said == WELCOME
