"""Who is in the guard's house, who has a turn, who is next at the broker, and what is kept for them all."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from typing import Protocol

from .heads import Heads, Standing
from .heard import Heard
from .pace import HousePace
from .questions import Asking, Questions
from .seats import Seated, Seats
from .turns import Turns

READ_BYTES = 64 * 1024
# For slow readers, many of `visitor.WAITING_BYTES`; and of who says packets that are not whole, and no more of them.
WAITING_IN_ALL_BYTES = 64 * 1024 * 1024
IN_LINE = 8  # between their CONNECT and its answer, place by place: the broker's own line knows no places
AT_ONCE_S = 0.002  # before we look who else said something, and who comes
FEW_PACKETS_S = 0.002
CHECK_S = 0.25
# We are busy if we pass on all that we may, or use so much of a processor's time; not if it is others who do.
BUSY = 0.25
PATIENCE = 12  # checks


class Guest(Seated, Asking, Protocol):
    """A visitor, as the house knows it (visitor.Visitor is one)."""

    answers: frozenset[bytes]  # that it reads
    loud_checks: int  # so often in a row it said too much

    def turn(self, now_s: float) -> float:
        """A part of what it said is heard; how much there is to do for it later."""

    def ask(self) -> None:
        """It is the next in line."""

    def loses(self, name: bytes) -> None:
        """Another one reads the answers on this topic now."""

    def says_much(self, now_s: float) -> bool:
        """Whether it said more than a phone lately."""

    def says_too_much(self, now_s: float) -> bool:
        """Whether it said most of what it may."""

    def is_overdue(self, now_s: float) -> bool:
        """Whether it should have said or read something by now."""

    def kept_bytes(self) -> int:
        """What is kept of it and for it."""


class Line:
    """Who asks the broker to let it in, a few at a time."""

    def __init__(self) -> None:
        self._waiting: Turns[Guest] = Turns()
        self._asking = 0

    def asks(self, guest: Guest) -> None:
        """It asks when it is its turn."""
        self._waiting.wait(guest)
        self._next()

    def answered(self) -> None:
        """The broker has answered one."""
        self._asking -= 1
        self._next()

    def gone(self, guest: Guest) -> bool:
        """It does not wait any more; whether it did."""
        return self._waiting.gone(guest)

    def _next(self) -> None:
        while self._waiting and self._asking < IN_LINE:
            self._asking += 1
            self._waiting.next().ask()


class Readers:
    """Who reads which answers: one each, as with many readers a small question was gigabytes for the broker."""

    def __init__(self) -> None:
        self._of: dict[bytes, Guest] = {}

    def reads(self, guest: Guest, answers: frozenset[bytes]) -> None:
        """It alone reads these answers now.

        Whoever read one before reads it no longer, and keeps all else: its name can be learnt. It may be the same
        phone, which came again.
        """
        for name in guest.answers - answers:
            del self._of[name]
        for name in answers - guest.answers:
            if other := self._of.get(name):
                other.loses(name)
        self._of.update(dict.fromkeys(answers, guest))
        guest.answers = answers


class House(Seats[Guest]):
    """Who is here, who has a turn, and who has to leave."""

    def __init__(self, broker: str, most: int, heard: Heard | None = None) -> None:
        super().__init__(most)
        self.broker = broker
        self.buffer = memoryview(bytearray(READ_BYTES))
        self.questions: Questions[Guest] = Questions(heard)
        self.line, self.readers = Line(), Readers()
        self._heard, self._pace = heard, HousePace(heard)
        self.waiting_bytes = 0
        self._turns: Turns[Guest] = Turns()
        self._heads = Heads()
        self._is_busy = self._has_turns = False
        self._used_s = time.thread_time()

    def wants(self, guest: Guest) -> None:
        """It gets a turn."""
        self._turns.wait(guest, much=guest.says_much(time.monotonic()))
        if not self._has_turns:
            self._has_turns = True
            asyncio.get_running_loop().call_soon(self._give_turns)

    def _give_turns(self) -> None:
        # Of the processor's time: by the clock, whoever shares a busy machine would give a turn or two at once.
        until_s, pause_s = time.thread_time() + AT_ONCE_S, 0.0
        try:
            while self._turns and time.thread_time() < until_s:
                if self._pace.wait_s(now_s := time.monotonic()):
                    self._is_busy, pause_s = True, FEW_PACKETS_S
                    return
                until_s -= self._turns.next().turn(now_s)
        finally:
            self._has_turns = bool(self._turns)
            if self._has_turns:
                asyncio.get_running_loop().call_later(pause_s, self._give_turns)

    def passes_on(self, words: int) -> None:
        """So much of what somebody says in its turn."""
        self._pace.said(self._turns.passed_on(words))

    def drops(self) -> None:
        """What somebody said comes too late: whoever watches the gateway sees how much."""
        if self._heard:
            self._heard.drop()

    def passes_aside(self, words: int) -> None:
        """So much of what was held aside, in nobody's turn."""
        self._pace.said(words)

    @property
    def words(self) -> int:
        """That a turn is worth just now."""
        return self._turns.words

    def shows(self, guest: Guest, shown: Standing) -> None:
        """It hears the swarm, or was answered: then it counts as a head, if there is room for one more of its place."""
        if guest.standing is Standing.HEARS is shown:
            return
        if shown is Standing.PROVED and self._heads.one_more(guest.place):
            guest.standing = shown
            self.know(guest)
        else:
            guest.standing = Standing.HEARS
        if self._turns.gone(guest):  # it waits among those who have shown less
            self._turns.wait(guest, much=guest.says_much(time.monotonic()))
        self.questions.shows(guest)

    def forget(self, guest: Guest) -> None:
        """It has left, and wants nothing any more."""
        self.readers.reads(guest, frozenset())
        self.gone(guest)
        if guest.standing is Standing.PROVED:
            guest.standing = Standing.STRANGER
            self._heads.one_less(guest.place)
        for row in (self._turns, self.line, self.questions):
            row.gone(guest)

    def quiet(self, now_s: float) -> None:
        """Hang up on half of those who say too much again and again, or while we are busy much or without an end.

        Of those first who come from where the most of them do, and who did so for longest.
        """
        before_s, self._used_s = self._used_s, time.thread_time()
        is_busy = self._is_busy or self._used_s - before_s > BUSY * CHECK_S
        self._is_busy = False
        for guest in self:
            is_loud = guest.says_too_much(now_s) or (is_busy and guest.says_much(now_s))
            guest.loud_checks = guest.loud_checks + 1 if is_loud else 0
        loud = [guest for guest in self if guest.loud_checks >= PATIENCE]
        places = Counter(guest.place for guest in loud)
        loud.sort(key=lambda each: (places[each.place], each.loud_checks), reverse=True)
        for guest in loud[: (len(loud) + 1) // 2]:
            guest.leave()

    def waits(self, more: int) -> None:
        """So many bytes more, or less, wait for visitors or for us."""
        self.waiting_bytes += more
        if self.waiting_bytes > WAITING_IN_ALL_BYTES:
            self.make_room()

    def make_room(self) -> None:
        """Hang up on those for whom and of whom we keep the most, until what we keep is a part of what may be."""
        kept = {guest: guest.kept_bytes() for guest in self}
        self.waiting_bytes = sum(kept.values())
        if self.waiting_bytes > WAITING_IN_ALL_BYTES:
            for guest in sorted(kept, key=kept.__getitem__, reverse=True):
                if self.waiting_bytes <= WAITING_IN_ALL_BYTES // 2:
                    return
                self.waiting_bytes -= kept[guest]
                guest.leave()

    async def watch(self) -> None:
        """Hang up on who says nothing at first, reads nothing or is too loud, until cancelled."""
        while True:
            await asyncio.sleep(CHECK_S)
            self.check(time.monotonic())

    def check(self, now_s: float) -> None:
        """What is done every `CHECK_S`."""
        for guest in [v for v in self if v.is_overdue(now_s)]:
            guest.leave()
        self.make_room()
        self.quiet(now_s)
