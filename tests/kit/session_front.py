"""A front end in this process, and a visitor over a real websocket: bytes and events of a pure client, no more."""

from __future__ import annotations

import asyncio
import json
import os
import time
from contextlib import asynccontextmanager

import aiohttp
from aiohttp import web

from phalanx.config.session import SessionConfig
from phalanx.link.session import Invitation, SessionClient
from phalanx.link.session.events import (
    Admitted,
    Ended,
    KeepSecret,
    Replied,
    StandingChanged,
    Transmit,
    Updated,
    WasRefused,
)
from phalanx.net.front import Closed, Opened, Received


class FakeFront:
    """Serves `/link` on a free port of loopback."""

    def __init__(self):
        self.port, self.closed, self.admits = 0, {}, []
        self._events: asyncio.Queue = asyncio.Queue()
        self._sockets: dict[int, web.WebSocketResponse] = {}
        self._tasks: set[asyncio.Task] = set()

    async def __aenter__(self):
        app = web.Application()
        app.router.add_get("/link", self._serve)
        self._runner = web.AppRunner(app, shutdown_timeout=0.1)
        await self._runner.setup()
        await web.TCPSite(self._runner, "127.0.0.1", 0).start()
        self.port = self._runner.addresses[0][1]
        return self

    async def __aexit__(self, *_):
        await self._runner.cleanup()

    async def _serve(self, request):
        ws = web.WebSocketResponse(max_msg_size=1 << 16)
        await ws.prepare(request)
        number = len(self._sockets) + 1
        self._sockets[number] = ws
        self._events.put_nowait(Opened(number, request.remote))
        async for message in ws:
            if message.type is aiohttp.WSMsgType.BINARY:
                self._events.put_nowait(Received(number, message.data))
        self._events.put_nowait(Closed(number))
        return ws

    async def events(self):
        while True:
            yield await self._events.get()

    def _soon(self, job):
        task = asyncio.ensure_future(job)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def send(self, connection, data):
        ws = self._sockets[connection]
        if not ws.closed:
            self._soon(ws.send_bytes(data))

    def publish(self, connections, data):
        for each in connections:
            self.send(each, data)

    def admitted(self, connection):
        self.admits.append(connection)

    def close(self, connection, reason):
        self.closed[connection] = reason
        self._soon(self._sockets[connection].close())


class Visit:
    """One visitor: what its client reported, the newest frame, and what was refused."""

    def __init__(self, ws, client: SessionClient):
        self.ws, self.client = ws, client
        self.visitor = self.standing = self.ended = self.secret = None
        self.name = ""
        self.frames: list[dict] = []
        self.refused: list[tuple[int, int]] = []
        self.raw_updates: list[bytes] = []
        self._replies: dict[int, asyncio.Future] = {}

    async def do(self, events):
        for event in events:
            match event:
                case Transmit(data):
                    if not self.ws.closed:
                        await self.ws.send_bytes(data)
                case Admitted(visitor, name):
                    self.visitor, self.name = visitor, name
                case KeepSecret(secret):
                    self.secret = secret
                    await self.do([self.client.stored(secret, ms())])
                case StandingChanged(standing):
                    self.standing = standing
                case Updated(state):
                    self.frames.append(json.loads(state)["data"])
                    self.raw_updates.append(state)
                case Replied(number, payload):
                    self._replies.pop(number).set_result(json.loads(payload))
                case WasRefused(number, reason):
                    self.refused.append((number, reason))
                    if number in self._replies:
                        self._replies.pop(number).set_exception(PermissionError(reason.name))
                case Ended(reason):
                    self.ended = reason or "no answer"

    async def read(self):
        async for message in self.ws:
            await self.do(self.client.receive(message.data, ms()))

    async def command(self, robot, name, payload=None, stop=False):
        raw = b"" if payload is None else json.dumps(payload).encode()
        await self.do([self.client.command(robot, name, raw, ms(), stop=stop)])

    async def request(self, name, payload=None):
        number, transmit = self.client.request(name, b"" if payload is None else json.dumps(payload).encode(), ms())
        self._replies[number] = answer = asyncio.get_running_loop().create_future()
        await self.do([transmit])
        return await asyncio.wait_for(answer, 10)


def ms():
    return time.monotonic_ns() // 1_000_000


@asynccontextmanager
async def visiting(port: int, invitation: Invitation, name: str = "", host: str = "127.0.0.1", source="", **more):
    """A visitor at address `source` that tries to join; `ssl` is for https, as the rest of `more` for aiohttp."""
    url = f"http{'s' if 'ssl' in more else ''}://{host}:{port}/link"
    at = aiohttp.TCPConnector(local_addr=(source, 0)) if source else None
    async with aiohttp.ClientSession(connector=at) as http, http.ws_connect(url, **more) as ws:
        visit = Visit(ws, SessionClient(SessionConfig(), invitation, os.urandom, name))
        reading = asyncio.create_task(visit.read())
        try:
            await visit.do(visit.client.start(ms()))
            yield visit
        finally:
            reading.cancel()
