"""The front end's process: the page, and websockets at `/link`.

Started by `gateway_end.py`: `python -m phalanx.io.front.serve PARENT PIPE DOOR FIRST PAGES POLICY LIMITS PROXY
[CERT KEY]`.
"""

from __future__ import annotations

import asyncio
import json
import signal
import socket
import sys
from pathlib import Path

from aiohttp import web

from phalanx.config.front import FrontConfig
from phalanx.io.children import end_with
from phalanx.io.seats import allow_files
from phalanx.io.site import Site, connection_of

from .links import Links
from .pipe import Pipe

FROM_GATEWAY_BYTES = 4 * 1024 * 1024


class FrontSite(Site):
    """The visitors' page, with the websocket."""

    def __init__(
        self, links: Links, pages: Path, policy: str, limits: FrontConfig, doors: tuple[socket.socket, ...]
    ) -> None:
        self._links = links
        super().__init__(pages, policy, connections=limits.connections_max, doors=doors)

    def _add_routes(self) -> None:
        self.app.router.add_get("/link", self._link)

    async def _link(self, request: web.Request) -> web.StreamResponse:
        return await self._links.serve(request, connection_of(request).place)


async def serve(words: list[str]) -> None:
    """Serve until the gateway's end of the pipe is closed."""
    pipe_number, door_number, first, pages, policy, limits_json, *_ = words
    limits = FrontConfig(**json.loads(limits_json))
    allow_files(2 * limits.connections_max)
    over = asyncio.Event()
    links = Links(limits, int(first))
    pipe = links.pipe = Pipe(FROM_GATEWAY_BYTES, links.on_message, lambda _: over.set())
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGTERM, over.set)
    ours = socket.socket(fileno=int(pipe_number))
    await loop.create_unix_connection(lambda: pipe, sock=ours)
    async with FrontSite(links, Path(pages), policy, limits, (socket.socket(fileno=int(door_number)),)):
        await over.wait()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the gateway, which ends us
    end_with(int(sys.argv[1]))
    asyncio.run(serve(sys.argv[2:]))
