"""A run to be looked at, over HTTP on loopback: a page that plays it, and the run, a JSON object a line."""

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
WAIT_S, LOOK_S = 1.0, 0.1  # a page that has all so far is answered when there is more, or after so long


class ViewPages(Site):
    """The page. `put` is told the run's lines, by any thread, and None at its end; pages ask for what they lack."""

    def __init__(self, port: int) -> None:
        self._lines: list[bytes] = []
        self._ended = False
        self._run = secrets.token_hex(8)  # a page that was left open shows another
        super().__init__(PAGES / "viewer", VIEW_POLICY, port, connections=CONNECTIONS)

    def put(self, words: dict[str, Any] | None) -> None:
        """The next line."""
        self._ended = words is None
        # As the page reads it, NaN is no number.
        self._lines.append(json.dumps({"end": True} if words is None else words, allow_nan=False).encode() + b"\n")

    def _add_routes(self) -> None:
        self.app.router.add_get("/api/run", self._tell_run)

    async def _tell_run(self, request: web.Request) -> web.Response:
        """Lines from `from` on, as many as fit; none where nothing came for a while."""
        asked = request.query.get("from", "0")
        if not (asked.isascii() and asked.isdigit() and len(asked) < 10):
            return web.Response(status=400, text="from is the number of lines that you have\n")
        if (request.query.get("run") or self._run) != self._run:
            return web.Response(status=409, text="another run is here now\n")
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
