"""Who has the pin and asks without end keeps neither newcomers nor drivers waiting."""

from __future__ import annotations

import asyncio
import os
import threading
import time

import pytest

from conftest import a_server, eventually
from phalanx.config import LinkConfig
from phalanx.io import Client
from phalanx.io.heads import Standing
from phalanx.io.heard import Heard
from phalanx.io.questions import AT_GATEWAY, FIRST, HELD, HELD_BYTES, PACE, Held, Questions
from phalanx.link import ClientSide, Request, ServerSide, SharedAnswer
from phalanx.link.envelope import encode_envelope, open_envelope, seal
from phalanx.link.replay import ReplayCache
from test_strangers import Stranger

ANSWER_S = 0.005  # of processor time: the list of some hundred robots
PER_S, NEWCOMERS = 200, 6


@pytest.mark.waits
async def test_who_asks_as_ever_new_clients_keeps_no_newcomer_waiting_and_no_command(broker):
    def ask() -> None:
        for question in questions:
            attacker.publish(f"/qrkey/{server.epoch.topic}/request", question)
            if over.wait(1 / PER_S):
                return

    async with a_server(broker) as server:
        answered, over, before = server.counters, threading.Event(), []

        @server.on_request(0)
        def answer(_):
            until_s = time.thread_time() + ANSWER_S
            while time.thread_time() < until_s:
                pass
            return [1, 2]

        await server.wait_connected(10)
        said = [{"request": 0, "reply": f"never-{n}"} for n in range(4000)]
        questions = [seal(encode_envelope(one, time.time()), server.epoch, os.urandom(12)) for one in said]
        async with Client(server.qr()) as driver, Stranger(broker.url.port, 4) as attacker:
            asking = asyncio.create_task(asyncio.to_thread(ask))
            try:
                await asyncio.sleep(2.5)
                for n in range(NEWCOMERS):
                    async with Client(server.qr()) as newcomer:
                        began = answered["requests"]
                        assert await newcomer.request(0, timeout_s=20) == [1, 2]
                        before.append(answered["requests"] - began)
                    assert await driver.command("AB", "move_raw", {"left_y": n}, at_once=True)
            finally:
                over.set()
                await asking
            await asyncio.sleep(0.3)
        assert len(server.heard) == NEWCOMERS
        assert max(before) < 40, f"{before} were answered first"


class Asker:
    """A visitor of the guard, and how often it was its turn to ask."""

    standing = Standing.NEW

    def __init__(self, place: str) -> None:
        self.place, self.held, self.asked = place, Held(), []

    def ask_swarm(self, question: bytes) -> None:
        self.asked.append(question)


class TestQuestions:
    def told(self, tmp_path) -> tuple[Heard, Questions]:
        heard = Heard(tmp_path / "heard")
        heard.tell(1.0, 1.0, 0)
        return heard, Questions(heard)

    async def test_no_more_wait_at_the_gateway_than_it_answers_and_who_asked_little_is_next(self, tmp_path):
        heard, questions = self.told(tmp_path)
        flood, newcomer = Asker("here"), Asker("here")
        flood.standing = Standing.PROVED
        for n in range(300):
            questions.hold(flood, b"%d" % n)
        assert len(flood.asked) == AT_GATEWAY
        questions.hold(newcomer, b"list")
        assert not newcomer.asked
        heard.tell(2.0, 2.0, AT_GATEWAY - 1)
        await eventually(lambda: newcomer.asked)
        assert len(flood.asked) == AT_GATEWAY
        heard.tell(3.0, 3.0, 0)
        await eventually(lambda: len(flood.asked) > AT_GATEWAY)
        assert flood.asked[AT_GATEWAY:] == [b"%d" % n for n in range(300 - HELD, 300)], "the newest are kept"
        assert not (questions._first or questions._others)

    async def test_who_proved_the_pin_and_asks_little_waits_for_no_crowd_of_strangers(self, tmp_path):
        heard, questions = self.told(tmp_path)
        page, strangers = Asker("here"), [Asker(f"place {n}") for n in range(20)]
        page.standing = Standing.PROVED
        for _ in range(int(FIRST[1]) + 1):
            questions.hold(page, b"list")
        heard.tell(2.0, 2.0, AT_GATEWAY)
        for one in (*strangers, page):
            questions.hold(one, b"again")
        heard.tell(3.0, 3.0, AT_GATEWAY - 2)
        await eventually(lambda: page.asked[-1] == b"again")
        assert sum(len(one.asked) for one in strangers) == 1, "nor do they wait for it for ever"

    async def test_where_the_gateway_does_not_say_what_it_can_do_there_are_so_many_a_second(self):
        questions, crowd = Questions(None), [Asker("here") for _ in range(100)]
        for one in crowd:
            questions.hold(one, b"list")
        assert sum(len(one.asked) for one in crowd) < 2 * PACE[1]
        questions.gone(crowd[-1])
        await eventually(lambda: all(one.asked for one in crowd[:-1]))
        assert not crowd[-1].asked

    def test_one_visitors_are_bounded_by_their_bytes_too(self):
        held = Held()
        for n in range(3):
            held.add(b"%d" % n * (HELD_BYTES // 2))
        held.add(bytes(HELD_BYTES + 1))
        assert [held.pop()[:1], held.pop()[:1]] == [b"1", b"2"]
        assert not held

    async def test_whoever_asks_for_the_first_time_is_before_a_crowd_that_asked_a_little_each(self, tmp_path):
        heard, questions = self.told(tmp_path)
        crowd, newcomer = [Asker("here") for _ in range(20)], Asker("here")

        def have_asked(times: int) -> bool:
            heard.tell(time.monotonic(), time.monotonic(), 0)
            return all(len(one.asked) == times for one in crowd)

        for times in range(1, 1 + int(FIRST[1])):
            for one in crowd:
                questions.hold(one, b"list")
            await eventually(lambda times=times: have_asked(times))
        heard.tell(9.0, 9.0, AT_GATEWAY)
        for one in (*crowd, newcomer):
            questions.hold(one, b"again")
        heard.tell(10.0, 10.0, AT_GATEWAY - 1)
        await eventually(lambda: newcomer.asked)
        assert all(len(one.asked) == FIRST[1] for one in crowd)


def test_an_answer_that_is_shared_is_made_once_for_all_who_read_it_alike():
    server = ServerSide(LinkConfig(), os.urandom, 0.0)
    shared, one, other = SharedAnswer([{"n": n} for n in range(2000)]), [], []
    for to, now_s in ((one, 1000.0), (other, 1000.1)):
        client = ClientSide(LinkConfig(), os.urandom, server.epoch.pin, f"client-{now_s:.0f}")
        request = Request(0, client.client_id, {"parts": True})
        for publish in server.reply(request, shared, now_s):
            cache = ReplayCache(1000, 30.0)
            opened = open_envelope(publish.payload, server.epoch, now_s, cache, 1 << 20)
            to.append((opened.timestamp_s, opened.payload))
            said = client.receive(publish.topic, publish.payload, now_s)
        assert said.data == shared.data
    assert one == other, "by its time too"
    whole = Request(0, "older", {})
    assert len(server.reply(whole, shared, 1000.0)) == 1 < len(one)
