"""Serve a run over HTTP on loopback: a page that plays it, and the run as one JSON object per line."""

from __future__ import annotations

import asyncio
import itertools
import json
import secrets
from typing import Any

from aiohttp import web

from phalanx.net.site import Site

from .serve_pages import PAGES, VIEW_POLICY

CONNECTIONS = 50
AT_ONCE_BYTES = 1 << 21
WAIT_S, LOOK_S = 1.0, 0.1  # long polling: an answer waits for new lines, at most WAIT_S


class ViewPages(Site):
    """The page of a run. `put` adds lines from any thread, and None at the end; pages request missing lines."""

    def __init__(self, port: int) -> None:
        self._lines: list[bytes] = []
        self._ended = False
        self._run = secrets.token_hex(8)  # id of the run: an old page may show another one
        super().__init__(PAGES / "viewer", VIEW_POLICY, port, connections=CONNECTIONS)

    def put(self, words: dict[str, Any] | None) -> None:
        """Add the next line, or None at the end."""
        self._ended = words is None
        # The page's JSON parser rejects NaN.
        self._lines.append(json.dumps({"end": True} if words is None else words, allow_nan=False).encode() + b"\n")

    def _add_routes(self) -> None:
        self.app.router.add_get("/api/run", self._tell_run)

    async def _tell_run(self, request: web.Request) -> web.Response:
        """Answer lines from number `from` on, as many as fit; none if nothing arrived for a while."""
        asked = request.query.get("from", "0")
        if not (asked.isascii() and asked.isdigit() and len(asked) < 10):
            return web.Response(status=400, text="from has to be the number of lines received\n")
        if (request.query.get("run") or self._run) != self._run:
            return web.Response(status=409, text="another run is served now\n")
        first = int(asked)
        for _ in range(round(WAIT_S / LOOK_S)):
            if len(self._lines) > first or self._ended:
                break
            await asyncio.sleep(LOOK_S)
        some: list[bytes] = []
        size = 0
        for line in itertools.islice(self._lines, first, len(self._lines)):
            if some and size + len(line) > AT_ONCE_BYTES:
                break
            some.append(line)
            size += len(line)
        body = b"".join(some)
        headers = {"Cache-Control": "no-store", "Run": self._run}
        return web.Response(body=body, content_type="application/x-ndjson", headers=headers)
