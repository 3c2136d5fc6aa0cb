"""Attacks on a front end, from addresses of loopback. Started by bench_front.py: KIND PORT ADDRESSES INVITATION."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
import sys
import time
from collections import Counter
from collections.abc import Callable

from phalanx.config.session import SessionConfig
from phalanx.errors import UsageError
from phalanx.link.session import SessionClient, parse_invitation
from phalanx.link.session.events import KeepSecret, Transmit
from phalanx.net.children import end_with_parent
from phalanx.net.seats import raise_file_limit

LINK = (
    b"GET /link HTTP/1.1\r\nHost: us\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
)
HALF_OPEN, SLOW, FLOODERS, COMERS, JOINS = 1000, 500, 20, 20, 500
FLOOD_EVERY_S, FLOOD_MESSAGES = 0.01, 80  # 8000 messages a second, of each
counts: Counter[str] = Counter()


def frame(data: bytes) -> bytes:
    length = len(data)
    return (
        (b"\x82" + (bytes([128 | length]) if length < 126 else b"\xfe" + length.to_bytes(2, "big"))) + bytes(4) + data
    )


class Session:
    """What a visitor of mode session sends: yields frames."""

    def __init__(self, code: str) -> None:
        self.client = SessionClient(SessionConfig(), parse_invitation(code), os.urandom)
        self._is_told = False

    def start(self) -> bytes:
        return self._frames(self.client.start(now_ms()))

    def receive(self, message: bytes) -> bytes:
        return self._frames(self.client.receive(message, now_ms()))

    @property
    def is_in(self) -> bool:
        return self.client.is_joined

    def flood(self, count: int) -> bytes:
        return b"".join(frame(self.command("NOBODY").data) for _ in range(count))

    def command(self, robot: str) -> Transmit:
        return self.client.command(robot, "move_raw", b'{"left_y":60,"right_y":60,"left_x":0,"right_x":0}', now_ms())

    def stop_all(self) -> bytes:
        """Return an operator's request, with the time."""
        return self.client.request("stop", str(time.monotonic()).encode(), now_ms())[1].data

    def _frames(self, events: list) -> bytes:
        said = b""
        for event in events:
            if isinstance(event, Transmit):
                said += frame(event.data)
            elif isinstance(event, KeepSecret) and self.client.is_joined:
                said += frame(self.client.stored(event.secret, now_ms()).data)
        return said


class Client(asyncio.Protocol):
    """A websocket; `session` joins, None does not."""

    head = LINK

    def __init__(self, session: Session | None, *, reads: bool = True) -> None:
        self.session, self._reads = session, reads
        self.is_up = self.is_over = False
        self.ready: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._buffer = bytearray()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport
        transport.write(self.head)

    def connection_lost(self, _error: Exception | None) -> None:
        self.is_over = True
        if not self.ready.done():
            self.ready.cancel()

    def data_received(self, data: bytes) -> None:
        self._buffer += data
        if not self.is_up:
            head, found, rest = bytes(self._buffer).partition(b"\r\n\r\n")
            if not found:
                return
            if b" 101 " not in head[:40]:
                self.transport.abort()
                return
            self.is_up, self._buffer = True, bytearray(rest)
            if self.session:
                self.transport.write(self.session.start())
        self._read_frames()

    def _read_frames(self) -> None:
        raw, at = bytes(self._buffer), 0
        while len(raw) - at >= 2:
            length, begin = raw[at + 1] & 127, at + 2
            if length >= 126:
                size = 2 if length == 126 else 8
                length, begin = int.from_bytes(raw[begin : begin + size], "big"), begin + size
            if len(raw) < begin + length:
                break
            if raw[at] & 15 == 2 and self.session:
                self.transport.write(self.session.receive(raw[begin : begin + length]))
            at = begin + length
        del self._buffer[:at]
        if self.session and self.session.is_in and not self.ready.done():
            self.ready.set_result(None)
            if not self._reads:
                self.transport.pause_reading()


async def connected(port: int, address: str, make: Callable[[], asyncio.Protocol], receive_bytes: int = 0):
    ours = socket.socket()
    if receive_bytes:
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
    ours.setblocking(False)
    ours.setsockopt(socket.IPPROTO_IP, 24, 1)  # IP_BIND_ADDRESS_NO_PORT
    ours.bind((address, 0))
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(10):
            await loop.sock_connect(ours, ("127.0.0.1", port))
            return (await loop.create_connection(make, sock=ours))[1]
    except BaseException:
        ours.close()
        raise


class Attack:
    """Connections of one kind, each made again when it is closed."""

    def __init__(self, port: int, addresses: list[str], session: Callable[[], Session]) -> None:
        self.port, self.addresses, self.session = port, addresses, session

    def of(self, n: int) -> str:
        return self.addresses[n % len(self.addresses)]

    async def half_open(self, n: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port, local_addr=(self.of(n), 0))
        writer.write((b"", Client.head[:60], Client.head)[n % 3])
        counts["opened"] += 1
        with contextlib.closing(writer):
            while await reader.read(4096):
                pass
        await asyncio.sleep(0.2)

    async def slow(self, n: int) -> None:
        client = await connected(self.port, self.of(n), lambda: Client(self.session(), reads=False), 4096)
        await asyncio.wait_for(client.ready, 20)
        counts["joined"] += 1
        while not client.is_over:
            with contextlib.suppress(UsageError):
                client.transport.write(client.session.flood(1))
            await asyncio.sleep(0.25)
        counts["closed"] += 1

    async def garbage(self, n: int) -> None:
        client = await connected(self.port, self.of(n), lambda: Client(None))
        junk = b"".join(frame(os.urandom(136)) for _ in range(FLOOD_MESSAGES))
        await self._flood(client, lambda: junk)
        await asyncio.sleep(0.02)

    async def insiders(self, n: int) -> None:
        client = await connected(self.port, self.of(n), lambda: Client(self.session()))
        await asyncio.wait_for(client.ready, 20)
        counts["joined"] += 1
        await self._flood(client, lambda: client.session.flood(FLOOD_MESSAGES // 4))

    async def _flood(self, client: Client, said: Callable[[], bytes]) -> None:
        while not client.is_over:
            if client.transport.get_write_buffer_size() == 0:
                client.transport.write(said())
                counts["floods"] += 1
            await asyncio.sleep(FLOOD_EVERY_S)

    async def come_and_go(self, n: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port, local_addr=(self.of(n), 0))
        with contextlib.closing(writer):
            writer.write(Client.head + frame(os.urandom(58)))
            counts["came"] += 1
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(reader.read(400), 3)

    async def pages(self, n: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port, local_addr=(self.of(n), 0))
        with contextlib.closing(writer):
            writer.write(b"GET / HTTP/1.1\r\nHost: us\r\n\r\n" * 20)
            counts["asked"] += 20
            with contextlib.suppress(TimeoutError):
                while await asyncio.wait_for(reader.read(65536), 3):
                    writer.write(b"GET / HTTP/1.1\r\nHost: us\r\n\r\n")
                    counts["asked"] += 1

    async def joins(self, _n: int) -> None:
        client = await connected(self.port, self.addresses[0], lambda: Client(self.session()))
        with contextlib.suppress(asyncio.CancelledError, TimeoutError):
            await asyncio.wait_for(client.ready, 20)
            counts["joined"] += 1
            await asyncio.sleep(10)
        client.transport.abort()

    async def again(self, what: Callable[[int], object], n: int) -> None:
        while True:
            try:
                await what(n)
            except (OSError, TimeoutError, asyncio.CancelledError):
                if asyncio.current_task().cancelling():
                    raise
                counts["failed"] += 1
                await asyncio.sleep(0.2)

    def kinds(self) -> dict[str, tuple[int, Callable]]:
        return {
            "half-open": (HALF_OPEN, self.half_open),
            "slow readers": (SLOW, self.slow),
            "garbage": (FLOODERS, self.garbage),
            "insiders' floods": (FLOODERS, self.insiders),
            "come and go": (COMERS, self.come_and_go),
            "pages": (FLOODERS, self.pages),
            "joins": (JOINS, self.joins),
        }


async def attack(attack: Attack, kinds: list[str]) -> None:
    tasks = []
    for kind in kinds:
        count, what = attack.kinds()[kind]
        tasks += [asyncio.create_task(attack.again(what, n)) for n in range(count)]
    loop, over = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(sys.stdin, over.set)
    await over.wait()
    print(json.dumps(counts), flush=True)
    os._exit(0)


def now_ms() -> int:
    return int(time.monotonic() * 1000)


if __name__ == "__main__":
    parent, kinds, port, addresses, code = sys.argv[1:]
    end_with_parent(int(parent))
    raise_file_limit(8192)
    asyncio.run(attack(Attack(int(port), addresses.split(","), lambda: Session(code)), kinds.split(",")))
