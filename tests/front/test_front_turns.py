"""Who is next, without sockets: paces, turns by address, newcomers, and the window of messages under way."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass, field

import pytest

from phalanx.config.front import FrontConfig
from phalanx.errors import UsageError
from phalanx.net.front.newcomers import Newcomers
from phalanx.net.front.turns import Turns
from phalanx.net.front.window import Window
from phalanx.pace import TokenBucket, TokenBuckets

NEVER = 1e-9  # per second


def plenty():
    return TokenBucket(1e9, 1e9, time.monotonic())


class TestPaces:
    def test_so_many_at_once_and_then_so_many_a_second(self):
        pace = TokenBucket(10.0, 3.0, 100.0)
        used = 0
        for tick in range(1000):
            now_s = 100.0 + tick / 1000
            if not pace.wait_s(now_s):
                pace.use()
                used += 1
        assert used == 3 + 9
        assert 0 < pace.wait_s(100.999) <= 0.1

    def test_whoever_does_not_wait_takes_as_many_and_a_clock_that_is_set_back_gives_none(self):
        pace = TokenBucket(20, 20, 0)
        assert [sum(pace.take(now_s) for _ in range(30)) for now_s in (0, 0.5, 0, 0.5, 100)] == [20, 10, 0, 0, 20]

    def test_a_debt_is_waited_for(self):
        pace = TokenBucket(10.0, 3.0, 100.0)
        pace.use(13)
        assert pace.wait_s(100.0) == pytest.approx(1.1)
        assert pace.wait_s(101.1) == pytest.approx(0)

    def test_addresses_that_used_nothing_lately_are_forgotten(self):
        paces = TokenBuckets(1.0, 2.0)
        paces.of("a", 100.0).use()
        paces.of("b", 100.0)
        paces.forget(100.5)
        assert len(paces) == 1
        paces.forget(101.0)
        assert len(paces) == 0


class TestTurns:
    def turns(self, **more):
        served, refused = [], []
        more = {"pace": plenty(), "waiting_max": 100} | more
        return Turns(served.append, refused.append, **more), served, refused

    async def test_an_address_waits_for_one_of_another_at_a_time(self):
        room = []
        turns, served, _ = self.turns(has_room=lambda: bool(room))
        for n in range(50):
            turns.add("many", f"m{n}")
        turns.add("few", "f0")
        turns.add("few", "f1")
        room.append(True)
        turns.run()
        assert served[:5] == ["m0", "f0", "m1", "f1", "m2"]
        assert len(served) == 52

    async def test_one_too_many_pushes_out_the_oldest_of_the_address_that_has_most(self):
        turns, _, refused = self.turns(waiting_max=5, has_room=lambda: False)
        for n in range(5):
            turns.add("many", f"m{n}")
        turns.add("few", "f0")
        turns.add("few", "f1")
        assert refused == ["m0", "m1"]

    async def test_an_address_that_used_its_pace_up_holds_up_nobody_else(self):
        turns, served, _ = self.turns(paces=TokenBuckets(NEVER, 2.0))
        for n in range(10):
            turns.add("many", f"m{n}")
        assert served == ["m0", "m1"]
        turns.add("few", "f0")
        assert served[2:] == ["f0"]

    async def test_an_address_is_charged_for_what_came_to_nothing_and_given_back_what_did_not(self):
        turns, served, _ = self.turns(paces=TokenBuckets(NEVER, 10.0))
        turns.charge("silent", 10)
        turns.charge("refused", 100)
        turns.charge("refused", -99)
        for address in ("silent", "refused", "new"):
            turns.add(address, address)
        assert served == ["refused", "new"]

    async def test_a_pace_that_is_used_up_is_waited_for(self):
        turns, served, _ = self.turns(pace=TokenBucket(200.0, 1.0, time.monotonic()))
        for n in range(5):
            turns.add("a", n)
        assert len(served) < 5
        while len(served) < 5:
            await asyncio.sleep(0.01)
        assert served == [0, 1, 2, 3, 4]

    async def test_who_has_gone_is_not_served(self):
        room = []
        turns, served, _ = self.turns(has_room=lambda: bool(room))
        turns.add("a", 1)
        turns.add("a", 2)
        assert turns.remove("a", 1)
        assert not turns.remove("a", 1)
        room.append(True)
        turns.run()
        assert served == [2]


@dataclass(eq=False)
class One:
    until_s: float = 100.0
    has_left: bool = False

    def leave(self):
        self.has_left = True


class TestNewcomers:
    def test_one_too_many_closes_the_oldest_of_its_address(self):
        silent = []
        newcomers = Newcomers(FrontConfig(newcomers_max_per_address=3), silent.append)
        here, there = [One() for _ in range(5)], One()
        newcomers.add("there", there)
        for each in here:
            newcomers.add("here", each)
        assert [each.has_left for each in here] == [True, True, False, False, False]
        assert not there.has_left
        assert silent == ["here"] * 2

    def test_one_too_many_in_all_closes_the_oldest_where_most_are(self):
        newcomers = Newcomers(FrontConfig(newcomers_max=4), [].append)
        here, there = [One() for _ in range(4)], [One(), One()]
        for each in here:
            newcomers.add("here", each)
        for each in there:
            newcomers.add("there", each)
        assert [each.has_left for each in here] == [True, True, False, False]
        assert not any(each.has_left for each in there)
        assert len(newcomers) == 4

    def test_who_is_admitted_counts_no_longer_and_who_is_late_is_closed(self):
        silent = []
        newcomers = Newcomers(FrontConfig(), silent.append)
        admitted, late, early = One(), One(), One(200.0)
        for each in (admitted, late, early):
            newcomers.add("here", each)
        newcomers.remove(admitted)
        newcomers.sweep(100.0)
        assert [each.has_left for each in (admitted, late, early)] == [False, True, False]
        assert len(newcomers) == 1
        assert silent == ["here"]


@dataclass(eq=False)
class Sender:
    name: str
    address: str = "here"
    is_admitted: bool = True
    awaits_answer: bool = False
    pending: asyncio.Future[None] | None = None


@dataclass
class Gateway:
    """A window, and what it passed on."""

    in_flight: int = 8
    newcomers_in_flight: int = 2
    passed: list[str] = field(default_factory=list)

    def __post_init__(self):
        limits = FrontConfig(in_flight=self.in_flight, newcomers_in_flight=self.newcomers_in_flight)
        self.window = Window(limits, lambda sender: self.passed.append(sender.name), time.monotonic())
        self.tasks = []

    async def say(self, *senders):
        self.tasks += [asyncio.create_task(self.turn(sender)) for sender in senders]
        await asyncio.sleep(0)

    async def turn(self, sender):
        if not self.window.go(sender):
            await self.window.turn(sender)


class TestTheWindow:
    async def test_so_many_are_under_way_and_the_rest_in_the_order_in_which_they_came(self):
        gateway = Gateway()
        await gateway.say(*(Sender(f"s{n}") for n in range(9)))
        assert gateway.passed == [f"s{n}" for n in range(6)]
        gateway.window.taken([1] * 2)
        assert gateway.passed[6:] == ["s6", "s7"]
        gateway.window.taken([1] * 1)
        assert gateway.passed[8:] == ["s8"]

    async def test_who_sends_much_waits_for_each_of_the_others(self):
        gateway = Gateway()
        loud, quiet = Sender("loud"), Sender("quiet")

        async def flood():
            while True:
                await gateway.turn(loud)

        flooding = asyncio.create_task(flood())
        await asyncio.sleep(0.01)
        assert gateway.passed == ["loud"] * 6
        await gateway.say(quiet)
        gateway.window.taken([1] * 2)
        assert gateway.passed[6:] == ["loud", "quiet"]
        flooding.cancel()

    async def test_newcomers_have_a_small_window_and_take_turns_by_address(self):
        gateway = Gateway()
        await gateway.say(*(Sender(f"n{n}", is_admitted=False) for n in range(20)))
        await gateway.say(Sender("other", "there", is_admitted=False))
        assert gateway.passed == ["n0", "n1"]
        await gateway.say(Sender("in"))
        assert gateway.passed[2:] == ["in"], "who is in does not wait for newcomers"
        gateway.window.taken([1, 1])
        assert gateway.passed[3:] == ["n2", "other"]

    async def test_newcomers_have_a_share_of_the_gateways_time_and_others_have_not_to_wait(self):
        gateway = Gateway()
        await gateway.say(*(Sender(f"n{n}", is_admitted=False) for n in range(4)))
        gateway.window.taken([60_000, 60_000])
        assert gateway.passed == ["n0", "n1"]
        await gateway.say(Sender("in"))
        assert gateway.passed[2:] == ["in"]
        gateway.window.taken([1_000_000])
        await gateway.say(Sender("in"))
        assert gateway.passed[3:] == ["in"]
        while len(gateway.passed) < 6:
            await asyncio.sleep(0.01)
        assert gateway.passed[4:] == ["n2", "n3"]

    async def test_those_who_are_in_never_take_the_window_of_newcomers(self):
        gateway = Gateway()
        await gateway.say(*(Sender(f"s{n}") for n in range(20)))
        await gateway.say(Sender("new", is_admitted=False))
        assert gateway.passed[6:] == ["new"]

    async def test_a_newcomer_waits_for_the_answer_before_its_next_message(self):
        gateway = Gateway(newcomers_in_flight=3)
        new = Sender("new", is_admitted=False)
        await gateway.say(new)
        await gateway.say(new)
        gateway.window.taken([1] * 1)
        assert gateway.passed == ["new"]
        gateway.window.answered(new)
        assert gateway.passed == ["new", "new"]

    async def test_one_admitted_while_it_waits_goes_on_as_one_who_is_in(self):
        gateway = Gateway(newcomers_in_flight=1)
        new, others = Sender("new", is_admitted=False), [Sender("o", "there", is_admitted=False) for _ in range(3)]
        await gateway.say(new)
        await gateway.say(new, *others)
        new.is_admitted = True
        gateway.window.answered(new)
        assert gateway.passed == ["new", "new"]

    async def test_who_has_gone_is_not_passed_on(self):
        gateway = Gateway()
        gone = Sender("gone")
        await gateway.say(*(Sender(f"s{n}") for n in range(6)), gone)
        gateway.window.drop(gone)
        await gateway.tasks[-1]
        gateway.window.taken([1] * 6)
        assert "gone" not in gateway.passed


def test_limits_are_positive_and_one_message_fits():
    with pytest.raises(UsageError, match="connections_max"):
        FrontConfig(connections_max=0)
    with pytest.raises(UsageError, match="bytes_at_once"):
        FrontConfig(bytes_at_once=100.0)
