"""A crowd at the visitors' page: robots are driven as before."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import sys
import time
from statistics import median, quantiles

import pytest

from conftest import Turns, a_server, as_the_gateway, eventually
from phalanx.errors import Overrun
from phalanx.gateway import Gateway
from phalanx.gateway.serve_pages import PAGES, VISITOR_POLICY
from phalanx.io import Client, Server, children
from phalanx.io.answers import WAITING, WAITING_BYTES, Answers
from phalanx.io.site import page_apart
from phalanx.link import Request
from phalanx.link.envelope import encode_envelope, seal
from phalanx.sim import Dotbots
from test_cli_up import children_of
from test_guard_floods import aside
from test_strangers import processor_s

CROWD = """
import resource, socket, sys, time
resource.setrlimit(resource.RLIMIT_NOFILE, (2048, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
port, path = int(sys.argv[1]), sys.argv[2]
def come():
    one = socket.socket()
    one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    one.settimeout(20)
    one.connect(("127.0.0.1", port))
    one.send(b"GET %s HTTP/1.1\\r\\nHost: x\\r\\n\\r\\n" % path.encode())
    return one
crowd = [come() for _ in range(1000)]
print("all there", flush=True)
for one in crowd[500:]:  # the others never read
    while len(one.recv(65536)) == 65536:
        pass
time.sleep(60)
"""


def a_page_apart():
    return page_apart(PAGES / "visitor", VISITOR_POLICY, "127.0.0.1", 0, connections=1000, if_taken="")


@pytest.mark.alone
@pytest.mark.parametrize("by_the_clock", [False, pytest.param(True, marks=pytest.mark.long)])
async def test_a_thousand_at_the_page_of_whom_half_do_not_read_hold_up_no_joystick(broker, by_the_clock, capsys):
    swarm, driven, said_s = Dotbots(12, 1, time.time), [], {}
    swarm.drive = lambda _, left_pct, right_pct: driven.append(time.monotonic() - said_s[left_pct, right_pct])
    script = max((PAGES / "visitor" / "assets").glob("*.js"), key=lambda path: path.stat().st_size)
    async with (
        Server(broker.gateway, broker_for_visitors=broker.websocket) as server,
        a_page_apart() as page,
    ):
        gateway = asyncio.create_task(Gateway(swarm, server).run())
        await server.wait_connected(10)
        async with Client(server.qr()) as visitor:
            address = swarm.robots()[0].address
            said_s[0, 0] = 0.0
            await visitor.command(address, "move_raw", {"left_y": 0, "right_y": 0})  # the first waits for a frame
            await eventually(lambda: driven)
            driven.clear()
            words = (sys.executable, "-c", CROWD, str(page), f"/assets/{script.name}")
            crowd = await asyncio.create_subprocess_exec(*words, stdout=asyncio.subprocess.PIPE)
            came = asyncio.create_task(crowd.stdout.readline())
            turns, sent = Turns(), 0
            try:
                while not came.done() or sent < 60:
                    sent += 1
                    left, right = sent % 100 + 1, sent // 100
                    said_s[left, right] = time.monotonic()
                    await visitor.command(address, "move_raw", {"left_y": left, "right_y": right})
                    await asyncio.sleep(0.05)
                assert came.result() == b"all there\n"
                await eventually(lambda: len(driven) + server.rejected["late"] >= sent)
                assert turns.longest_s < 0.05
                assert server.rejected["late"] < sent / 10
                if by_the_clock:
                    *_, nearly_all_s = quantiles(driven, n=20)
                    with capsys.disabled():
                        print(
                            f"\n  {len(driven)} moves after {median(driven) * 1e3:.0f} ms, 95 % {nearly_all_s * 1e3:.0f},",
                            end="",
                        )
                        print(f" the longest {max(driven) * 1e3:.0f} ms")
                    assert nearly_all_s < 0.1
            finally:
                with contextlib.suppress(ProcessLookupError):
                    crowd.kill()
                await crowd.communicate()
        gateway.cancel()


@pytest.mark.waits
async def test_who_asks_for_pages_without_end_takes_nothing_of_the_gateways_time_and_a_page_that_hangs_is_served_anew(
    monkeypatch,
):
    monkeypatch.setattr(children, "BEGINS_WITHIN_S", 4.0)  # it may hang before anybody has seen it serve
    others = set(children_of(os.getpid()))  # what other tests fork from
    async with a_page_apart() as port:

        def crowd() -> None:
            asked = b"GET /none HTTP/1.1\r\nHost: x\r\n\r\n" * 100
            crowd = [socket.create_connection(("127.0.0.1", port)) for _ in range(20)]
            while True:
                for one in crowd:
                    one.sendall(asked)
                for one in crowd:
                    told = b""
                    while told.count(b"HTTP/1.1 404") < 100:
                        told += one.recv(1 << 16)

        async def load() -> bytes:
            reading, writing = await asyncio.open_connection("127.0.0.1", port)
            writing.write(b"GET / HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
            try:
                return await reading.read()
            finally:
                writing.close()

        assert b"<script" in await load()
        (page,) = set(children_of(os.getpid())) - others
        with aside(crowd, idle=False):
            used_s, its_s = time.process_time(), processor_s(page)
            await eventually(lambda: processor_s(page) > its_s + 0.4)
            assert b"<script" in await load()
            assert time.process_time() - used_s < 0.1, "a third of a second, when pages were served by a thread"
        os.kill(page, signal.SIGSTOP)
        async with asyncio.timeout(30):
            assert b"<script" in await load()
        assert set(children_of(os.getpid())) - others != {page}
    assert set(children_of(os.getpid())) == others


@pytest.mark.waits
async def test_who_asks_without_end_holds_up_no_command_and_is_answered_a_part_of_the_time(broker):
    async with a_server(broker) as server:
        answered_before, counters = [], server.counters

        @server.on_request(1)
        def answer(_):
            until_s = time.thread_time() + 0.003
            while time.thread_time() < until_s:
                pass

        server.on_command("move_raw")(lambda _: answered_before.append(counters["requests"]))
        await server.wait_connected(10)
        async with as_the_gateway(broker) as visitor:  # for whom no guard waits
            said = [("request", {"request": 1, "reply": f"c{n}"}) for n in range(100)]
            began_s = time.monotonic()
            for sub, payload in (*said, ("command/0000/AB/0/move_raw", {})):
                token = seal(encode_envelope(payload, time.time()), server.epoch, os.urandom(12))
                await visitor.publish(f"/qrkey/{server.epoch.topic}/{sub}", token)
            await eventually(lambda: counters["requests"] == 100)
        assert answered_before[0] < 50, "100, when each waited for the answers before it"
        assert time.monotonic() - began_s > 0.6, "0.3 s of work, and others have the rest"


async def test_of_one_who_asks_again_the_last_is_answered_and_who_is_too_many_is_refused():
    told, asked = [], [Request(0, f"c{n}", {}) for n in range(WAITING)]

    async def answer(request):
        told.append(request)

    answers = Answers(answer)

    def ask(request):
        answers.ask(request.client_id, request.size, request)

    for request in asked:
        ask(request)
    with pytest.raises(Overrun):
        ask(Request(0, "one more", {}))
    ask(again := Request(0, "c0", {"again": True}))
    running = asyncio.create_task(answers.run())
    await eventually(lambda: len(told) == WAITING)
    ask(once_more := Request(0, "one more", {}))
    await eventually(lambda: len(told) > WAITING)
    running.cancel()
    assert told == [again, *asked[1:], once_more]


async def test_requests_wait_by_their_bytes_too_and_give_them_back():
    told = []

    async def answer(request):
        told.append(request)

    answers = Answers(answer)

    def ask(request):
        answers.ask(request.client_id, request.size, request)

    half = WAITING_BYTES // 2
    ask(Request(0, "a", {}, half))
    ask(Request(0, "a", {}, half))  # asked again: instead of the first
    ask(Request(0, "b", {}, half))
    with pytest.raises(Overrun):
        ask(Request(0, "c", {}, 1))
    running = asyncio.create_task(answers.run())
    await eventually(lambda: len(told) == 2)
    ask(Request(0, "c", {}, WAITING_BYTES))
    await eventually(lambda: len(told) == 3)
    running.cancel()
