"""Main program of the front end's process.

Started by `gateway_end.py`: `python -m phalanx.net.front.serve PARENT PIPE DOOR FIRST PAGES OPERATOR POLICY LIMITS
PROXY PUBLIC [CERT KEY]`: the parent's process id; file descriptors of the socket to the gateway and of the listening
socket; number of the first connection; folders and policy of the pages; limits, and true behind a proxy, as JSON; the
swarm's public key; PEM files.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import sys
from pathlib import Path

from phalanx.config.front import FrontConfig
from phalanx.net.children import end_with_parent
from phalanx.net.seats import raise_file_limit
from phalanx.net.site import FILES_EACH

from .pages import FrontSite
from .pipe import Pipe
from .tls import tls_context

FROM_GATEWAY_BYTES = 4 * 1024 * 1024
# Lower priority than the gateway's, which runs the robots' tick and the operator's stop.
NICE = 5


async def serve(arguments: list[str]) -> None:
    """Serve until the gateway closes the pipe, or SIGTERM."""
    pipe_number, door_number, first, pages, operator, policy, limits_json, proxy_json, public, *files = arguments
    limits = FrontConfig(**json.loads(limits_json))
    raise_file_limit(4 * FILES_EACH * limits.connections_max)
    over = asyncio.Event()
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGTERM, over.set)
    door = socket.socket(fileno=int(door_number))
    site = FrontSite(
        Path(pages),
        policy,
        limits,
        (door,),
        int(first),
        tls=tls_context(*files) if files else None,
        behind_proxy=json.loads(proxy_json),
        key=public,
        operator=Path(operator) if operator else None,
    )
    pipe = site.links.pipe = Pipe(FROM_GATEWAY_BYTES, site.links.on_message, lambda _: over.set())
    await loop.create_unix_connection(lambda: pipe, sock=socket.socket(fileno=int(pipe_number)))
    async with site:
        await over.wait()


def yield_to_gateway() -> None:
    """Lower this process's priority; also that of its autogroup, within which alone a nice value counts."""
    os.nice(NICE)
    with contextlib.suppress(OSError):
        Path("/proc/self/autogroup").write_text(str(NICE))


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the gateway, which ends this process
    end_with_parent(int(sys.argv[1]))
    yield_to_gateway()
    asyncio.run(serve(sys.argv[2:]))
