"""What held from the beginning, in the first numbers: 48 000, 200 000, 3000 and three. It tells what it measures."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import random
import signal
import socket
import threading
import time
from collections import Counter
from pathlib import Path

import aiomqtt
import pytest

from conftest import a_gateway, bare_mosquitto, eventually
from machine import many_files, memory_mb
from phalanx.config import LinkConfig
from phalanx.io import Client
from phalanx.link import ClientSide, Pin, ServerSide, derive_epoch
from phalanx.link.envelope import encode_envelope, seal
from phalanx.link.messages import Command
from phalanx.link.topics import CommandTopic
from ports import free_port
from test_cli_up import children_of
from test_load import state_of
from test_server_hostile import hostile

pytestmark = [pytest.mark.long, pytest.mark.waits, pytest.mark.timeout(300)]

GARBAGE, ENTRIES, SLOW, KILLS = 48_000, 200_000, 3000, 3


class Driver:
    """A visitor that drives ten times a second and asks once a second, and how that went."""

    def __init__(self, ready: dict) -> None:
        self.sent, self.answers_s = 0, []
        self._client = Client(ready["qr_url"], timeout_s=30)

    async def __aenter__(self):
        await self._client.__aenter__()
        robots = await self._client.request(0, frames=True, timeout_s=30)
        self._address = robots[0]["address"]
        self._jobs = [asyncio.create_task(self._drive()), asyncio.create_task(self._ask())]
        return self

    async def __aexit__(self, *error):
        for job in self._jobs:
            job.cancel()
        await asyncio.wait(self._jobs)
        await self._client.__aexit__(*error)

    async def _drive(self):
        for n in itertools.count():
            wheels = {"left_x": 0, "left_y": 40, "right_x": 0, "right_y": n % 50 + 1}
            self.sent += await self._client.command(self._address, "move_raw", wheels)
            await asyncio.sleep(0.1)

    async def _ask(self):
        while True:
            began = time.monotonic()
            await self._client.request(1, timeout_s=30, frames=True)
            self.answers_s.append(time.monotonic() - began)
            await asyncio.sleep(1)


def told(capsys, words: str) -> None:
    with capsys.disabled():
        print(f"\n  {words}")


async def test_forty_eight_thousand_garbage_messages_are_counted_and_fill_nothing_and_then_all_is_as_before(
    tmp_path, capsys
):
    tcp, ws = free_port(), free_port()
    chance = random.Random(48)
    with bare_mosquitto(tcp, ws, tmp_path, "allow_anonymous true", "max_queued_messages 0") as (start, _):
        start()
        where = ("--broker", f"mqtt://127.0.0.1:{tcp}", "--broker-ws", f"ws://127.0.0.1:{ws}/mqtt")
        with a_gateway("--robots", "4", *where) as (up, ready):

            def obeyed() -> int:
                return len([event for event in up.events("command") if event["name"] == "move_raw"])

            epoch = derive_epoch(Pin(ready["pin"]))
            good = seal(encode_envelope({"left_y": 1}, time.time()), epoch, os.urandom(12))
            before_mb, began = memory_mb(up.process.pid), time.monotonic()
            async with Driver(ready) as driver:
                async with aiomqtt.Client("127.0.0.1", tcp) as attacker:
                    for i in range(GARBAGE):
                        await attacker.publish(*hostile(chance, f"/qrkey/{epoch.topic}", good, epoch, i))
                took_s, moves = time.monotonic() - began, (driver.sent, obeyed())
                await eventually(lambda: sum(state_of(ready)["rejected"].values()) >= GARBAGE, 30, 0.5)
                rejected, answers = state_of(ready)["rejected"], len(driver.answers_s)
                before = driver.sent, obeyed()
                await asyncio.sleep(5)
                after = driver.sent - before[0], obeyed() - before[1]
            grown_mb = memory_mb(up.process.pid) - before_mb
            told(capsys, f"{GARBAGE} in {took_s:.1f} s: {rejected}, {grown_mb:+.1f} MB; moves (said, obeyed) {moves}")
            told(
                capsys,
                f"answers within {max(driver.answers_s):.2f} s; afterwards moves {after}, {driver.answers_s[answers:]}",
            )
            assert after[1] >= 0.8 * after[0]
            assert max(driver.answers_s[answers + 1 :]) < 1
            assert grown_mb < 100
            assert not up.err


def test_two_hundred_thousand_entries_fit_the_replay_cache_and_no_flood_brings_more(capsys):
    """Pure: the time is an argument. 65 s of a visitor's flood, dated so that each message is kept for longest."""
    config = LinkConfig()
    server = ServerSide(config, os.urandom, 0.0)
    flood = ClientSide(config, os.urandom, server.epoch.pin, "one")
    move, now_s, took, kept, most = CommandTopic("AB", "0", "move_raw"), 1_700_000_000.0, [], [], 0
    before_mb = memory_mb(os.getpid())
    for tick in range(650):
        now_s += 0.1
        for n in range(400 if tick else 30_000):
            publish = flood.command(move, n, now_s + 29.9)
            began = time.process_time()
            said = server.receive(publish.topic, publish.payload, now_s, 0.0)
            took.append(time.process_time() - began)
            if isinstance(said, Command) and n % 100 == 0:
                kept.append(publish)
        most = max(most, len(server._cache))
    grown_mb = memory_mb(os.getpid()) - before_mb
    again = Counter(server.receive(one.topic, one.payload, now_s, 0.0).reason for one in kept[-len(kept) // 2 :])
    told(
        capsys, f"{most} entries of {len(took)} messages, {grown_mb:+.0f} MB, the longest took {1e3 * max(took):.1f} ms"
    )
    assert 0.95 * ENTRIES < most <= ENTRIES
    assert set(again) == {"replayed"}
    assert max(took) < 0.1
    now_s += 0.01
    publish = flood.command(move, 0, now_s)
    assert isinstance(server.receive(publish.topic, publish.payload, now_s, 0.0), Command)


class Slow:
    """Connections that each begin something and go on with a byte a second, never to end it."""

    def __init__(self, port: int, count: int, begun: bytes) -> None:
        self._over = threading.Event()
        self.crowd, self.lost = [], 0
        for n in range(count):
            one = socket.socket()
            one.setsockopt(socket.IPPROTO_IP, 24, 1)  # IP_BIND_ADDRESS_NO_PORT
            one.bind((f"127.0.{n % 10}.{1 + n % 100}", 0))
            one.connect(("127.0.0.1", port))
            one.sendall(begun)
            self.crowd.append(one)
        self._thread = threading.Thread(target=self._go_on)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *error):
        self._over.set()
        self._thread.join()
        for one in self.crowd:
            one.close()

    def _go_on(self):
        while not self._over.wait(1.0):
            left = []
            for one in self.crowd:
                try:
                    one.send(b"x")
                    left.append(one)
                except OSError:
                    self.lost += 1
                    one.close()
            self.crowd = left


async def test_three_thousand_half_open_headers_keep_nobody_out_who_comes_from_elsewhere(capsys):
    with many_files(), a_gateway("--robots", "4") as (up, ready):
        page = int(ready["page_url"].rstrip("/").rsplit(":", 1)[1])
        begun = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: "
        loads_s = []

        def load() -> None:
            began = time.monotonic()
            with socket.create_connection(("127.0.0.1", page), 20, ("127.0.200.1", 0)) as one:
                one.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
                assert one.recv(100).startswith(b"HTTP/1.1 200")
            loads_s.append(time.monotonic() - began)

        before_mb = memory_mb(up.process.pid)
        async with Driver(ready) as driver:
            with await asyncio.to_thread(Slow, page, SLOW, begun) as slow:
                before = driver.sent
                for _ in range(10):
                    await asyncio.to_thread(load)
                    async with Client(ready["qr_url"], timeout_s=10) as late:
                        await late.request(1, frames=True)
                    await asyncio.sleep(1)
                there = len(slow.crowd)
                await asyncio.sleep(0.5)
            sent = driver.sent
        obeyed = len([event for event in up.events("command") if event["name"] == "move_raw"])
        words = f"{there} of {SLOW} still there; {obeyed} of {sent} moves obeyed, {sent - before} in it"
        told(capsys, f"{words}, answers within {max(driver.answers_s):.2f} s, page within {max(loads_s):.2f} s")
        told(capsys, f"{memory_mb(up.process.pid) - before_mb:+.1f} MB, {state_of(ready)['rejected']}")
        assert obeyed >= 0.9 * sent
        assert max(*driver.answers_s, *loads_s) < 2
        assert not [line for line in up.err if "Traceback" in line]


async def test_rotations_under_three_kills_of_the_broker_lose_no_visitor(capsys):
    with a_gateway("--robots", "4", "--rotate-s", "14", "--overlap-s", "6") as (up, ready):

        def rotations() -> int:
            return len(up.events("rotation"))

        async with contextlib.AsyncExitStack() as stack:
            there = {"broker": f"mqtt://127.0.0.1:{ready['broker_port']}"}
            ways = [{}, there] * 5
            visitors = [await stack.enter_async_context(Client(ready["qr_url"], **way)) for way in ways]
            # Before a new code, just after one, and when an old one ends.
            for after, wait_s in ((0, 11.0), (2, 0.0), (3, 5.5)):
                await eventually(lambda n=after: rotations() >= n, 40)
                await asyncio.sleep(wait_s)
                for pid in children_of(up.process.pid):
                    if "mosquitto" in Path(f"/proc/{pid}/cmdline").read_text().split("\0")[0]:
                        os.kill(pid, signal.SIGKILL)
            await eventually(lambda: rotations() >= 4, 40)
            newest = up.events("rotation")[-1]["topic"]
            await eventually(lambda: all(one.epoch_topic == newest for one in visitors), 10)
            began = time.monotonic()
            await asyncio.gather(*(one.request(1, timeout_s=10, frames=True) for one in visitors))
            told(capsys, f"10 of 10 answered in {time.monotonic() - began:.2f} s, {state_of(ready)['counters']}")
            assert state_of(ready)["counters"]["reconnects"] == KILLS
            assert [one.moves for one in visitors] == [rotations()] * 10
