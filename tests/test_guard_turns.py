"""Who of the guard's visitors has a turn, who is hung up on, and who gives up a seat."""

from __future__ import annotations

import asyncio
import socket
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import eventually
from phalanx.io.heads import Standing
from phalanx.io.heard import Heard
from phalanx.io.house import IN_LINE, PATIENCE, READ_BYTES, WAITING_IN_ALL_BYTES, House
from phalanx.io.pace import Pace
from phalanx.io.seats import Seats
from phalanx.io.server import Server
from phalanx.io.turns import SHARE, Turns
from phalanx.io.visitor import LATE_S, Visitor
from phalanx.io.websocket import frame_head
from test_guard import frame, hello, subscribe
from test_strangers import connect, with_length


class Sitting:
    standing = Standing.STRANGER

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
        assert list(map(len, seats._guests._from.values())) == [6, 3, 1]

    def test_who_ever_spoke_stays_while_there_are_others_who_did_not(self):
        seats: Seats[Sitting] = Seats(10)
        sit = [Sitting(seats, "here", float(n)) for n in range(10)]
        for one in sit:
            seats.heard(one, speaks=one in sit[:2])
        seats.heard(sit[0])
        for n in range(20):
            seats.heard(come := Sitting(seats, "here", 10.0 + n))
        assert [one.left for one in sit] == [False] * 2 + [True] * 8
        assert not come.left
        for n in range(20):
            seats.heard(Sitting(seats, "here", 30.0 + n), speaks=True)
        assert (sit[1].left, sit[0].left) == (True, True)

    def test_of_places_where_as_many_are_it_is_the_one_that_was_silent_longest(self):
        seats: Seats[Sitting] = Seats(100)
        sit = [Sitting(seats, f"place {n}", float(n)) for n in range(100)]
        for one in reversed(sit):
            seats.heard(one)
        come = [Sitting(seats, f"more {n}", 200.0) for n in range(30)]
        assert [one for one in (*sit, *come) if one.left] == sit[-30:]
        for one in sit:
            seats.gone(one)
        assert (len(seats), seats._guests._crowd) == (30, 1)


class TestTurns:
    def test_places_have_turns_one_after_another_and_whoever_waits_there_too(self):
        turns: Turns[Sitting] = Turns()
        crowd = [Sitting(Seats(100), "here", 0.0) for _ in range(50)]
        alone, other = Sitting(Seats(1), "there", 0.0), Sitting(Seats(1), "elsewhere", 0.0)
        for one in (*crowd, alone, other):
            turns.wait(one)
        turns.gone(crowd[1])
        turns.gone(other)
        assert [turns.next() for _ in range(4)] == [crowd[0], alone, crowd[2], crowd[3]]

    def test_most_of_what_is_passed_on_is_of_who_said_little(self):
        turns: Turns[Sitting] = Turns()
        much, little = Sitting(Seats(1), "here", 0.0), Sitting(Seats(1), "there", 0.0)
        heard = {much: 0, little: 0}
        for n in range(990):
            for one in heard:
                turns.wait(one, much=one is much)
            whose = turns.next()
            turns.passed_on(n % 3)  # what is dropped is no word
            heard[whose] += n % 3
        assert heard[little] == pytest.approx(SHARE * heard[much], rel=0.2)
        assert turns.next()
        assert not turns


QUIET, _ = socket.socketpair()


class Wire:
    """A connection or a transport: how often it was hung up, and what was written."""

    fileno = QUIET.fileno

    def __init__(self) -> None:
        self.aborted = 0
        self.written: list[bytes] = []

    def abort(self) -> None:
        self.aborted += 1

    def write(self, packet: bytes) -> None:
        self.written.append(packet)

    def __getattr__(self, name):
        return lambda *_, **__: 0 if name == "get_write_buffer_size" else None


PUBLISHED, LONG = with_length(0x30, b"\x00\x01tx"), with_length(0x30, b"\x00\x01t" + bytes(70_000))
PINGED = b"\xc0\x00"


def visitor_of(house: House, name: bytes = b"", place: str = "", *, browser: bool = False) -> tuple[Visitor, Wire]:
    """Somebody who has said hello, and what the broker is told."""
    visitor, broker = Visitor(house, Wire(), place, browser=browser), Wire()
    visitor.connection_made(Wire())
    visitor._broker = broker
    visitor.hear(hello() + frame(connect(4, name)) if browser else connect(4, name))
    return visitor, broker


async def turns_of_the_loop(count: int = 300) -> None:
    for _ in range(count):
        await asyncio.sleep(0)


class TestAPace:
    @given(st.lists(st.floats(0, 2), max_size=300), st.integers(1, 50), st.integers(1, 50))
    def test_no_more_is_said_than_that(self, silences, per_s, at_once):
        pace, now_s, said = Pace(per_s, at_once), 0.0, 0
        for silent_s in silences:
            now_s += silent_s
            if not pace.wait_s(now_s):
                pace.said()
                said += 1
            assert said <= at_once + now_s * per_s

    async def test_of_ten_thousand_things_at_once_most_wait_and_are_late_and_others_are_heard(self):
        house = House("", 10)
        (flood, all_of_it), (other, heard) = visitor_of(house), visitor_of(house)
        flood.hear(PUBLISHED * 10_000)
        other.hear(PUBLISHED)
        await turns_of_the_loop()
        assert heard.written[-1] == PUBLISHED
        assert 100 < len(all_of_it.written) < 500, "so many at first"
        await asyncio.sleep(LATE_S)
        all_of_it.written.clear()
        await asyncio.sleep(LATE_S)
        assert not all_of_it.written
        for _ in range(PATIENCE):
            assert not flood._transport.aborted
            house.check(time.monotonic())
        assert flood._transport.aborted == 1, "nobody has so much to say"
        assert not other._transport.aborted

    async def test_what_waited_here_is_dropped_and_counted_and_what_waited_for_us_is_not(self, tmp_path):
        told = Heard(tmp_path / "heard")
        other, heard = visitor_of(House("", 100, told))
        await turns_of_the_loop(2)
        heard.written.clear()
        time.sleep(1.1 * LATE_S)
        other.hear(PUBLISHED)
        await turns_of_the_loop(2)
        assert heard.written == [PUBLISHED]
        other.hold_up()
        other.hear(PUBLISHED + subscribe(b"x"))
        await asyncio.sleep(1.1 * LATE_S)
        other.go_on()
        await turns_of_the_loop(2)
        assert heard.written == [PUBLISHED, subscribe(b"x")], "the second is late; a subscription is not a command"
        assert Server(heard=told).rejected == {"overrun": 1}
        other.hear(PUBLISHED)
        await turns_of_the_loop(2)
        assert heard.written[2:] == [PUBLISHED]

    async def test_pings_are_no_work_for_the_broker_nor_words_of_the_house(self):
        house = House("", 10)
        (flood, all_of_it), (other, heard) = visitor_of(house), visitor_of(house)
        for _ in range(10):
            flood.hear(PINGED * 1000)
            other.hear(PUBLISHED)
            await turns_of_the_loop(3)
            assert heard.written[-1] == PUBLISHED
            heard.written.clear()
        assert all_of_it.written[1:] == [PINGED]
        other.hear(PINGED)
        await turns_of_the_loop(3)
        assert heard.written == [PINGED], "it lives"

    async def test_whoever_begins_with_much_has_no_turn_before_who_says_little(self):
        house = House("", 100)
        floods, (phone, heard), order = [visitor_of(house) for _ in range(50)], visitor_of(house), []
        await turns_of_the_loop(50)
        for flood, broker in floods:
            broker.write = order.append
            flood.hear(LONG[:READ_BYTES])
            flood.hear(LONG[READ_BYTES:])
        heard.write = order.append
        phone.hear(PUBLISHED)
        await turns_of_the_loop()
        assert order.index(PUBLISHED) <= 2
        assert len(order) > 3, "of them too, as many as may be"

    async def test_who_says_much_at_once_is_heard_before_more_is_read(self):
        flood, _ = visitor_of(House("", 10))
        await turns_of_the_loop(2)
        read = []
        flood._transport.pause_reading = lambda: read.append("no more")
        flood._transport.resume_reading = lambda: read.append("more")
        flood.hear(PUBLISHED)
        flood.hear(PUBLISHED)
        assert not read, "what waits in the socket is of an age that nobody knows"
        await turns_of_the_loop(2)
        flood.hear(LONG[:READ_BYTES])
        assert read == ["more", "no more"]
        await turns_of_the_loop(2)
        assert read == ["more", "no more", "more"]

    async def test_small_frames_are_counted_like_packets_and_nobody_waits_for_them(self):
        house = House("", 10)
        (flood, _), (other, heard) = visitor_of(house, browser=True), visitor_of(house)
        flood.hear(frame(b"", 9) * 2000)
        other.hear(PUBLISHED)
        await turns_of_the_loop(3)
        assert heard.written[-1] == PUBLISHED
        await turns_of_the_loop()
        answered = b"".join(flood._transport.written).count(frame_head(10, 0))
        assert 200 < answered < 500
        await asyncio.sleep(0.1)
        assert answered < b"".join(flood._transport.written).count(frame_head(10, 0)) < answered + 200, (
            "the others wait"
        )

    @pytest.mark.waits
    @pytest.mark.parametrize(("floods", "phones"), [(1, 50), (120, 20)])
    async def test_who_drives_is_heard_beside_those_who_flood_from_the_same_address(self, floods, phones):
        house = House("", 1000)
        flooding = [visitor_of(house)[0] for _ in range(floods)]
        drive = [visitor_of(house) for _ in range(phones)]

        async def all_speak(said: bytes = PUBLISHED) -> None:
            for flood in flooding:
                if len(flood._said) < 5_000:
                    flood.hear(PUBLISHED * 300)
            for phone, _ in drive:
                phone.hear(said)
            await asyncio.sleep(0.04)

        while not all(flood.says_much(time.monotonic()) for flood in flooding):
            await all_speak()
        for _ in range(5):
            await all_speak()
        moved = with_length(0x30, b"\x00\x01tm")
        for _ in range(10):
            await all_speak(moved)
        await eventually(lambda: [heard.written.count(moved) for _, heard in drive] == [10] * phones, 1)

    @pytest.mark.parametrize("said", [LONG[:READ_BYTES], LONG[:5000]])
    async def test_nobody_is_heard_out_of_whom_there_is_more_in_the_socket(self, said):
        visitor, _ = visitor_of(House("", 10))
        await turns_of_the_loop(2)
        here, there = socket.socketpair()
        with here, there:
            visitor._connection = here
            there.send(b"x")
            visitor.hear(said)
            await turns_of_the_loop(2)
            assert visitor.waits_since_s is not None, "what comes next is as old"
            visitor.hear(here.recv(1))
            await turns_of_the_loop(2)
            assert visitor.waits_since_s is None

    async def test_whoever_says_them_and_goes_leaves_nobody_here(self):
        house = House("", 10)
        flood, broker = visitor_of(house)
        closed = []
        broker.close = lambda: closed.append(True)
        flood.hear(PUBLISHED * 600)
        flood.connection_lost(None)
        assert len(house) == 1, "until it has been heard"
        await eventually(lambda: closed)
        assert 200 < len(broker.written) < 600
        assert not len(house)


class TestWhoIsHungUpOn:
    def crowd(self, house: House, place: str, count: int, said: int) -> list[Visitor]:
        crowd = [visitor_of(house, place=place)[0] for _ in range(count)]
        for visitor in crowd:
            visitor.pace.said(said)
            visitor._little.said(said)
        return crowd

    async def test_half_of_those_who_said_too_much_for_long_of_those_first_where_the_most_of_them_are(self):
        house, now_s = House("", 100), time.monotonic()
        one, loud = self.crowd(house, "elsewhere", 1, 390), self.crowd(house, "crowd", 9, 390)
        little = self.crowd(house, "crowd", 9, 20)
        for _ in range(PATIENCE):
            assert len(house) == 19
            house.check(now_s)
        gone = [visitor for visitor in (*loud, *one, *little) if visitor._transport.aborted]
        assert len(gone) == 5
        assert set(gone) <= set(loud)
        while any(visitor.loud_checks for visitor in house):
            house.check(now_s)
        assert list(house) == little

    async def test_of_who_said_much_only_while_we_are_busy_and_nobody_who_said_it_once(self):
        house, now_s = House("", 100), time.monotonic()
        (program,) = self.crowd(house, "here", 1, 100)
        for n in range(3 * PATIENCE):
            house._used_s = time.thread_time()
            house._is_busy = n % PATIENCE < PATIENCE - 1
            house.check(now_s)
        assert not program._transport.aborted
        starved, _ = visitor_of(house)
        for _ in range(2 * PATIENCE):
            house._is_busy, starved.waits_since_s = True, now_s - 1
            house.check(now_s)
        assert program._transport.aborted
        assert not starved._transport.aborted, "it said little, and waits for others"

    async def test_who_reads_an_answer_is_known_as_long_as_it_does(self):
        house = House("", 10)
        (one, _), (other, _) = visitor_of(house), visitor_of(house)
        one.hear(subscribe(b"/qrkey/t/reply/1", b"/qrkey/t/notify"))
        other.hear(subscribe(b"/qrkey/t/reply/2", b"/qrkey/t/notify"))
        await turns_of_the_loop(4)
        assert house.readers._of == {b"/qrkey/t/reply/1": one, b"/qrkey/t/reply/2": other}
        one.hear(with_length(0xA2, b"\x00\x01\x00\x10/qrkey/t/reply/1") + subscribe(b"/qrkey/t/reply/2"))
        await turns_of_the_loop(4)
        assert house.readers._of == {b"/qrkey/t/reply/2": one}
        assert (one._transport.aborted, other._transport.aborted) == (0, 0)
        assert not other.answers
        one.leave()
        assert not house.readers._of

    async def test_nothing_is_said_to_who_has_gone(self):
        house = House("", 10)
        visitor, broker = visitor_of(house)
        visitor.hear(PUBLISHED)
        visitor.connection_lost(None)
        before = len(visitor._transport.written)
        visitor.tell(b"news")
        assert len(visitor._transport.written) == before, "asyncio complains, in the operator's log"
        visitor, broker = visitor_of(house)
        await turns_of_the_loop(2)
        broker.written.clear()
        broker.is_closing = lambda: True
        visitor.hear(PUBLISHED * 20)
        await turns_of_the_loop(3)
        assert not broker.written

    async def test_of_half_packets_no_more_is_kept_than_of_what_nobody_reads(self):
        house, half = House("", 1000), LONG[:READ_BYTES]
        crowd, (phone, _) = [visitor_of(house)[0] for _ in range(900)], visitor_of(house)
        phone.hear(LONG[:100])
        most = 0
        for n, one in enumerate(crowd * 2):
            if not one._transport.aborted:
                one.hear(half)
            if n % 60 == 0:
                most = max(most, sum(each.kept_bytes() for each in house))
        assert most <= WAITING_IN_ALL_BYTES
        assert 0 < sum(one._transport.aborted for one in crowd) < 900
        assert not phone._transport.aborted

    async def test_nobody_is_hung_up_on_twice(self):
        visitor, broker = visitor_of(House("", 10))
        visitor.say_goodbye()
        visitor.connection_lost(None)
        visitor.leave()
        assert (visitor._transport.aborted, broker.aborted) == (0, 0), "asyncio complains, in the operator's log"

    async def test_in_line_at_the_broker_places_have_turns_too(self):
        house, asked = House("", 1000), []
        visitors = [visitor_of(house, place="crowd" if n < 100 else "elsewhere")[0] for n in range(101)]
        for visitor in visitors:
            visitor.ask = lambda visitor=visitor: asked.append(visitor)
            house.line.asks(visitor)
        assert asked == visitors[:IN_LINE]
        visitors[IN_LINE].leave()
        for _ in range(2):
            house.line.answered()
        assert asked[IN_LINE:] == [visitors[-1], visitors[IN_LINE + 1]] or asked[IN_LINE:] == [
            visitors[IN_LINE + 1],
            visitors[-1],
        ]
