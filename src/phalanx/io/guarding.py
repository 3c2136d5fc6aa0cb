"""The guard before a broker of ours: started, and started again when it ends or does not serve."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from functools import partial
from pathlib import Path

from .children import a_python_child, answer, kept
from .heard import Heard
from .listeners import Listeners
from .ports import LOOPBACK, listen, listening_to_us

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
        listening_to_us(watched) as us,
        listen(LOOPBACK, at.visitors_port) as tcp,
        listen(at.ws_host, at.ws_port) as websockets,
    ):
        numbers = [each.fileno() for each in (us, tcp, websockets)]
        words = ("phalanx.io.guard", str(broker), str(heard.path), *map(str, numbers))
        async with kept("the guard", partial(a_python_child, *words, pass_fds=numbers), partial(_serves, watched)):
            yield heard


async def _serves(watched: Path) -> bool | None:
    """Whether we get through, in time; None if we do not know."""
    said = await answer(watched, HELLO, len(WELCOME))
    return None if said is None else said == WELCOME
