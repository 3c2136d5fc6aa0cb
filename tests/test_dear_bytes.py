"""What is dear to hold or to parse is taken out, counted or refused before somebody holds or parses it."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import socket
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.config import LinkConfig
from phalanx.errors import PeerError, TooLarge, WrongTopic
from phalanx.link.envelope import open_envelope, seal
from phalanx.link.pin import Pin, derive_epoch
from phalanx.link.replay import ReplayCache
from phalanx.net import Server
from phalanx.net.broker_packets import (
    MAX_ANSWER_BYTES,
    MAX_PACKET_BYTES,
    Answer,
    Arrived,
    BrokerFaultError,
    BrokerPackets,
)
from phalanx.net.front.link import frame_head
from phalanx.net.site import HEADERS, LINE_BYTES, Site, serve_in_thread
from served_pages import a_page
from stranger import with_length
from waiting import Turns, eventually
from websocket_broker import BrokerEnd


@pytest.mark.parametrize(
    "what",
    ["{},", "[],", "1,", "1.5e3,", '"a",', '{"a":1},', '"\\u0041",', "9" * 4000 + ",", "[" * 900 + "]" * 900 + ","],
)
def test_no_message_that_is_opened_keeps_the_interpreter_for_as_long_as_brakes_wait(what):
    """The thread of the brakes has no turn while C works: measured, 1 to 7 ms for the longest message that is read."""
    config, epoch = LinkConfig(), derive_epoch(Pin("1" * 39))
    many = (what * (config.max_to_server_bytes // len(what)))[: config.max_to_server_bytes - 60].rpartition(",")[0]
    plain = b'{"timestamp":%d.5,"payload":[%s]}' % (time.time(), many.encode())
    assert len(plain) > config.max_to_server_bytes * 0.9
    took = []
    for _ in range(3):
        token, began_s = seal(plain, epoch, os.urandom(12)), time.thread_time()
        with contextlib.suppress(PeerError):
            open_envelope(token, epoch, time.time(), ReplayCache(100, 30.0), config.max_to_server_bytes)
        took.append(time.thread_time() - began_s)
    assert min(took) < 0.1


@pytest.mark.waits
class TestAPage:
    async def request(self, pages: Site, said: bytes) -> bytes:
        """What is answered; b"" if it hangs up."""
        reading, writing = await asyncio.open_connection("127.0.0.1", pages.port)
        with contextlib.suppress(ConnectionError):
            writing.write(said)
            return await asyncio.wait_for(reading.read(100), 10)
        return b""

    async def test_a_request_has_so_many_headers_so_long_and_no_more(self):
        async with serve_in_thread(a_page()) as pages:
            for name, answer in ((b"x" * (LINE_BYTES + 1), b" 400 "), (b"x" * 100, b" 200 ")):
                said = b"GET / HTTP/1.1\r\nHost: x\r\nX: " + name + b"\r\n\r\n"
                assert answer in await self.request(pages, said)
            for count, answer in ((HEADERS + 1, b" 400 "), (HEADERS - 10, b" 200 ")):
                said = b"GET / HTTP/1.1\r\nHost: x\r\n" + b"".join(b"X%d: x\r\n" % n for n in range(count)) + b"\r\n"
                assert answer in await self.request(pages, said)

    async def test_who_says_more_than_a_request_is_before_it_is_answered_is_hung_up_on(self):
        async with serve_in_thread(a_page()) as pages:
            reading, writing = await asyncio.open_connection("127.0.0.1", pages.port)
            answered = b""
            with contextlib.suppress(ConnectionError):
                writing.write(b"GET /none HTTP/1.1\r\nHost: x\r\n\r\n" * 10_000)
                while more := await asyncio.wait_for(reading.read(65536), 10):
                    answered += more
            assert answered.count(b"HTTP/1.1 404") < 2_000


EMPTY = (
    frame_head(9, 0),
    frame_head(2, 0),
    # Each floods for as long as the two above, and two processors.
    pytest.param(frame_head(10, 0), marks=pytest.mark.long),
    pytest.param(frame_head(9, 125) + bytes(125), marks=pytest.mark.long),
)


def cut(mqtt: int, stream: bytes, sizes: list[int] | None = None) -> list[Arrived | Answer | str]:
    """Its packets, if it comes in pieces of such sizes, and what was dropped."""
    packets, out = BrokerPackets(mqtt), []
    pieces = itertools.cycle(sizes or [len(stream) or 1])
    at = 0
    while at < len(stream):
        end = at + next(pieces)
        packets.add(stream[at:end])
        at = end
        while True:
            try:
                packet = packets.next()
            except (TooLarge, WrongTopic) as error:
                out.append(error.reason)
                continue
            if packet is None:
                break
            out.append(packet)
    return out


@pytest.mark.waits
class TestAHostileBroker:
    @pytest.mark.parametrize("packet", EMPTY)
    async def test_frames_that_carry_nothing_hold_nothing_up_however_many(self, packet):
        """They were read for as long as they came: no turn of the loop, no Ctrl-C."""
        connack = frame_head(2, 5) + b"\x20\x03\x00\x00\x00"
        listening = socket.create_server(("127.0.0.1", 0))

        def broker() -> None:
            with contextlib.suppress(OSError):
                there, _ = listening.accept()
                there.close()  # it looks whether there is somebody
                there, _ = listening.accept()
                client, heard = BrokerEnd(), b""
                while b"\x82" not in heard:
                    heard += client.read(there.recv(65536))
                    there.sendall(client.replies + connack * (b"MQTT" in heard))
                    client.replies = b""
                while True:  # until it is hung up on
                    there.sendall(packet * 1000)

        flood = threading.Thread(target=broker, daemon=True)
        flood.start()
        try:
            async with Server(f"ws://127.0.0.1:{listening.getsockname()[1]}/mqtt"):
                await asyncio.sleep(0.2)
                turns = Turns()
                await asyncio.sleep(0.4)
                assert turns.longest_s < 0.05
        finally:
            listening.close()
        await asyncio.to_thread(flood.join, 10)
        assert not flood.is_alive()

    def test_an_answer_is_as_short_as_answers_are(self):
        assert cut(5, with_length(0x90, bytes(MAX_ANSWER_BYTES))) == [Answer(0x90, bytearray(MAX_ANSWER_BYTES))]
        with pytest.raises(BrokerFaultError):
            cut(5, with_length(0x90, bytes(MAX_ANSWER_BYTES + 1))[:5])

    @given(
        st.lists(st.binary(max_size=40), max_size=6), st.lists(st.integers(1, 30), min_size=1), st.sampled_from((4, 5))
    )
    def test_however_a_stream_is_cut_it_is_the_same_packets(self, payloads, sizes, mqtt):
        none = b"\x00" if mqtt == 5 else b""
        huge = with_length(0x30, b"\x00\x01h" + bytes(MAX_PACKET_BYTES))
        said = [with_length(0x30, b"\x00\x01" + b"t" + none + payload) for payload in payloads]
        answers = [with_length(0x90, payload) for payload in payloads]
        stream = b"".join((*said, huge, *answers, with_length(0x30, b"\x00\x01\xff" + none)))
        expected = [Arrived("t", payload) for payload in payloads] + ["too_large"]
        expected += [Answer(0x90, bytearray(payload)) for payload in payloads] + ["wrong_topic"]
        at = len(b"".join(said)) + len(huge) // 2  # most of what is too long comes at once
        assert cut(mqtt, stream, [*sizes, at]) == expected

    @given(st.binary(max_size=200), st.sampled_from((4, 5)))
    def test_whatever_a_broker_says_is_packets_or_its_fault(self, said, mqtt):
        with contextlib.suppress(BrokerFaultError):
            cut(mqtt, said)

    def test_ten_thousand_messages_that_are_none_take_less_than_paho_alone_took(self):
        """What was read 96 µs each with it, where one is refused at once."""
        packets, said, came = BrokerPackets(5), with_length(0x30, b"\x00\x01t\x00" + bytes(200)), 0
        began_s = time.thread_time()
        for _ in range(40):
            packets.add(said * 250)
            while packets.next():
                came += 1
        assert came == 10_000
        assert time.thread_time() - began_s < 0.3

    async def test_one_that_answers_a_byte_a_second_holds_up_no_end(self):
        async def trickle(_: asyncio.StreamReader, writing: asyncio.StreamWriter) -> None:
            with contextlib.suppress(ConnectionError):
                for byte in b"HTTP/1.1 101 Switching Protocols\r\n" * 100:
                    writing.write(bytes([byte]))
                    await writing.drain()
                    came.append(byte)
                    await asyncio.sleep(0.3)

        came: list[int] = []
        async with await asyncio.start_server(trickle, "127.0.0.1", 0) as there:
            async with Server(f"ws://127.0.0.1:{there.sockets[0].getsockname()[1]}/mqtt") as server:
                await eventually(lambda: len(came) > 3)
                with pytest.raises(TimeoutError):
                    await server.wait_connected(0.1)
            began_s = time.monotonic()
            await asyncio.get_running_loop().shutdown_default_executor()
            assert time.monotonic() - began_s < 10, "the thread that connects waited for each byte anew"
