"""Floods of the real guard: whoever floods competes with itself, and with nobody who says little."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import selectors
import signal
import socket
import time
from collections.abc import Callable, Iterator
from typing import Self

import pytest

from conftest import a_broker, a_server, eventually
from phalanx.io import Client
from phalanx.io.children import die_with_parent
from phalanx.io.guard import Door
from phalanx.io.house import House
from test_guard import frame, hello, many_files, the_guard
from test_strangers import Stranger, connect, with_length

pytestmark = pytest.mark.waits

PUBLISHED = with_length(0x30, b"\x00\x12/qrkey/x/command/1x")


IP_BIND_ADDRESS_NO_PORT = 24


def port_of(broker) -> int:
    """For browsers."""
    return int(broker.websocket.split(":")[2].split("/")[0])


def a_browser(port: int, place: str = "127.0.0.1") -> socket.socket:
    """A connection that has said hello."""
    browser = socket.create_connection(("127.0.0.1", port), 10, (place, 0))
    browser.sendall(hello() + frame(connect(4, os.urandom(8).hex().encode())))
    return browser


@contextlib.contextmanager
def aside(work: Callable[[], None], *, idle: bool = True) -> Iterator[Callable[[], bool]]:
    """`work` is done in a process of its own, on what others leave of the processor, until the context is left.

    In this one it would hold up the gateway, and whoever computes beside it. Where a test ends when it has done so much
    it is not `idle`, for a busy machine leaves that nothing. Yields whether it still works.
    """
    pid, ended = os.fork(), []
    if not pid:
        try:
            die_with_parent()
            os.nice(10)
            if idle:
                os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
            work()
        finally:
            os._exit(0)

    def works() -> bool:
        if not ended and os.waitpid(pid, os.WNOHANG) != (0, 0):
            ended.append(True)
        return not ended

    try:
        yield works
    finally:
        if works():
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)


class Flood:
    """Connections that each say the same again and again, as long as the context lasts.

    Args:
        per_s: how often, of each; else as often as it is read.
        idle: on what others leave of the processor.
    """

    def __init__(self, said: bytes, per_s: float = 0.0, *, idle: bool = True) -> None:
        self._said, self._every_s = said, 1 / per_s if per_s else 0.0
        self._idle = idle
        self._crowd: list[socket.socket] = []
        self._here = contextlib.ExitStack()
        self._works = lambda: True

    def add(self, one: socket.socket) -> None:
        one.setblocking(False)
        self._crowd.append(one)

    @property
    def is_there(self) -> bool:
        """Whether not all of them were hung up on."""
        return self._works()

    def _flood(self) -> None:
        crowd = selectors.DefaultSelector()
        for one in self._crowd:
            crowd.register(one, selectors.EVENT_WRITE, (time.monotonic(), b""))
        while crowd.get_map():
            now_s = time.monotonic()
            for key, _ in crowd.select(0.1):
                due_s, rest = key.data
                if not rest and due_s > now_s:
                    continue
                try:
                    rest = rest or self._said
                    rest = rest[key.fileobj.send(rest) :]
                    due_s = now_s if rest else now_s + self._every_s
                    crowd.modify(key.fileobj, selectors.EVENT_WRITE, (due_s, rest))
                except BlockingIOError:
                    pass
                except OSError:
                    crowd.unregister(key.fileobj)
            if self._every_s:
                time.sleep(0.002)  # or it would spin where none is due

    def __enter__(self) -> Self:
        self._works = self._here.enter_context(aside(self._flood, idle=self._idle))
        for one in self._crowd:
            one.close()
        return self

    def __exit__(self, *_: object) -> None:
        self._here.close()


async def test_small_frames_without_end_hold_up_no_answer_and_no_route_and_end_no_guard():
    with many_files():
        async with a_broker() as broker, a_server(broker) as server:
            await server.wait_connected(10)
            guard, port = the_guard(broker), port_of(broker)
            flood = Flood(frame(b"", 9) * 400)
            async with Client(server.qr()) as client:
                for _ in range(150):
                    flood.add(await asyncio.to_thread(a_browser, port))
                with flood:
                    await asyncio.sleep(1)
                    for n in range(20):  # of an honest program
                        way = [{"x": 1000 + n, "y": 2000 + i} for i in range(64)]
                        assert await client.command("AB", "waypoints", {"threshold": 50, "waypoints": way})
                    for _ in range(20):
                        assert await client.request(0)
                assert client._link.reconnects == 0
                assert len(server.heard) >= 10, "some may wait for too long on a busy machine"
            assert the_guard(broker) == guard


async def test_eighty_of_one_address_who_stay_below_what_one_may_say_lose_nobody_else_a_word():
    with many_files():
        async with a_broker() as broker, a_server(broker) as server:
            await server.wait_connected(10)
            flood = Flood(PUBLISHED * 10, 38)
            async with Client(server.qr()) as client:
                for name in range(80):
                    one = await Stranger(broker.url.port, 4, name=b"flood%d" % name).__aenter__()
                    one.socket.sendall(PUBLISHED)
                    flood.add(one.socket)
                await asyncio.sleep(1)  # so that they said little lately
                with flood:
                    await asyncio.sleep(0.5)
                    for n in range(50):
                        await client.command("AB", "move_raw", {"left_x": 0, "left_y": n, "right_x": 0, "right_y": 0})
                        await asyncio.sleep(0.04)
                    assert await client.request(0)
                assert len(server.heard) >= 45, "a third was lost"
                assert client._link.reconnects == 0


async def test_thousands_who_say_hello_and_go_keep_nobody_out_and_end_no_guard():
    def come_and_go() -> None:
        began_s = time.monotonic()
        for n in itertools.count():
            while n > (time.monotonic() - began_s) * 3600:
                time.sleep(0.001)
            with contextlib.suppress(OSError), socket.socket() as one:
                one.setsockopt(socket.IPPROTO_IP, IP_BIND_ADDRESS_NO_PORT, 1)
                one.bind(("127.0.0.7", 0))
                one.connect(("127.0.0.1", broker.url.port))
                one.sendall(connect(4, b"x"))

    async with a_broker() as broker, a_server(broker) as server:
        await server.wait_connected(10)
        guard = the_guard(broker)
        with aside(come_and_go):
            await asyncio.sleep(1)
            async with Client(server.qr()) as client:
                for n in range(10):
                    with await asyncio.to_thread(a_browser, port_of(broker), "127.0.0.7") as late:
                        late.settimeout(5)
                        heard = b""
                        while b"\x20\x02\x00\x00" not in heard:  # CONNACK
                            heard += (more := await asyncio.to_thread(late.recv, 500))
                            assert more, "hung up"
                    await client.command("AB", "move_raw", {"left_x": 0, "left_y": n, "right_x": 0, "right_y": 0})
                    assert await client.request(0, timeout_s=5)
            assert len(server.heard) == 10
            assert the_guard(broker) == guard


async def test_forty_who_say_what_they_can_are_hung_up_on_and_others_have_their_answers():
    flood = Flood(with_length(0x30, b"\x00\x12/qrkey/x/command/1" + bytes(400)) * 20, idle=False)
    with many_files():
        async with a_broker() as broker, a_server(broker) as server:
            await server.wait_connected(10)
            for name in range(40):
                flood.add((await Stranger(broker.url.port, 4, name=b"flood%d" % name).__aenter__()).socket)
            with flood:
                async with Client(server.qr()) as client:
                    for _ in range(20):
                        assert await client.request(0)
                        await asyncio.sleep(0.05)
                await eventually(lambda: not flood.is_there, 60)


async def test_whoever_has_gone_before_its_turn_is_no_work_for_the_broker(tmp_path):
    asked: list[bytes] = []

    async def broker(reading: asyncio.StreamReader, writing: asyncio.StreamWriter) -> None:
        asked.append(await reading.read(100))
        writing.close()

    house = House(str(tmp_path / "broker"), 1000)
    with socket.create_server(("127.0.0.1", 0), backlog=1024) as listening:
        async with await asyncio.start_unix_server(broker, house.broker):
            for _ in range(500):
                with socket.create_connection(listening.getsockname()) as one:
                    one.sendall(connect(4, b"gone"))
            with socket.create_connection(listening.getsockname()) as late:
                late.sendall(connect(4, keepalive_s=77))
                Door(house, listening, browser=False).open()
                await eventually(lambda: asked)
                asyncio.get_running_loop().remove_reader(listening)
                await eventually(lambda: not len(house))
    assert [each[10:12] for each in asked] == [b"\x00\x4d"]
