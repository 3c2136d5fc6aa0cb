"""A front end as a real process, a gateway that answers, and raw sockets that come to it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from collections import Counter
from pathlib import Path

from phalanx.config.front import FrontConfig
from phalanx.net.front import Closed, Front, Opened, Received

HANDSHAKE = (
    b"GET /link HTTP/1.1\r\nHost: us\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
)


class Echo:
    """A gateway that admits who says something, answers it, and notes what it is told."""

    def __init__(self, front: Front) -> None:
        self.front, self.told = front, []
        self.admits = self.answers = True
        self.reads = asyncio.Event()
        self.reads.set()

    async def run(self) -> None:
        async for event in self.front.events():
            self.told.append(event)
            if isinstance(event, Received):
                if self.admits:
                    self.front.admitted(event.connection)
                if self.answers:
                    self.front.send(event.connection, event.data)
            await self.reads.wait()

    def heard(self) -> Counter:
        """How many messages came from each connection."""
        return Counter(each.connection for each in self.told if isinstance(each, Received))

    def open(self) -> set[int]:
        opened = {each.connection for each in self.told if isinstance(each, Opened)}
        return opened - {each.connection for each in self.told if isinstance(each, Closed)}

    async def eventually(self, condition, timeout_s=30.0):
        async with asyncio.timeout(timeout_s):
            while not condition():
                await asyncio.sleep(0.01)


@contextlib.asynccontextmanager
async def echoing(pages: Path, *, host: str = "127.0.0.1", tls=None, behind_proxy=False, key="", **limits):
    front = Front(pages, "default-src 'self'", host, 0, FrontConfig(**limits), tls, behind_proxy, key)
    async with front:
        echo = Echo(front)
        running = asyncio.create_task(echo.run())
        try:
            yield echo
        finally:
            running.cancel()


def frame(data: bytes, opcode: int = 2, *, fin: bool = True) -> bytes:
    """A client's frame, with a mask of zeros."""
    length = len(data)
    size = bytes([0x80 | length]) if length < 126 else b"\xfe" + length.to_bytes(2, "big")
    if length >= 65536:
        size = b"\xff" + length.to_bytes(8, "big")
    return bytes([0x80 * fin | opcode]) + size + bytes(4) + data


class Raw:
    """A client made of a bare socket, from any address of loopback.

    Its socket blocks in threads, so that this event loop, which is the gateway's, goes on.
    """

    def __init__(self, port: int, address: str = "127.0.0.1", *, receive_bytes: int = 0, send_bytes: int = 0) -> None:
        self.socket = socket.socket()
        if send_bytes:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, send_bytes)
        if receive_bytes:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
        self.socket.bind((address, 0))
        self.socket.settimeout(30)
        self.socket.connect(("127.0.0.1", port))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    async def websocket(self, more: bytes = b""):
        """Ask for the websocket and read the answer."""
        self.send(HANDSHAKE + more + b"\r\n")
        head = b""
        while b"\r\n\r\n" not in head:
            got = await self.receive()
            assert got, head
            head += got
        assert head.startswith(b"HTTP/1.1 101"), head
        return self

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)

    def say(self, data: bytes) -> None:
        self.send(frame(data))

    async def receive(self, size: int = 65536) -> bytes:
        """Return some bytes; b"" when the other end has closed."""
        try:
            return await asyncio.to_thread(self.socket.recv, size)
        except ConnectionError:
            return b""

    async def is_closed(self) -> bool:
        """Read until the other end closes."""
        while await self.receive():
            pass
        return True

    @property
    def is_open(self) -> bool:
        """Whether the other end has not closed, as far as we know."""
        self.socket.setblocking(False)
        try:
            return bool(self.socket.recv(65536))
        except BlockingIOError:
            return True
        except OSError:
            return False
        finally:
            self.socket.settimeout(30)

    def push(self, data: bytes, most_bytes: int) -> int:
        """Send as much of this, again and again, as is taken at once; return how much."""
        self.socket.setblocking(False)
        sent = 0
        try:
            while sent < most_bytes:
                sent += self.socket.send(data)
        except (BlockingIOError, ConnectionError):
            pass
        finally:
            self.socket.settimeout(30)
        return sent

    async def push_on(self, data: bytes, times: int) -> int:
        """Send this again and again whenever some of it is taken, whole; return how much was."""
        self.socket.setblocking(False)
        sent, rest = 0, b""
        with contextlib.suppress(ConnectionError):
            for _ in range(times):
                with contextlib.suppress(BlockingIOError):
                    for _ in range(100):
                        rest = rest or data
                        taken = self.socket.send(rest)
                        rest, sent = rest[taken:], sent + taken
                await asyncio.sleep(0.01)
        self.socket.settimeout(30)
        return sent


def child_of(pid: int, name: str = "phalanx.net.front.serve") -> int:
    """The front end's process."""
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, task.read_text().split()):
            with contextlib.suppress(OSError):
                if name.encode() in Path(f"/proc/{child}/cmdline").read_bytes():
                    return child
    return 0


def the_child() -> int:
    return child_of(os.getpid())


def files_of(pid: int) -> int:
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


def memory_mb(pid: int) -> float:
    (line,) = (each for each in Path(f"/proc/{pid}/status").read_text().splitlines() if each.startswith("VmRSS"))
    return int(line.split()[1]) / 1024
