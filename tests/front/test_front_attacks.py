"""What strangers and visitors do to the front end by bare sockets: what is closed, what waits, and who is served."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import socket

import aiohttp
import pytest

from front_world import HANDSHAKE, Raw, echoing, files_of, frame, memory_mb, the_child
from phalanx.net.front import Closed, Opened, Received

pytestmark = pytest.mark.waits

LONG_S = 300.0  # longer than any test
NEVER = 1e-9  # per second


@contextlib.contextmanager
def closing(sockets):
    try:
        yield sockets
    finally:
        for each in sockets:
            each.socket.close()


async def driver(echo, address="127.0.0.1", **how) -> Raw:
    """A visitor that is admitted."""
    client = await Raw(echo.front.port, address, **how).websocket()
    before = len(echo.told)
    client.say(b"hello")
    await echo.eventually(lambda: any(isinstance(each, Received) for each in echo.told[before:]))
    return client


class TestWhoSaysNothing:
    async def test_half_open_connections_of_one_address_push_out_each_other_and_nobody_else(self, pages):
        limits = {"newcomers_max_per_address": 10, "head_s": LONG_S, "first_message_s": LONG_S, "cost_of_silence": 0.01}
        async with echoing(pages, **limits) as echo:
            with closing([await driver(echo)]):
                before = files_of(the_child())
                quiet = Raw(echo.front.port)
                crowd = [Raw(echo.front.port, "127.0.0.9") for _ in range(60)]
                for n, each in enumerate(crowd):
                    each.push((b"", HANDSHAKE[:60], HANDSHAKE + b"\r\n")[n % 3] or b"G", 1)
                with closing([quiet, *crowd]):
                    await echo.eventually(lambda: files_of(the_child()) == before + 1 + 10)
                    assert quiet.is_open
                    (await driver(echo)).socket.close()
                    await echo.eventually(lambda: sum(isinstance(each, Opened) for each in echo.told) == 2)

    async def test_who_goes_no_further_is_closed_and_the_gateway_never_hears_of_it(self, pages):
        async with echoing(pages, head_s=0.3, first_message_s=0.3) as echo:
            for said in (b"", b"G", HANDSHAKE[:60], HANDSHAKE + b"\r\n", HANDSHAKE + b"\r\n" + b"\x82\xfe"):
                with Raw(echo.front.port) as client:
                    client.send(said)
                    assert await client.is_closed(), said
            assert not echo.told

    async def test_who_is_never_admitted_is_closed_and_who_is_may_be_silent(self, pages):
        async with echoing(pages, admission_s=0.5, head_s=0.2, first_message_s=0.2) as echo:
            with closing([await driver(echo)]) as (admitted,):
                echo.admits = False
                with closing([await driver(echo)]) as (other,):
                    assert await other.is_closed()
                await echo.eventually(lambda: Closed(2) in echo.told)
                assert admitted.socket.recv(3, 0) == b"\x82\x05h", "its echo"
                assert echo.open() == {1}

    async def test_an_endless_head_is_hung_up_on(self, pages):
        async with echoing(pages) as echo:
            with Raw(echo.front.port) as client:
                assert client.push(b"GET /link HTTP/1.1\r\n" + b"a" * 4000, 50_000_000) < 50_000_000
                assert await client.is_closed()

    async def test_when_all_seats_are_taken_strangers_go_before_visitors(self, pages):
        async with echoing(pages, connections_max=8, head_s=LONG_S, newcomers_max_per_address=100) as echo:
            here = [await driver(echo) for _ in range(4)]
            with closing(here), closing([Raw(echo.front.port, "127.0.0.9") for _ in range(20)]) as crowd:
                await echo.eventually(lambda: sum(each.is_open for each in crowd) <= 4)
                for each in here:
                    each.say(b"still here")
                await echo.eventually(lambda: sum(echo.heard().values()) == 8)


class TestWhoSaysMuch:
    async def test_a_newcomer_has_one_message_until_it_is_answered(self, pages):
        async with echoing(pages) as echo:
            echo.admits = echo.answers = False
            with Raw(echo.front.port) as client:
                await client.websocket()
                for n in range(5):
                    client.say(bytes([n]))
                await echo.eventually(lambda: echo.heard()[1] == 1)
                (await driver(echo)).socket.close()
                assert echo.heard()[1] == 1
                echo.front.send(1, b"answer")
                await echo.eventually(lambda: echo.heard()[1] == 2)
                echo.front.admitted(1)
                await echo.eventually(lambda: echo.heard()[1] == 5)

    async def test_a_message_too_long_closes_its_connection_alone(self, pages):
        async with echoing(pages, message_bytes=2000, newcomer_message_bytes=100) as echo:
            with closing([await driver(echo)]) as (client,):
                client.say(bytes(2000))
                await echo.eventually(lambda: Received(1, bytes(2000)) in echo.told)
                client.say(bytes(2001))
                assert await client.is_closed()
            with Raw(echo.front.port) as new:
                (await new.websocket()).say(bytes(101))
                assert await new.is_closed()
            with Raw(echo.front.port) as pieces:
                await pieces.websocket()
                pieces.send(frame(bytes(90), fin=False) + frame(bytes(90), 0))
                assert await pieces.is_closed()
            await echo.eventually(lambda: Closed(1) in echo.told)
            assert echo.heard() == {1: 2}

    @pytest.mark.parametrize("size", [0, 1000])
    async def test_who_exceeds_its_rate_is_read_no_further_and_tcp_holds_it_back(self, pages, size):
        async with echoing(pages, messages_per_s=NEVER, messages_at_once=10.0) as echo:
            with closing([await driver(echo, send_bytes=65536)]) as (loud,), closing([await driver(echo)]) as (quiet,):
                before = memory_mb(the_child())
                sent = await loud.push_on(frame(bytes(size)) * 16, 200)
                assert sent < 500_000, "taken in, here or by the system"
                assert echo.heard()[1] == 10
                assert memory_mb(the_child()) < before + 5
                quiet.say(b"me too")
                await echo.eventually(lambda: echo.heard()[2] == 2)

    async def test_who_breaks_the_protocol_meanwhile_is_closed_and_its_bytes_are_not_read(self, pages):
        async with echoing(pages, messages_per_s=NEVER, messages_at_once=10.0) as echo:
            with closing([await driver(echo, send_bytes=65536)]) as (loud,):
                loud.send(frame(b"x") * 9)
                await echo.eventually(lambda: echo.heard()[1] == 10)
                loud.send(b"\xff" * 100)
                assert await loud.push_on(b"\xff" * 16_000, 200) < 500_000
                await echo.eventually(lambda: Closed(1) in echo.told)

    async def test_a_message_that_waits_for_its_rate_does_not_follow_the_end_of_its_connection(self, pages):
        async with echoing(pages, messages_per_s=2.0, messages_at_once=2.0) as echo:
            client = await driver(echo)
            for _ in range(3):
                client.say(b"late")
            await echo.eventually(lambda: echo.heard()[1] == 2)
            client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, bytes([1, 0, 0, 0, 0, 0, 0, 0]))
            client.socket.close()
            await echo.eventually(lambda: Closed(1) in echo.told)
            with closing([await driver(echo)]) as (other,):
                other.say(b"after it")
                other.say(b"after that")
                await echo.eventually(lambda: echo.heard()[2] == 3)
            assert echo.front.restarts == 0, "what no honest front end sends"

    async def test_a_newcomer_that_waits_for_its_answer_is_held_back_too(self, pages):
        async with echoing(pages, admission_s=LONG_S, messages_at_once=1e9, bytes_at_once=1e9) as echo:
            echo.admits = echo.answers = False
            with closing([await driver(echo, send_bytes=65536)]) as (loud,):
                assert await loud.push_on(frame(bytes(1000)) * 16, 200) < 500_000
                assert echo.heard()[1] == 1

    @pytest.mark.parametrize("opcode", [9, 10])
    async def test_pings_and_pongs_count_as_messages(self, pages, opcode):
        async with echoing(pages, messages_per_s=NEVER, messages_at_once=10.0) as echo:
            with closing([await driver(echo)]) as (client,):
                client.send(frame(b"x", opcode) * 9)
                client.say(b"one too many")
                with closing([await driver(echo)]) as (other,):
                    other.say(b"after it")
                    await echo.eventually(lambda: echo.heard()[2] == 2)
                assert echo.heard()[1] == 1

    async def test_bytes_are_limited_as_well(self, pages):
        limits = {"bytes_per_s": NEVER, "bytes_at_once": 20_000.0, "messages_at_once": 1000.0}
        async with echoing(pages, **limits) as echo:
            with closing([await driver(echo)]) as (client,):
                for _ in range(40):
                    client.push(frame(bytes(1000)), 1)
                await echo.eventually(lambda: echo.heard()[1] >= 20)
                (await driver(echo)).socket.close()
                assert echo.heard()[1] == 21

    async def test_a_gateway_that_does_not_read_is_not_flooded_and_then_all_have_their_turn(self, pages):
        limits = {"in_flight": 16, "messages_at_once": 1000.0, "messages_per_s": 1000.0}
        async with echoing(pages, **limits) as echo:
            echo.answers = False
            loud, quiet = await driver(echo), await driver(echo)
            with closing([loud, quiet]):
                echo.reads.clear()
                for n in range(100):
                    loud.say(bytes([n]))
                for _ in range(50):
                    await asyncio.sleep(0.01)
                quiet.say(b"quiet")
                for _ in range(50):
                    await asyncio.sleep(0.01)
                under_way = len(echo.front._events)
                assert under_way <= 12, "in flight, without those of newcomers"
                before = len(echo.told)
                echo.reads.set()
                await echo.eventually(lambda: Received(2, b"quiet") in echo.told)
                rest = [each.connection for each in echo.told[before:]]
                assert rest.index(2) <= 16, "it waited for what was under way and one turn, not for a hundred"
                await echo.eventually(lambda: echo.heard()[1] == 101)
                said = [each.data for each in echo.told if isinstance(each, Received) and each.connection == 1]
                assert said[1:] == [bytes([n]) for n in range(100)], "in order"


class TestWhoReadsNothing:
    async def test_it_misses_updates_and_others_do_not(self, pages):
        async with echoing(pages) as echo, aiohttp.ClientSession() as session:
            with Raw(echo.front.port, receive_bytes=4096) as slow:
                (await slow.websocket()).say(b"hello")
                async with session.ws_connect(f"http://127.0.0.1:{echo.front.port}/link") as reader:
                    await reader.send_bytes(b"hello")
                    await reader.receive_bytes(timeout=30)
                    await echo.eventually(lambda: echo.open() == {1, 2})
                    for n in range(300):
                        echo.front.publish([1, 2], n.to_bytes(2, "big") * 1000)
                        assert await reader.receive_bytes(timeout=30) == n.to_bytes(2, "big") * 1000
                got = b""
                slow.socket.settimeout(1)
                with contextlib.suppress(TimeoutError):
                    while more := await asyncio.to_thread(slow.socket.recv, 65536):
                        got += more
                assert got
                assert len(got) < 300 * 2000 / 2, "no queue of updates"

    async def test_who_does_not_take_its_own_messages_is_closed(self, pages):
        async with echoing(pages, unread_s=0.5) as echo:
            with Raw(echo.front.port, receive_bytes=4096) as slow:
                (await slow.websocket()).say(b"hello")
                with closing([await driver(echo)]) as (other,):
                    echo.front.send(1, bytes(1_000_000))
                    await echo.eventually(lambda: Closed(1) in echo.told)
                    other.say(b"still here")
                    await echo.eventually(lambda: echo.heard()[2] == 2)

    async def test_who_takes_a_long_one_slowly_is_not(self, pages):
        async with echoing(pages, unread_s=1.0) as echo:
            with Raw(echo.front.port, receive_bytes=4096) as slow:
                (await slow.websocket()).say(b"hello")
                await echo.eventually(lambda: echo.open() == {1})
                echo.front.send(1, bytes(400_000))
                got = 0
                while got < 400_000:
                    got += len(await slow.receive(10_000))
                    await asyncio.sleep(0.1)
                assert echo.open() == {1}

    async def test_what_waits_for_one_is_limited(self, pages):
        async with echoing(pages, unsent_bytes=500_000, unread_s=LONG_S) as echo:
            with Raw(echo.front.port, receive_bytes=4096) as slow:
                (await slow.websocket()).say(b"hello")
                await echo.eventually(lambda: echo.open() == {1})
                for _ in range(20):
                    echo.front.send(1, bytes(100_000))
                await echo.eventually(lambda: Closed(1) in echo.told)

    async def test_what_waits_for_all_is_limited_and_who_has_most_goes_first(self, pages):
        async with echoing(pages, unsent_bytes_in_all=500_000, unread_s=LONG_S) as echo:
            slow = [Raw(echo.front.port, receive_bytes=4096) for _ in range(5)]
            with closing(slow):
                for n, each in enumerate(slow, 1):
                    (await each.websocket()).say(b"hello")
                    await echo.eventually(lambda n=n: echo.heard()[n] == 1)
                for n in range(1, 5):
                    echo.front.send(n, bytes(400_000))
                echo.front.send(5, bytes(100_000))
                await echo.eventually(lambda: len(echo.open()) <= 2)
                assert 5 in echo.open()


class TestCrowds:
    async def test_fifty_phones_behind_one_router_all_get_in_at_once(self, pages):
        async def phone(session) -> bool:
            async with contextlib.AsyncExitStack() as stack:
                for _ in range(4):
                    page = await stack.enter_async_context(session.get(f"http://127.0.0.1:{echo.front.port}/"))
                    assert page.status == 200
                websocket = await session.ws_connect(f"http://127.0.0.1:{echo.front.port}/link")
                await websocket.send_bytes(b"hello")
                return await websocket.receive_bytes(timeout=60) == b"hello"

        async with echoing(pages) as echo:
            connector = aiohttp.TCPConnector(limit=0, force_close=True)
            async with aiohttp.ClientSession(connector=connector) as session:
                assert all(await asyncio.gather(*(phone(session) for _ in range(50))))
                assert sum(isinstance(each, Opened) for each in echo.told) == 50

    async def test_hundreds_from_one_address_wait_for_each_other_and_nobody_for_them(self, pages):
        # Whose turn it is shows in the order in which the gateway hears of them.
        async with echoing(pages, arrivals_per_s=40.0) as echo:
            crowd = [Raw(echo.front.port, "127.0.0.9") for _ in range(200)]
            with closing(crowd):
                for each in crowd:
                    each.send(HANDSHAKE + b"\r\n" + frame(b"crowd"))
                with closing([await driver(echo, "127.0.0.1")]):
                    await echo.eventually(
                        lambda: any(getattr(each, "address", "") == "127.0.0.1" for each in echo.told)
                    )
                    assert sum(isinstance(each, Opened) for each in echo.told) < 150
                await echo.eventually(lambda: sum(isinstance(each, Opened) for each in echo.told) == 201)

    async def test_an_address_whose_connections_come_to_nothing_has_fewer_and_an_admission_gives_back(self, pages):
        limits = {"arrivals_per_s_per_address": NEVER, "arrivals_at_once_per_address": 20.0, "head_s": 0.2}
        async with echoing(pages, **limits, cost_of_silence=5.0, given_back=2.0) as echo:
            for _ in range(30):
                (await driver(echo, "127.0.0.5")).socket.close()
            silent = [Raw(echo.front.port, "127.0.0.9") for _ in range(3)]
            with closing(silent):
                for each in silent:
                    assert await each.is_closed()
            with closing([Raw(echo.front.port, "127.0.0.9") for _ in range(4)]) as more:
                for each in more:
                    each.send(HANDSHAKE + b"\r\n" + frame(b"late"))
                (await driver(echo, "127.0.0.5")).socket.close()
                assert Opened(31, "127.0.0.9") in echo.told
                assert (
                    sum(each == Opened(each.connection, "127.0.0.9") for each in echo.told if isinstance(each, Opened))
                    <= 2
                )

    async def test_requests_without_end_wait_for_each_other_and_nobody_for_them(self, pages):
        limits = {"requests_per_s": 200.0, "requests_per_s_per_address": NEVER, "requests_at_once_per_address": 30.0}
        async with echoing(pages, **limits) as echo:
            with Raw(echo.front.port, "127.0.0.9") as greedy:
                greedy.push(b"GET / HTTP/1.1\r\nHost: us\r\n\r\n" * 100, 1)
                answers = b""
                greedy.socket.settimeout(2)
                with contextlib.suppress(TimeoutError):
                    while more := await asyncio.to_thread(greedy.socket.recv, 65536):
                        answers += more
                assert answers.count(b"200 OK") == 30
                (await driver(echo)).socket.close()

    async def test_garbage_of_many_kinds_raises_nothing_and_tells_the_gateway_nothing(self, pages, caplog):
        garbage = (
            b"\x00" * 100,
            b"\x16\x03\x01\x02\x00\x01",
            b"GET / HTTP/9.9\r\n\r\n",
            b"BREW /link HTTP/1.1\r\nHost: us\r\n\r\n",
            b"GET /link HTTP/1.1\r\nHost: us\r\nUpgrade: websocket\r\n\r\n",
            b"POST / HTTP/1.1\r\nHost: us\r\nContent-Length: 99999999\r\n\r\n" + b"x" * 1000,
            b"GET /../../etc/passwd HTTP/1.1\r\nHost: us\r\n\r\n",
            HANDSHAKE.replace(b"13", b"12") + b"\r\n",
            HANDSHAKE + b"\r\n" + b"\xff" * 100,
            HANDSHAKE + b"\r\n" + frame(b"x" * 126, 9),
            HANDSHAKE + b"\r\n" + frame(b"x", 3),
            HANDSHAKE + b"\r\n" + b"\x82\xff" + b"\xff" * 12,
        )
        async with echoing(pages, head_s=0.5, first_message_s=0.5) as echo:
            child = the_child()
            for said, _ in itertools.product(garbage, range(3)):
                with Raw(echo.front.port) as client:
                    client.push(said, 1)
                    with contextlib.suppress(TimeoutError):
                        client.socket.settimeout(5)
                        answer = await client.receive()
                        assert b"200 OK" not in answer
            assert the_child() == child
            assert not [each for each in echo.told if isinstance(each, Received)]
            (await driver(echo)).socket.close()
        assert not caplog.records, "strangers fill no log"
