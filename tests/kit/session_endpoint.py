"""A server of sessions behind a real websocket, in the test's own event loop: robots that move, and a recorded link."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Self

from aiohttp import WSMsgType, web
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey

from phalanx.config.session import SessionConfig
from phalanx.link.session import (
    Invitation,
    Kind,
    MemoryStore,
    Now,
    Operations,
    Reason,
    Role,
    Secret,
    SessionServer,
    Ticket,
)
from phalanx.link.session.events import Close, Commanded, Publish, Requested, Send

ROBOTS = ("A1", "B2")


@dataclass
class Message:
    """A message as somebody on the network sees it."""

    at_s: float
    up: bool
    size: int


@dataclass
class Endpoint:
    """One server; `async with` serves it on a free port."""

    config: SessionConfig = field(default_factory=SessionConfig)
    store: MemoryStore = field(default_factory=MemoryStore)
    robots: tuple[str, ...] = ROBOTS
    tick_s: float = 0.05
    answer: Callable[[Requested], Any] | None = None
    publishes: bool = True
    port: int = 0

    def __post_init__(self) -> None:
        self.static = X25519PrivateKey.generate()
        self.commands: list[Commanded] = []
        self.events: list[Any] = []
        self.seen: list[Message] = []
        self.sockets: dict[int, web.WebSocketResponse] = {}
        self.state: Callable[[], bytes] = lambda: b'{"seq":1}'
        self.boot()

    def boot(self) -> None:
        """Start the server, as after a kill: what is not in the store is lost."""
        now = self.now
        self.server = SessionServer(
            self.config, self.static, Ed25519PrivateKey.generate(), self.store, os.urandom, now, Role.DRIVE
        )
        self.operations = Operations(self.server)
        self.server.assignment.set_robots(self.robots, now.ms)

    @property
    def now(self) -> Now:
        return Now(time.monotonic_ns() // 1_000_000, int(time.time()))

    def url(self, secret: Secret | None = None) -> str:
        public = self.static.public_key().public_bytes_raw()
        return f"http://127.0.0.1:{self.port}/#{Invitation(public, secret or self.server.door.code).fragment()}"

    def ticket(self, role: Role = Role.DRIVE, uses: int = 1, **more: Any) -> str:
        secret = Secret(Kind.TICKET, os.urandom(16))
        self.server.door.add_ticket(Ticket(secret, role, uses, self.now.unix_s + 3600, **more), self.now.unix_s)
        return self.url(secret)

    async def __aenter__(self) -> Self:
        app = web.Application()
        app.router.add_get("/link", self._socket)
        self._runner = web.AppRunner(app, shutdown_timeout=0.1)
        await self._runner.setup()
        site = web.TCPSite(self._runner, "127.0.0.1", self.port)
        await site.start()
        self.port = self._runner.addresses[0][1]
        self._next = 0
        self._ticks = asyncio.create_task(self._tick())
        return self

    async def __aexit__(self, *_: object) -> None:
        self._ticks.cancel()
        await asyncio.gather(self._ticks, return_exceptions=True)
        await self.cut()
        await self._runner.cleanup()

    async def cut(self) -> None:
        """Close all connections, as a bad network does."""
        for socket in list(self.sockets.values()):
            with contextlib.suppress(Exception):
                await socket.close()

    async def do(self, events: list[Any]) -> None:
        """Carry out the server's events."""
        for event in events:
            self.events.append(event)
            match event:
                case Send(number, data):
                    await self._send(number, data)
                case Publish(numbers, data):
                    for number in numbers:
                        await self._send(number, data)
                case Close(number):
                    if number in self.sockets:
                        asyncio.get_running_loop().create_task(self.sockets.pop(number).close())
                case Commanded():
                    self.commands.append(event)
                    await self.do(self.server.accept(event, self.now))
                case Requested(visitor, number):
                    said = self.answer(event) if self.answer else self._answer(event)
                    if isinstance(said, Reason):
                        await self.do(self.server.refuse(visitor, number, said))
                    elif said is not None:
                        raw = said if isinstance(said, bytes) else json.dumps(said).encode()
                        await self.do(self.server.reply(visitor, number, raw))

    def _answer(self, event: Requested) -> Any:
        if event.name == "robots":
            return [{"address": each, "name": f"robot {each}", "status": 0} for each in self.robots]
        return Reason.UNKNOWN

    async def _send(self, number: int, data: bytes) -> None:
        if number in self.sockets:
            self.seen.append(Message(time.monotonic(), False, len(data)))
            with contextlib.suppress(OSError):
                await self.sockets[number].send_bytes(data)

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(self.tick_s)
            await self.do(self.server.tick(self.now))
            if self.publishes:
                await self.do([self.server.publish(self.state(), self.now)])

    async def _socket(self, request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse(max_msg_size=65_536)
        await socket.prepare(request)
        self._next += 1
        number = self._next
        self.sockets[number] = socket
        await self.do(self.server.opened(number, "127.0.0.1", self.now))
        async for message in socket:
            if message.type is WSMsgType.BINARY:
                self.seen.append(Message(time.monotonic(), True, len(message.data)))
                await self.do(self.server.receive(number, message.data, self.now))
        self.sockets.pop(number, None)
        await self.do(self.server.closed(number, self.now))
        return socket
