"""A page that strangers reach, in a process of its own: what they ask for takes nothing of the gateway's time.

It is started again when it ends or serves no longer. We listen, not it: who comes while it starts waits for a moment.
Started as `python -m phalanx.io.page PARENT FOLDER POLICY CONNECTIONS DOOR…`: whose
child it is, and last the numbers of sockets that listen.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import sys
from collections.abc import AsyncIterator
from functools import partial
from pathlib import Path

from .children import a_python_child, answer, end_with, kept
from .files import allow_files
from .ports import listen, listening_to_us
from .private_folder import private_folder
from .site import FILES_EACH, Site

QUESTION, WELL = b"GET / HTTP/1.1\r\nHost: us\r\nConnection: close\r\n\r\n", b"HTTP/1.1 "


@contextlib.asynccontextmanager
async def page_apart(
    folder: Path, policy: str, host: str, port: int, *, connections: int, if_taken: str
) -> AsyncIterator[int]:
    """The page in `folder` is served there for as long as the context lasts; yields its port, for 0 is any.

    Raises: PortTaken, with the hint `if_taken`. Unavailable: it cannot listen there.
    """
    with private_folder() as ours, listening_to_us(ours / "watched") as us, listen(host, port, if_taken) as door:
        numbers = (door.fileno(), us.fileno())
        words = ("phalanx.io.page", str(folder), policy, str(connections), *map(str, numbers))
        child, serves = partial(a_python_child, *words, pass_fds=numbers), partial(_serves, ours / "watched")
        async with kept("the page", child, serves):
            yield int(door.getsockname()[1])


async def _serves(watched: Path) -> bool | None:
    """Whether we are answered, in time; None if we do not know."""
    said = await answer(watched, QUESTION, len(WELL))
    return None if said is None else said == WELL


async def _serve_until_told(folder: Path, policy: str, connections: int, doors: list[socket.socket]) -> None:
    allow_files(4 * FILES_EACH * connections)
    async with Site(folder, policy, connections=connections, doors=doors):
        await asyncio.Event().wait()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the gateway, which ends us
    parent, folder, policy, connections, *numbers = sys.argv[1:]
    end_with(int(parent))
    doors = [socket.socket(fileno=int(number)) for number in numbers]
    asyncio.run(_serve_until_told(Path(folder), policy, int(connections), doors))
