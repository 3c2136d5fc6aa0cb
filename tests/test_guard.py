"""The guard before a broker of ours: what visitors may send, and that they fill nothing, together or alone."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import errno
import os
import resource
import selectors
import signal
import socket
import threading
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import a_broker, a_server, eventually
from phalanx.errors import PeerError, TooLarge
from phalanx.io import Client
from phalanx.io.guard import LATE_S, LOUD, VISITORS, House, Visitor
from phalanx.io.pace import Pace
from phalanx.io.seats import Seats, place_of
from phalanx.io.visitor_packets import REPEATED, SUBSCRIPTIONS, NotForVisitorsError, VisitorPackets
from phalanx.io.websocket import Websocket, frame_head
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
    packets = VisitorPackets()
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
        assert there.replies == (b"\x8a\x82" + bytes(4) + b"hm") * len(payloads)

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
            hello() + frame(b"", 9) * 3000,
            hello() + frame(b"") * 3000,
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
        assert packet.endswith(b"\x11\x00\x00\x00\x00\x27\x00\x01\x00\x00\x00\x01x")
        for wrong in (b"\x11\xff", b"\x77\x00", b"\x26\x00\xffab"):
            body = b"\x00\x04MQTT\x05\x00\x00\x3c" + varint(len(wrong)) + wrong + b"\x00\x01x"
            with pytest.raises(NotForVisitorsError):
                passed_on(with_length(0x10, body))

    @given(st.lists(st.integers(1, 50), min_size=1, max_size=9))
    def test_packets_come_out_whole_however_they_are_cut(self, cuts):
        told = [connect(4), subscribe(b"/qrkey/x/notify"), with_length(0x30, b"\x00\x01t" + bytes(300)), b"\xc0\x00"]
        stream, packets, out, at, turn = b"".join(told), VisitorPackets(), [], 0, 0
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
            connect(4) + b"\x50\x81\x01",
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


def test_a_network_that_one_machine_has_to_itself_is_one_place():
    assert place_of("2001:db8::1") == place_of("2001:db8::ffff:1") != place_of("2001:db8:0:1::1")
    assert place_of("::ffff:192.0.2.7") == place_of("192.0.2.7") != place_of("192.0.2.8")
    assert place_of("fe80::1%eth0") == place_of("fe80::2%eth0")


class Sitting:
    def __init__(self, seats: Seats, place: str, heard_at_s: float) -> None:
        self.place, self.heard_at_s, self.left, self._seats = place, heard_at_s, False, seats
        seats.take(self)

    def leave(self) -> None:
        self.left = True
        self._seats.gone(self)


class TestSeats:
    def test_a_crowd_that_comes_and_says_nothing_pushes_out_nobody_who_spoke_nor_whoever_has_just_come(self):
        seats: Seats[Sitting] = Seats(100)
        speaks = [Sitting(seats, "here", float(n)) for n in range(40)]
        elsewhere = [Sitting(seats, "there", 0.0) for _ in range(10)]
        for one in speaks:
            seats.heard(one)
        for n in range(1000):
            come = [Sitting(seats, "here", 100.0 + n), Sitting(seats, "here", 100.0 + n)]
            assert not come[0].left
            assert len(seats) <= 100
        assert not any(one.left for one in (*speaks, *elsewhere))

    def test_among_who_spoke_it_is_who_was_silent_longest_of_where_most_are(self):
        seats: Seats[Sitting] = Seats(10)
        sit = [Sitting(seats, "here" if n < 7 else "there", float(n)) for n in range(10)]
        for one in sit:
            seats.heard(one)
        seats.heard(sit[0])
        Sitting(seats, "elsewhere", 20.0)
        assert [one.left for one in sit] == [False, True] + [False] * 8
        assert list(map(len, seats._from.values())) == [6, 3, 1]


class Wire:
    """A transport, and how often it was hung up."""

    def __init__(self) -> None:
        self.aborted = 0

    def abort(self) -> None:
        self.aborted += 1

    def get_extra_info(self, name: str):
        return self if name == "socket" else None

    def __getattr__(self, name):
        return lambda *_, **__: 0 if name == "get_write_buffer_size" else None


class Ear(Wire):
    """A broker's end, and what it heard."""

    def __init__(self) -> None:
        super().__init__()
        self.heard: list[bytes] = []

    def write(self, packet: bytes) -> None:
        self.heard.append(packet)


def visitor_of(house: House, name: bytes) -> tuple[Visitor, Ear]:
    """Somebody who has said hello."""
    visitor, ear = Visitor(house, browser=False), Ear()
    visitor.connection_made(Wire())
    visitor._broker = ear
    visitor.data_received(connect(4, name))
    return visitor, ear


class TestAPace:
    @given(st.lists(st.floats(0, 2), max_size=300), st.integers(1, 50), st.integers(1, 50))
    def test_no_more_is_said_than_that(self, silences, per_s, at_once):
        pace, now_s, said = Pace(per_s, at_once), 0.0, 0
        for silent_s in silences:
            now_s += silent_s
            said += pace.may(now_s)
            assert said <= at_once + now_s * per_s

    async def test_of_ten_thousand_things_at_once_most_are_dropped_and_none_waits_and_others_are_heard(self):
        house = House("", 10)
        (flood, all_of_it), (other, heard) = visitor_of(house, b"flood"), visitor_of(house, b"other")
        publish = with_length(0x30, b"\x00\x01tx")
        flood.data_received(publish * 2_000)
        other.data_received(publish)
        for _ in range(300):
            await asyncio.sleep(0)
        assert heard.heard[-1] == publish
        assert 200 < len(all_of_it.heard) < 500, "so many at first"
        assert flood._packets.next() is None
        assert not flood._transport.aborted
        flood.data_received(publish * 2_000)
        for _ in range(300):
            await asyncio.sleep(0)
        assert flood._transport.aborted == 1, "nobody has so much to say"
        assert not other._transport.aborted

    async def test_what_waited_while_too_many_spoke_is_dropped_and_what_waited_for_another_reason_is_not(self):
        house, publish = House("", 100), with_length(0x30, b"\x00\x01tx")
        other, heard = visitor_of(house, b"other")
        other.pace = Pace(400, 800)  # it has been here for a while

        async def a_turn() -> None:
            await asyncio.sleep(0)
            other.data_received(publish)  # so that somebody spoke in the turn before
            time.sleep(1.1 * LATE_S)
            await asyncio.sleep(0)

        await a_turn()
        other.data_received(publish)
        assert heard.heard == [connect(4, b"other"), publish, publish]
        for name in range(20):
            visitor_of(house, b"%d" % name)[0].data_received(publish * 800)
        for _ in range(20):
            await asyncio.sleep(0)
        await asyncio.sleep(0.05)
        heard.heard.clear()
        await a_turn()
        other.data_received(publish + subscribe(b"x"))
        assert heard.heard == [publish, subscribe(b"x")], "the second is late; a subscription is not a command"
        await asyncio.sleep(3 * LATE_S)
        other.data_received(publish)
        assert heard.heard[-1] == publish

    async def test_those_who_make_the_most_work_are_hung_up_on_and_nobody_who_makes_little(self):
        house = House("", 10)
        visitors = [visitor_of(house, b"%d" % name)[0] for name in range(6)]
        for visitor, work in zip(visitors, (LOUD, 5 * LOUD, 40, 4 * LOUD, 0, LOUD - 1), strict=True):
            visitor.work = work
        house.quiet()
        assert [visitor._transport.aborted for visitor in visitors] == [0, 1, 0, 1, 0, 0], "half of it"
        for visitor in visitors:
            visitor.work = LOUD - 1
        house.quiet()
        assert len(house) == 4

    async def test_whoever_says_them_and_goes_leaves_nobody_here(self):
        house = House("", 10)
        flood, ear = visitor_of(house, b"flood")
        closed = []
        ear.close = lambda: closed.append(True)
        flood.data_received(with_length(0x30, b"\x00\x01tx") * 2_000)
        flood.connection_lost(None)
        await eventually(lambda: closed)
        assert len(ear.heard) < 1200


def test_nobody_is_hung_up_on_twice():
    visitor, wire, broker = Visitor(House("", 10), browser=False), Wire(), Wire()
    visitor.connection_made(wire)
    visitor._broker = broker
    visitor.say_goodbye()
    visitor.connection_lost(None)
    visitor.leave()
    assert (wire.aborted, broker.aborted) == (0, 0), "asyncio complains of it, in the operator's log"


def memory_mb(pid: int) -> float:
    (line,) = (line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


def the_guard(broker) -> int:
    """Of a broker in this process."""
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            words = path.read_text().split("\0")
            if "phalanx.io.guard" in words and Path(words[3]).parent.parent == folder_of(broker):
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
                async with Client(server.qr()) as client:  # this one is never silent for long
                    for n in range(VISITORS + 100):
                        await asyncio.to_thread(sit_down, "127.0.0.1")
                        if n % 20 == 0:
                            assert (await client.request(0))["robots"] == [1, 2]
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
                    await asyncio.to_thread(stranger.subscribe, "/qrkey/+/notify")
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

    async def test_four_hundred_who_say_what_they_can_are_hung_up_on_and_others_have_their_answers(self):
        packet = with_length(0x30, b"\x00\x12/qrkey/x/command/1" + bytes(400)) * 20
        async with a_broker() as broker, a_server(broker) as server:
            await server.wait_connected(10)
            with contextlib.ExitStack() as crowd:
                flooding = selectors.DefaultSelector()
                for name in range(400):
                    one = crowd.enter_context(Stranger(broker.url.port, 4, name=b"flood%d" % name)).socket
                    one.setblocking(False)
                    flooding.register(one, selectors.EVENT_WRITE)

                def flood() -> None:
                    while flooding.get_map() and not over.is_set():
                        for key, _ in flooding.select(1):
                            try:
                                key.fileobj.send(packet)
                            except BlockingIOError:
                                pass
                            except OSError:
                                flooding.unregister(key.fileobj)

                over = threading.Event()
                crowd.callback(over.set)
                hung_up = asyncio.create_task(asyncio.to_thread(flood))
                async with Client(server.qr()) as client:
                    for _ in range(20):
                        assert await client.request(0)
                        await asyncio.sleep(0.05)
                await asyncio.wait_for(hung_up, 60)

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
        asked = asyncio.open_connection

        async def out_of_files(*where, **how):
            raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

        async with a_server(broker) as server:
            await server.wait_connected(10)
            await asyncio.sleep(2)
            before = the_process(broker.url.port), the_guard(broker)
            monkeypatch.setattr(asyncio, "open_connection", out_of_files)
            await asyncio.sleep(5)
            monkeypatch.setattr(asyncio, "open_connection", asked)
            assert (the_process(broker.url.port), the_guard(broker)) == before
            assert not server.reconnects
            os.kill(before[0], signal.SIGSTOP)
            await eventually(lambda: server.reconnects, 40)
