"""Who has proved the pin counts as a head at the guard, wherever it comes from."""

from __future__ import annotations

import asyncio
import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import a_broker, a_server
from phalanx.io import Client
from phalanx.io.heads import HEADS, NEW_WORDS, Proof, Standing
from phalanx.io.house import House
from phalanx.io.seats import KNOWN_PERCENT, Seats, place_of
from phalanx.io.turns import ROUND, SHARE, TURN, Turns
from test_guard import frame, many_files, subscribe
from test_guard_floods import PUBLISHED, Flood, a_browser, port_of
from test_guard_turns import Sitting, turns_of_the_loop, visitor_of
from test_strangers import with_length

ANSWER, NEWS = b"/qrkey/t/reply/me", b"/qrkey/t/notify"


def said_on(topic: bytes, size: int = 20) -> bytes:
    """A message of the swarm as the broker passes it on."""
    return with_length(0x30, len(topic).to_bytes(2, "big") + topic + bytes(size))


def test_a_network_that_one_machine_has_to_itself_is_one_place():
    assert place_of("2001:db8::1") == place_of("2001:db8::ffff:1") != place_of("2001:db8:0:1::1")
    assert place_of("::ffff:192.0.2.7") == place_of("192.0.2.7") != place_of("192.0.2.8")
    assert place_of("fe80::1%eth0") == place_of("fe80::2%eth0")


class TestProof:
    @given(st.lists(st.integers(1, 400), min_size=1, max_size=9), st.integers(0, 300))
    def test_an_answer_is_seen_however_the_stream_is_cut(self, cuts, size):
        begin = b"\x20\x02\x00\x00" + said_on(NEWS, size) + b"\x90\x04\x00\x01\x00\x00"
        stream, proof, at, turn, shown = begin + said_on(ANSWER, size), Proof(), 0, 0, []
        while at < len(stream):
            shown.append((at, proof.of(stream[at : at + cuts[turn % len(cuts)]], frozenset((ANSWER,)))))
            at += cuts[turn % len(cuts)]
            turn += 1
        assert max(what for _, what in shown) is Standing.PROVED
        assert all(what < Standing.PROVED for at, what in shown if at + max(cuts) <= len(begin))

    def test_news_and_what_others_ask_are_no_answer_to_who_reads_another_topic(self):
        proof = Proof()
        assert proof.of(b"\x20\x02\x00\x00", frozenset()) is Standing.STRANGER
        assert proof.of(said_on(NEWS) + said_on(ANSWER + b"2"), frozenset((ANSWER,))) is Standing.HEARS
        assert proof.of(said_on(ANSWER, 70_000)[:100], frozenset((ANSWER,))) is Standing.PROVED


class TestHeads:
    async def test_whoever_is_answered_is_a_head_and_one_place_has_so_many(self):
        house = House("", 1000)
        crowd = [visitor_of(house, place="school")[0] for _ in range(HEADS + 1)]
        (elsewhere, _) = visitor_of(house, place="elsewhere")
        for n, one in enumerate((*crowd, elsewhere)):
            one.hear(subscribe(ANSWER + b"%d" % n))
        await turns_of_the_loop()
        for n, one in enumerate((*crowd, elsewhere)):
            one.tell(said_on(ANSWER + b"%d" % n))
        assert [one.standing for one in crowd] == [Standing.PROVED] * HEADS + [Standing.HEARS]
        assert elsewhere.standing is Standing.PROVED
        crowd[0].leave()
        crowd[-1].tell(said_on(NEWS))
        assert crowd[-1].standing is Standing.HEARS
        crowd[-1].tell(said_on(ANSWER + b"%d" % HEADS))
        assert crowd[-1].standing is Standing.PROVED, "there is room again"

    async def test_who_comes_is_new_until_it_has_said_so_much(self):
        visitor, _ = visitor_of(House("", 10))
        for n in range(NEW_WORDS):  # and its CONNECT, which is a word here
            assert visitor.standing is Standing.NEW, n
            visitor.hear(with_length(0x30, b"\x00\x01tx"))
            await turns_of_the_loop(4)
        assert visitor.standing is Standing.STRANGER

    async def test_who_is_answered_while_it_waits_does_not_wait_on_among_strangers(self):
        house = House("", 10)
        visitor, _ = visitor_of(house)
        visitor.hear(subscribe(ANSWER))
        await turns_of_the_loop()
        house.wants(visitor)
        visitor.tell(said_on(ANSWER))
        assert list(map(len, house._turns._rows)) == [1, 0, 0, 0, 0]


class TestTurns:
    def waiting(self, turns: Turns[Sitting], standing: Standing, place: str, count: int) -> list[Sitting]:
        crowd = [Sitting(Seats(count), place, 0.0) for _ in range(count)]
        for one in crowd:
            one.standing = standing
            turns.wait(one)
        return crowd

    def test_heads_of_one_place_have_as_many_turns_as_those_of_many(self):
        turns: Turns[Sitting] = Turns()
        school = self.waiting(turns, Standing.PROVED, "school", 50)
        for n in range(200):
            self.waiting(turns, Standing.STRANGER, f"flood {n}", 2)
        had = []
        for _ in range(58):
            had.append(turns.next())
            turns.passed_on(1)
        assert [one for one in had if one in school] == school
        assert len([one for one in had[:51] if one in school]) == 50, "but for one word, theirs came first"

    def test_the_more_of_them_wait_the_less_is_a_turn(self):
        turns: Turns[Sitting] = Turns()
        for count, words in ((1, TURN), (ROUND // 2, 2), (HEADS, 1)):
            self.waiting(turns, Standing.PROVED, "school", count)
            turns.next()
            assert turns.words == words
            while turns:
                turns.next()

    def test_each_row_has_its_share_of_what_is_passed_on_and_whose_words_are_late_starve_nobody(self):
        turns: Turns[Sitting] = Turns()
        little, much = Sitting(Seats(1), "here", 0.0), Sitting(Seats(1), "there", 0.0)
        little.standing = Standing.NEW
        passed = {little: 0, much: 0}
        for _ in range(9000):
            for one in passed:
                turns.wait(one)
            whose = turns.next()
            passed[whose] += turns.passed_on(1 if whose is little else 0) // 1
        assert passed[little] == pytest.approx(9000 * SHARE / (SHARE + 1), rel=0.01)


def test_who_is_known_keeps_its_seat_while_there_are_others_and_leaves_some_to_those_who_come():
    seats: Seats[Sitting] = Seats(100)
    known = [Sitting(seats, "school", float(n)) for n in range(50)]
    for one in known:
        seats.heard(one, speaks=True)
        seats.know(one)
    for n in range(1000):
        seats.heard(Sitting(seats, f"flood {n % 200}", 100.0 + n), speaks=True)
    assert len(seats) == 100
    assert not any(one.left for one in known)
    for n in range(200):
        seats.know(late := Sitting(seats, f"more {n % 10}", 2000.0 + n))
        assert not late.left
    assert len(seats._known) <= KNOWN_PERCENT + 1
    assert sum(one.left for one in known) > 25, "of where most are"
    seats.gone(late)
    assert late not in list(seats)


@pytest.mark.long
@pytest.mark.waits
@pytest.mark.parametrize("arrive", ["before", "meanwhile"])
async def test_a_class_behind_one_router_drives_while_two_hundred_addresses_say_a_little_each(arrive):
    phones, moves = 20, 20
    with many_files():
        async with a_broker() as broker, a_server(broker) as server:
            await server.wait_connected(10)
            flood = Flood(frame(PUBLISHED) * 4, 10)
            for n in range(400):
                flood.add(await asyncio.to_thread(a_browser, port_of(broker), f"127.9.0.{n % 200 + 1}"))
            async with contextlib.AsyncExitStack() as here:
                if arrive == "meanwhile":
                    here.enter_context(flood)
                    await asyncio.sleep(2)

                async def come() -> Client:
                    client = await here.enter_async_context(Client(server.qr()))
                    await client.request(0, timeout_s=30)
                    return client

                school = await asyncio.gather(*(come() for _ in range(phones)))
                if arrive == "before":
                    here.enter_context(flood)
                    await asyncio.sleep(1)
                server.heard.clear()
                for n in range(moves):
                    for client in school:
                        await client.command("AB", "move_raw", {"left_x": 0, "left_y": n, "right_x": 0, "right_y": 0})
                    await asyncio.sleep(0.1)
                await asyncio.sleep(0.5)
                assert flood.is_there
            assert len(server.heard) > phones * moves // 2, "place by place it was one in a hundred"
