"""The guard before a broker of ours: what visitors may send, and that they fill nothing, together or alone."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import errno
import os
import resource
import signal
import socket
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import a_broker, a_server, eventually
from phalanx.errors import PeerError, TooLarge
from phalanx.io import Client
from phalanx.io.guard import VISITORS
from phalanx.io.visitor_packets import REPEATED, SUBSCRIPTIONS, NotForVisitorsError, VisitorPackets
from phalanx.io.websocket import Websocket, frame_head
from phalanx.link.envelope import encode_envelope, seal
from test_strangers import Stranger, connect, the_process, varint, with_length

MASK = b"\x01\x02\x03\x80"


def frame(payload: bytes, opcode: int = 2, *, last: bool = True) -> bytes:
    """As a browser sends it."""
    size = len(payload)
    length = bytes([size | 128]) if size < 126 else b"\xfe" + size.to_bytes(2, "big")
    masked = bytes(byte ^ MASK[i % 4] for i, byte in enumerate(payload))
    return bytes([opcode | (128 if last else 0)]) + length + MASK + masked


def hello(protocol: str = "mqtt", key: str = base64.b64encode(bytes(16)).decode()) -> bytes:
    lines = ("GET /mqtt HTTP/1.1", "Host: x", "upgrade: WebSocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13")
    return "\r\n".join((*lines, f"Sec-WebSocket-Key: {key}", f"Sec-WebSocket-Protocol: {protocol}", "", "")).encode()


def subscribe(*filters: bytes) -> bytes:
    return with_length(0x82, b"\x00\x01" + b"".join(len(f).to_bytes(2, "big") + f + b"\x00" for f in filters))


def passed_on(stream: bytes) -> list[bytes]:
    packets = VisitorPackets(b"stranger")
    packets.add(stream)
    return list(iter(packets.next, None))


class TestWebsocket:
    @given(st.lists(st.binary(max_size=300), max_size=8), st.lists(st.integers(1, 90), min_size=1, max_size=9))
    def test_however_it_is_cut_the_same_comes_out(self, payloads, cuts):
        stream = hello()
        for payload in payloads:
            stream += frame(payload) + frame(b"hm", 9) + frame(b"", 0)
        there, out, replies, at, turn = Websocket(), b"", b"", 0, 0
        while at < len(stream):
            out += there.read(stream[at : at + cuts[turn % len(cuts)]])
            replies, there.replies = replies + there.replies, b""
            at += cuts[turn % len(cuts)]
            turn += 1
        assert out == b"".join(payloads)
        assert replies.count(b"\x8a\x02hm") == len(payloads)
        assert replies.startswith(b"HTTP/1.1 101 ")
        assert b"Sec-WebSocket-Protocol: mqtt\r\n" in replies

    @given(st.lists(st.binary(max_size=300), max_size=8), st.lists(st.integers(1, 90), min_size=1, max_size=9))
    def test_what_one_end_says_the_other_reads(self, payloads, cuts):
        said = b"".join(frame_head(2, len(each)) + each + frame_head(9, 2) + b"hm" for each in payloads)
        there, out, at, turn = Websocket(server=False), b"", 0, 0
        while at < len(said):
            out += there.read(said[at : at + cuts[turn % len(cuts)]])
            at += cuts[turn % len(cuts)]
            turn += 1
        assert out == b"".join(payloads)
        assert there.replies == (b"\x8a\x82" + bytes(4) + b"hm" if payloads else b""), "to the last of them"

    def test_the_answer_is_the_one_of_the_standard(self):
        there = Websocket()
        there.read(hello(key="dGhlIHNhbXBsZSBub25jZQ=="))  # RFC 6455 §1.3
        assert b"Sec-WebSocket-Accept: s3pPLMBiTxaQ9kYGzzhZRbK+xOo=\r\n" in there.replies

    def test_what_was_said_before_the_end_is_heard(self):
        there = Websocket()
        assert there.read(hello() + frame(b"last words") + frame(b"\x03\xe8", 8) + b"rest") == b"last words"
        assert there.closed

    @pytest.mark.parametrize(
        "stream",
        [
            b"GET / HTTP/1.1\r\nHost: x\r\n\r\n",
            b"x" * 9000,
            hello() + b"\x82\x03abc",  # no mask
            hello() + frame(b"text", 1),
            hello() + b"\xc2" + frame(b"compressed")[1:],
            hello() + frame(b"x" * 126, 9),
        ],
    )
    def test_nothing_else_is_taken(self, stream):
        with pytest.raises(PeerError):
            Websocket().read(stream)

    @given(st.binary(max_size=300))
    def test_rubbish_is_refused_or_ignored(self, data):
        for start in (b"", hello()):
            with contextlib.suppress(PeerError):
                Websocket().read(start + data)


class TestPackets:
    @pytest.mark.parametrize("version", [4, 5])
    def test_no_session_outlives_its_connection_whatever_was_asked(self, version):
        told = connect(version, clean=False)
        (packet,) = passed_on(told)
        assert packet[9] == told[9] | 2
        assert packet[:9] + packet[10:] == told[:9] + told[10:]

    def test_not_by_a_property_either(self):
        properties = b"\x26\x00\x01a\x00\x01b\x21\x00\x09\x11\xff\xff\xff\xff\x27\x00\x01\x00\x00"
        body = b"\x00\x04MQTT\x05\x00\x00\x3c" + varint(len(properties)) + properties + b"\x00\x01x"
        (packet,) = passed_on(with_length(0x10, body))
        assert packet.endswith(b"\x3c\x08\x21\x00\x09\x27\x00\x01\x00\x00\x00\x08stranger"), "what it can take"
        for wrong in (b"\x11\xff", b"\x77\x00", b"\x26\x00\xffab"):
            body = b"\x00\x04MQTT\x05\x00\x00\x3c" + varint(len(wrong)) + wrong + b"\x00\x01x"
            with pytest.raises(NotForVisitorsError):
                passed_on(with_length(0x10, body))

    @pytest.mark.parametrize(("version", "said_s", "passed_on_s"), [(4, 0, 120), (4, 121, 120), (4, 60, 60), (5, 0, 0)])
    def test_nobody_is_silent_for_ever(self, version, said_s, passed_on_s):
        assert passed_on(connect(version, keepalive_s=said_s)) == [connect(version, keepalive_s=passed_on_s)]

    @pytest.mark.parametrize("version", [4, 5])
    def test_a_name_is_one_that_nobody_else_has_or_none(self, version):
        assert passed_on(connect(version, b"x" * 300)) == [connect(version)]
        assert passed_on(connect(version, b"")) == [connect(version, b"")]

    @given(st.lists(st.integers(1, 50), min_size=1, max_size=9))
    def test_packets_come_out_whole_however_they_are_cut(self, cuts):
        told = [connect(4), subscribe(b"/qrkey/x/notify"), with_length(0x30, b"\x00\x01t" + bytes(300)), b"\xc0\x00"]
        stream, packets, out, at, turn = b"".join(told), VisitorPackets(b""), [], 0, 0
        while at < len(stream):
            packets.add(stream[at : at + cuts[turn % len(cuts)]])
            out += iter(packets.next, None)
            at += cuts[turn % len(cuts)]
            turn += 1
        assert out[1:] == told[1:]

    @pytest.mark.parametrize(
        "stream",
        [
            b"\xc0\x00",
            connect(4) + connect(4),
            connect(0x85),
            connect(4).replace(b"MQTT\x04\x02", b"MQTT\x04\x06"),
            connect(4) + b"\x80" + subscribe(b"x")[1:],
            connect(4) + b"\x30\xff\xff\xff\xff\x01",
            connect(4) + b"\x30\xff\xff\x7f",
            connect(4) + subscribe(b"x" * 1100),
            connect(4) + subscribe(b"/" * 16),
            connect(4) + subscribe(b"x")[:-3] + b"\xff\xff\x00",
            connect(4) + b"".join(subscribe(b"%d" % n) for n in range(SUBSCRIPTIONS + 1)),
            connect(4) + subscribe(*(b"x" for _ in range(SUBSCRIPTIONS + 1))),
            connect(4) + subscribe(b"x") * (REPEATED + 2),
            connect(4) + subscribe(b"x", b"x") * REPEATED,
            connect(4) + subscribe(b"/qrkey/t/notify", b"/qrkey/t/reply/+"),
            connect(4) + subscribe(b"/qrkey/#"),
            connect(4) + subscribe(b"$share/all//qrkey/t/notify"),
            connect(4) + b"\x50\x81\x01",
            connect(4) + b"\x40\x02\x00\x01",
        ],
    )
    def test_what_a_broker_would_keep_or_choke_on_is_refused(self, stream):
        with pytest.raises((NotForVisitorsError, TooLarge)):
            passed_on(stream)

    def test_who_says_a_little_again_is_heard(self):
        assert len(passed_on(connect(4) + subscribe(b"x") * (REPEATED + 1))) == REPEATED + 2

    def test_who_unsubscribes_may_subscribe_again(self):
        gone = with_length(0xA2, b"\x00\x01\x00\x011")
        assert len(passed_on(connect(4) + subscribe(b"2") + (subscribe(b"1") + gone) * 50)) == 102

    @given(st.binary(max_size=200), st.sampled_from([4, 5]))
    def test_rubbish_is_refused_and_nothing_else_breaks(self, data, version):
        for start in (b"", connect(version)):
            with contextlib.suppress(PeerError):
                passed_on(start + data)


def memory_mb(pid: int) -> float:
    (line,) = (line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


def the_guard(broker) -> int:
    """Of a broker in this process."""
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            words = path.read_text().split("\0")
            if "phalanx.io.guard" in words and Path(words[4]).parent.parent == folder_of(broker):
                return int(path.parent.name)
    raise AssertionError("no guard")


def folder_of(broker) -> Path:
    return Path(Path(f"/proc/{the_process(broker.url.port)}/cmdline").read_text().split("\0")[2]).parent


@contextlib.contextmanager
def many_files():
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(8192, hard), hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.waits
class TestNothingIsFilled:
    async def test_sessions_that_sleep_and_long_subscriptions_fill_nothing(self):
        async with a_broker() as broker, a_server(broker) as server:
            await server.wait_connected(10)
            pid, before_mb = the_process(broker.url.port), memory_mb(the_process(broker.url.port))

            def fill():
                for n in range(300):
                    # The longest that was taken once, which is hung up on now, and the longest that is taken now.
                    for long, count in ((60_000, 8), (900, 2)):
                        with contextlib.suppress(OSError, AssertionError):
                            how = {"name": b"sleeper%d" % n, "clean": False}
                            with Stranger(broker.url.port, 4, **how) as stranger:
                                stranger.subscribe(*(f"{n}/{i}/{'x' * long}" for i in range(count)))

            await asyncio.to_thread(fill)
            async with Client(server.qr()) as client:
                assert (await client.request(0))["robots"] == [1, 2]
            assert the_process(broker.url.port) == pid
            assert memory_mb(pid) - before_mb < 10, "64 MB and more were a start"
            assert not server.reconnects

    async def test_a_thousand_who_say_nothing_keep_nobody_out_and_push_nobody_out_who_comes_from_elsewhere(self):
        with many_files(), contextlib.ExitStack() as idle:
            async with a_broker() as broker, a_server(broker) as server:
                await server.wait_connected(10)
                port = int(broker.websocket.split(":")[2].split("/")[0])

                def sit_down(place: str) -> socket.socket:
                    seat = socket.create_connection(("127.0.0.1", port), 10, (place, 0))
                    idle.enter_context(seat)
                    seat.sendall(hello() + frame(connect(4, os.urandom(8).hex().encode())))
                    said = b""
                    while b"\x20\x02\x00\x00" not in said:  # CONNACK
                        said += (more := seat.recv(500))
                        assert more, "hung up"
                    return seat

                elsewhere = await asyncio.to_thread(sit_down, "127.0.0.2")
                async with Client(server.qr()) as client:  # this one only looks on, once it has its list
                    assert (await client.request(0))["robots"] == [1, 2]
                    for _ in range(VISITORS + 100):
                        await asyncio.to_thread(sit_down, "127.0.0.1")
                    assert (await client.request(0))["robots"] == [1, 2]
                    assert not client._link.reconnects
                async with Client(server.qr()) as late:
                    assert (await late.request(0))["robots"] == [1, 2]
                elsewhere.settimeout(10)
                elsewhere.sendall(frame(b"\xc0\x00"))
                assert elsewhere.recv(100) == b"\x82\x02\xd0\x00"

    async def test_readers_that_stall_fill_nothing_and_others_hear_all(self):
        async with a_broker() as broker, a_server(broker) as server:
            await server.wait_connected(10)
            pid, guard = the_process(broker.url.port), the_guard(broker)
            with contextlib.ExitStack() as stalled:
                for n in range(60):
                    stranger = await asyncio.to_thread(
                        stalled.enter_context, Stranger(broker.url.port, 4, name=b"stalled%d" % n)
                    )
                    await asyncio.to_thread(stranger.subscribe, f"/qrkey/{server.epoch.topic}/notify")
                async with Client(server.qr()) as client:
                    news = client.notifications()
                    for n in range(100):
                        assert await server.notify({"n": n, "much": "x" * 60_000})
                        assert (await asyncio.wait_for(anext(news), 10))["n"] == n
                    assert (await client.request(0))["robots"] == [1, 2]
                assert memory_mb(pid) < 60, "60 readers of 8 MB"
                assert memory_mb(guard) < 200
            assert the_process(broker.url.port) == pid
            assert not server.reconnects

    async def test_an_answer_has_one_reader_the_last_who_came(self, broker):
        async with a_server(broker) as server:
            await server.wait_connected(10)
            base = f"/qrkey/{server.epoch.topic}"
            question = encode_envelope({"request": 0, "reply": "me"}, time.time())
            async with Stranger(broker.url.port, 4, name=b"a") as asleep, Stranger(broker.url.port, 4, name=b"b") as me:
                for reader in (asleep, me):
                    await asyncio.to_thread(reader.subscribe, f"{base}/reply/me", f"{base}/notify")
                assert await asyncio.to_thread(asleep.socket.recv, 4) == b"\xb0\x02\xff\xff", "unsubscribed, and here"
                me.publish(f"{base}/request", seal(question, server.epoch, os.urandom(12)))
                assert b"/reply/me" in await asyncio.to_thread(me.socket.recv, 500)
                asleep.socket.sendall(b"\xc0\x00")
                assert await asyncio.to_thread(asleep.socket.recv, 100) == b"\xd0\x00", (
                    "its id can be learnt: it drives on"
                )

    async def test_nobody_pushes_another_off_by_its_name(self, broker):
        async with (
            Stranger(broker.url.port, 4, name=b"mqttjs_1") as first,
            Stranger(broker.url.port, 4, name=b"mqttjs_1"),
        ):
            first.socket.sendall(b"\xc0\x00")
            assert await asyncio.to_thread(first.socket.recv, 2) == b"\xd0\x00"

    async def test_of_a_class_that_scans_at_once_everybody_is_let_in(self, broker):
        async def come(name: int) -> bytes:
            reading, writing = await asyncio.open_connection("127.0.0.1", broker.url.port)
            writing.write(connect(4, b"pupil%d" % name))
            try:
                return await asyncio.wait_for(reading.read(4), 20)
            finally:
                writing.close()

        answers = await asyncio.gather(*map(come, range(300)))
        assert answers == [b"\x20\x02\x00\x00"] * 300

    async def test_who_says_nothing_at_first_is_hung_up_on(self, broker):
        with socket.create_connection(("127.0.0.1", broker.url.port), 10) as silent:
            assert await asyncio.to_thread(silent.recv, 1) == b""

    @pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
    async def test_a_guard_that_dies_or_does_not_serve_is_started_again(self, broker, number):
        async with a_server(broker) as server:
            await server.wait_connected(10)
            await asyncio.sleep(2)  # it is watched from when it first serves
            first = the_guard(broker)
            os.kill(first, number)
            async with Client(server.qr(), timeout_s=30) as client:
                assert (await client.request(0, timeout_s=30))["robots"] == [1, 2]
            assert the_guard(broker) != first
            assert not server.reconnects, "it does not come by way of the guard"

    async def test_who_has_no_file_left_to_ask_it_ends_no_broker_that_is_well(self, broker, monkeypatch):
        async def out_of_files(*where, **how):
            raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

        async with a_server(broker) as server:
            await server.wait_connected(10)
            await asyncio.sleep(2)
            before = the_process(broker.url.port), the_guard(broker)
            for dials in ("open_connection", "open_unix_connection"):
                monkeypatch.setattr(asyncio, dials, out_of_files)
            await asyncio.sleep(5)
            monkeypatch.undo()
            assert (the_process(broker.url.port), the_guard(broker)) == before
            assert not server.reconnects
            os.kill(before[0], signal.SIGSTOP)
            await eventually(lambda: server.reconnects, 40)
