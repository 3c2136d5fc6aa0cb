"""The front end as a real process: page, websocket, what the gateway is told, and how it is started and ended."""

from __future__ import annotations

import asyncio
import gzip
import os
import signal
import subprocess
import sys
from pathlib import Path

import aiohttp
import pytest
from hypothesis import given
from hypothesis import strategies as st

from front_world import Raw, child_of, echoing, frame, the_child
from phalanx.config.front import FrontConfig
from phalanx.net.front import Closed, Front, Opened, Received
from phalanx.net.front.pipe import Pipe
from phalanx.wire.front import FRONT_HEAD, FromFront, ToFront, pack_numbers, unpack_numbers
from phalanx.wire.record import MalformedRecord

pytestmark = pytest.mark.waits


def url(front, path="/"):
    return f"http://127.0.0.1:{front.port}{path}"


class TestWhatItCarries:
    async def test_page_and_websocket_on_one_port(self, pages):
        async with echoing(pages) as echo, aiohttp.ClientSession() as session:
            async with session.get(url(echo.front)) as page:
                assert await page.text() == "<p>drive"
                assert page.headers["Content-Security-Policy"] == "default-src 'self'"
            async with session.get(url(echo.front, "/link")) as refused:
                assert refused.status == 426
            async with session.ws_connect(url(echo.front, "/link")) as websocket:
                for n in range(100):
                    data = bytes([n]) * (1 + 10 * n)
                    await websocket.send_bytes(data)
                    assert await websocket.receive_bytes(timeout=30) == data
            await echo.eventually(lambda: Closed(1) in echo.told)
            assert echo.told[0] == Opened(1, "127.0.0.1")
            assert len(echo.told) == 102

    async def test_a_file_comes_packed_to_those_who_unpack(self, pages):
        script = b"drive();" * 200
        (pages / "drive.js").write_bytes(script)
        (pages / "drive.js.gz").write_bytes(gzip.compress(script))
        async with echoing(pages) as echo, aiohttp.ClientSession(auto_decompress=False) as session:
            for takes, encoding, unpack in (("gzip, br", "gzip", gzip.decompress), ("identity", None, bytes)):
                async with session.get(url(echo.front, "/drive.js"), headers={"Accept-Encoding": takes}) as answer:
                    assert answer.headers.get("Content-Encoding") == encoding
                    assert answer.headers["Vary"] == "Accept-Encoding"
                    assert unpack(await answer.read()) == script
            async with session.get(url(echo.front, "/drive.js.gz")) as answer:
                assert answer.status == 404

    async def test_an_update_reaches_those_it_is_for_and_a_close_follows_what_was_sent(self, pages):
        async with echoing(pages) as echo, aiohttp.ClientSession() as session:
            sockets = [await session.ws_connect(url(echo.front, "/link")) for _ in range(3)]
            for websocket in sockets:
                await websocket.send_bytes(b"hello")
                assert await websocket.receive_bytes(timeout=30) == b"hello"
            echo.front.publish([1, 3, 99], b"update")
            for websocket in sockets:
                await websocket.send_bytes(b"more")
            assert [await sockets[n].receive_bytes(timeout=30) for n in (0, 2)] == [b"update"] * 2
            assert await sockets[1].receive_bytes(timeout=30) == b"more"
            echo.front.send(2, b"x" * 100_000)
            echo.front.close(2, "removed")
            echo.front.send(2, b"too late")
            assert await sockets[1].receive_bytes(timeout=30) == b"x" * 100_000
            end = await sockets[1].receive(timeout=30)
            assert (end.type, end.data, end.extra) == (aiohttp.WSMsgType.CLOSE, 1000, "removed")
            await echo.eventually(lambda: Closed(2) in echo.told)

    async def test_nothing_is_received_from_who_was_closed_also_if_it_does_not_go(self, pages):
        async with echoing(pages, closing_s=0.5) as echo:
            with Raw(echo.front.port) as stays:
                (await stays.websocket()).say(b"1")
                await echo.eventually(lambda: echo.heard()[1] == 1)
                echo.front.close(1, "removed")
                for _ in range(20):
                    stays.push(frame(b"2"), 1)
                assert await stays.is_closed()
                await echo.eventually(lambda: Closed(1) in echo.told)
                assert echo.heard()[1] == 1

    async def test_text_is_no_message_and_no_compression_is_agreed_on(self, pages):
        async with echoing(pages) as echo, aiohttp.ClientSession() as session:
            async with session.ws_connect(url(echo.front, "/link"), compress=15) as websocket:
                assert websocket.compress == 0
                await websocket.send_str("text")
                assert (await websocket.receive(timeout=30)).type is not aiohttp.WSMsgType.BINARY
            assert not echo.told

    async def test_pings_are_answered_and_a_message_may_come_in_pieces(self, pages):
        async with echoing(pages) as echo:
            with Raw(echo.front.port) as client:
                await client.websocket()
                client.send(frame(b"ping", 9))
                assert await client.receive(6) == b"\x8a\x04ping"
                client.send(frame(b"he", fin=False) + frame(b"l", 0, fin=False) + frame(b"lo", 0))
                await echo.eventually(lambda: Received(1, b"hello") in echo.told)


class TestItsLife:
    async def test_one_that_is_killed_is_started_again_and_numbers_go_on(self, pages):
        async with echoing(pages) as echo:
            port = echo.front.port
            with Raw(port) as first:
                (await first.websocket()).say(b"1")
                await echo.eventually(lambda: echo.open() == {1})
                killed = the_child()
                os.kill(killed, signal.SIGKILL)
                assert await first.is_closed()
            await echo.eventually(lambda: Closed(1) in echo.told)
            with Raw(port) as second:
                (await second.websocket()).say(b"2")
                await echo.eventually(lambda: echo.heard()[2] == 1)
            assert the_child() != killed
            assert echo.front.restarts == 1
            assert [each for each in echo.told if isinstance(each, Opened)] == [
                Opened(1, "127.0.0.1"),
                Opened(2, "127.0.0.1"),
            ]

    @pytest.mark.slow
    async def test_one_that_is_stopped_is_replaced(self, pages):
        async with echoing(pages) as echo:
            os.kill(stopped := the_child(), signal.SIGSTOP)
            await echo.eventually(lambda: the_child() not in (0, stopped), 60)

    async def test_it_ends_with_a_gateway_that_is_killed_outright(self, pages):
        program = (
            "import asyncio, pathlib, sys\n"
            "from phalanx.config.front import FrontConfig\n"
            "from phalanx.net.front import Front\n"
            "async def main():\n"
            "    async with Front(pathlib.Path(sys.argv[1]), 'x', '127.0.0.1', 0, FrontConfig()) as front:\n"
            "        print(front.port, flush=True)\n"
            "        await asyncio.sleep(1000)\n"
            "asyncio.run(main())\n"
        )
        with subprocess.Popen([sys.executable, "-c", program, str(pages)], stdout=subprocess.PIPE) as gateway:
            assert gateway.stdout.readline()
            child = child_of(gateway.pid)
            assert child
            gateway.kill()
        async with asyncio.timeout(30):
            while Path(f"/proc/{child}").exists():
                await asyncio.sleep(0.01)

    async def test_leaving_the_context_ends_child_and_events(self, pages):
        async with Front(pages, "x", "127.0.0.1", 0, FrontConfig()) as front:
            child = the_child()
            reading = asyncio.create_task(anext(front.events(), None))
            await asyncio.sleep(0)
        assert await reading is None
        assert not Path(f"/proc/{child}").exists()
        front.send(1, b"")
        front.publish([1], b"")
        front.close(1, "")


class Held(asyncio.Transport):
    """A transport that keeps what is written."""

    def __init__(self):
        super().__init__()
        self.written, self.is_over = b"", False

    def write(self, data):
        self.written += data

    def get_write_buffer_size(self):
        return 0

    def is_closing(self):
        return self.is_over

    def abort(self):
        self.is_over = True


class TestTheGatewayTrustsNothing:
    """What a front end that was taken over may send."""

    def front(self, **limits):
        front = Front(Path(), "", "", 0, FrontConfig(**limits))
        lost = []
        pipe = Pipe(100, front._on_message, lost.append)
        pipe.connection_made(Held())
        return front, pipe, lost

    def packed(self, *messages):
        return b"".join(FRONT_HEAD.form.pack(len(data), kind, number) + data for kind, number, data in messages)

    @given(st.lists(st.binary(max_size=40)))
    async def test_garbage_in_pieces_raises_nothing(self, pieces):
        _, pipe, _ = self.front()
        for piece in pieces:
            pipe.data_received(piece)

    async def test_honest_messages_come_through_also_byte_by_byte(self):
        front, pipe, lost = self.front()
        sent = self.packed((1, 1, b"10.0.0.1"), (2, 1, b"data"), (3, 1, b""))
        for at in range(len(sent)):
            pipe.data_received(sent[at : at + 1])
        assert list(front._events) == [Opened(1, "10.0.0.1"), Received(1, b"data"), Closed(1)]
        assert not lost

    @pytest.mark.parametrize(
        "messages",
        [
            [(2, 1, b"of nobody")],
            [(3, 1, b"")],
            [(1, 0, b"")],
            [(1, 2, b""), (1, 2, b"")],
            [(1, 2, b""), (1, 1, b"")],
            [(1, 1, b"\xff")],
            [(1, 1, b"a" * 65)],
            [(1, 1, b""), (1, 2, b""), (1, 3, b"")],
            [(1, 1, b""), *[(2, 1, b"")] * 11],
            [(kind, 1 + n, b"") for n in range(20) for kind in (1, 3)],
            [(ToFront.SEND, 0, b"")],
            [(1, 1, b"a" * 101)],
        ],
    )
    async def test_what_no_honest_one_sends_ends_it(self, messages):
        front, pipe, lost = self.front(connections_max=2, in_flight=10)
        pipe.data_received(self.packed(*messages))
        assert [type(each) for each in lost] == [MalformedRecord]
        assert len(front._events) <= 25
        before = list(front._events)
        pipe.data_received(self.packed((FromFront.OPENED, 9, b"")))
        assert len(lost) == 1
        assert list(front._events) == before or lost

    def test_numbers_are_what_was_packed(self):
        assert unpack_numbers(pack_numbers([1, 2**32 - 1]) + b"rest", 2) == ((1, 2**32 - 1), b"rest")
        with pytest.raises(MalformedRecord):
            unpack_numbers(bytes(7), 2)


class TestKey:
    async def test_the_page_gets_the_swarms_public_key_for_room_codes_if_there_is_one(self, pages):
        async with aiohttp.ClientSession() as session:
            async with echoing(pages, key="c3dhcm0") as echo:
                async with session.get(url(echo.front, "/link-key")) as answer:
                    assert await answer.text() == "c3dhcm0"
            async with echoing(pages) as echo:
                async with session.get(url(echo.front, "/link-key")) as answer:
                    assert answer.status == 404
