"""PyDotBot's controller as far as it was recorded (peers/record_dotbots.py): it tells what the real one told.

It knows no robots and moves none. To an order that was recorded it tells what followed it then; of others it keeps note.
"""

from __future__ import annotations

import asyncio
import json
import threading
from contextlib import suppress
from pathlib import Path

from aiohttp import WSMsgType, web

from ports import free_port

RECORDED = json.loads((Path(__file__).parents[1] / "data" / "pydotbot.json").read_text())
HELLO, SNAPSHOT = RECORDED["begins"][:2]
A, B, C = (robot["address"] for robot in SNAPSHOT["robots"])


class Controller:
    """In a thread of its own while the context lasts; `heard` are orders, the oldest first."""

    def __init__(self, port: int = 0, begins: list = RECORDED["begins"], site: dict = RECORDED["site"]):
        self.port = port or free_port()
        self.url = f"dotbot://127.0.0.1:{self.port}"
        self.heard: list[dict | str] = []
        self.acknowledged: list[int] = []
        self.visits = 0
        self._begins, self._site = begins, site
        self._streams: set[web.WebSocketResponse] = set()
        self._loop = asyncio.new_event_loop()

    def __enter__(self):
        self._thread = threading.Thread(target=self._loop.run_forever)
        self._thread.start()
        app = web.Application()
        app.router.add_get("/controller/site", self._tell_site)
        app.router.add_get("/controller/ws/stream", self._stream)
        app.router.add_get("/controller/ws/dotbots", self._orders)
        app.router.add_delete("/controller/dotbots/{address}/positions", self._forget)
        self._runner = web.AppRunner(app, shutdown_timeout=0.1)
        self._there(self._begin())
        return self

    def __exit__(self, *_):
        self._there(self._end())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def say(self, *messages: dict | str):
        """On every stream, now."""
        self._there(self._say(messages))

    def orders_of(self, address: str) -> list[dict]:
        return [said for said in self.heard if isinstance(said, dict) and said["address"] == address]

    def _there(self, job):
        return asyncio.run_coroutine_threadsafe(job, self._loop).result(10)

    async def _begin(self):
        await self._runner.setup()
        await web.TCPSite(self._runner, "127.0.0.1", self.port).start()

    async def _end(self):
        for stream in list(self._streams):
            await stream.close()
        await self._runner.cleanup()

    async def _say(self, messages):
        for stream in list(self._streams):
            for message in messages:
                with suppress(ConnectionError):  # who hears too much goes
                    await stream.send_str(message if isinstance(message, str) else json.dumps(message))

    async def _tell_site(self, request):
        return web.json_response(self._site)

    async def _stream(self, request):
        self.visits += 1
        stream = web.WebSocketResponse()
        await stream.prepare(request)
        assert request.query["hz"] == str(HELLO["hz"])
        assert request.query["trail"] == str(HELLO["trail"])
        for message in self._begins:
            await stream.send_str(message if isinstance(message, str) else json.dumps(message))
        self._streams.add(stream)
        async for said in stream:
            self.acknowledged.append(json.loads(said.data)["ack"])
        self._streams.discard(stream)
        return stream

    async def _orders(self, request):
        orders = web.WebSocketResponse()
        await orders.prepare(request)
        async for said in orders:
            assert said.type is WSMsgType.TEXT
            self.heard.append(said := json.loads(said.data))
            for step in RECORDED["steps"]:
                if said in step.get("orders", [])[:1]:
                    await self._say(step["told"])
            if said in RECORDED["refused"]["orders"]:
                await orders.send_json(RECORDED["refused"]["refusal"])
        return orders

    async def _forget(self, request):
        address = request.match_info["address"]
        self.heard.append(f"forget {address}")
        for step in RECORDED["steps"]:
            if step.get("delete") == address:
                await self._say(step["told"])
        return web.Response()
