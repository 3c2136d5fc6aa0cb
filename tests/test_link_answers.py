"""Requests wait for their answers, and hold up no command meanwhile."""

from __future__ import annotations

import asyncio
import os
import time

import pytest

from brokers import a_server, somebody
from phalanx.config import LinkConfig
from phalanx.errors import Overrun
from phalanx.link import ClientSide, Request, ServerSide, SharedAnswer
from phalanx.link.envelope import encode_envelope, open_envelope, seal
from phalanx.link.replay import ReplayCache
from phalanx.net.answers import WAITING, WAITING_BYTES, Answers
from waiting import eventually


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
        async with somebody(broker) as visitor:
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


def test_an_answer_that_is_shared_is_made_once_for_all():
    server = ServerSide(LinkConfig(), os.urandom, 0.0)
    shared, one, other = SharedAnswer([{"n": n} for n in range(2000)]), [], []
    for to, now_s in ((one, 1000.0), (other, 1000.1)):
        client = ClientSide(LinkConfig(), os.urandom, server.epoch.pin, f"client-{now_s:.0f}")
        request = Request(0, client.client_id, {})
        for publish in server.reply(request, shared, now_s):
            cache = ReplayCache(1000, 30.0)
            opened = open_envelope(publish.payload, server.epoch, now_s, cache, 1 << 20)
            to.append((opened.timestamp_s, opened.payload))
            said = client.receive(publish.topic, publish.payload, now_s)
        assert said.data == shared.data
    assert one == other, "by its time too"
