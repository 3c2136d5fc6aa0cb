"""Questions to the swarm, which the guard holds aside: no command is behind one, and whoever asks without end keeps
nobody waiting who asks a little.

The gateway cannot tell visitors apart, for whoever has the pin asks as ever-new clients; here they are connections. An
answer is dear: the list of a thousand robots takes 20 ms of the gateway's time. So its queue is kept short, and who is
next is decided here. First comes who has asked next to nothing yet, or has proved the pin and asks little; the others
come after. In each row it goes head by head and place by place.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from typing import Generic, Protocol, TypeVar

from .heads import Standing
from .heard import Heard
from .pace import Pace
from .turns import SHARE, Placed, Turns

PACE = (100.0, 20.0)  # a second, and at once: all together, where the gateway does not say what it can do
AT_GATEWAY = 8  # that wait for their answers there, before more are passed on
# Of one visitor: a page asks four at once, and asks the same again if nothing comes. The newest are kept.
HELD, HELD_BYTES = 4, 16 * 1024
LITTLE = (0.5, 8.0)  # a second, and at once: a page asks every 20 s, a program every 1.5 s if it is not answered
FIRST = (0.01, 2.0)  # and what everybody may ask before those who asked more: the list, and what it is drawn on
LOOK_S = 0.01


class Asking(Placed, Protocol):
    """A visitor that may ask."""

    held: Held

    def ask_swarm(self, question: bytes) -> None:
        """Its question is passed on."""


Who = TypeVar("Who", bound=Asking)


class Held:
    """One visitor's questions, as packets."""

    def __init__(self) -> None:
        self.first, self.little = Pace(*FIRST), Pace(*LITTLE)
        self._waiting: deque[bytes] = deque()
        self._bytes = 0

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def add(self, question: bytes) -> None:
        """One more; the oldest go if that is too much, and one that alone is too much is not kept."""
        if len(question) > HELD_BYTES:
            return
        self._waiting.append(question)
        self._bytes += len(question)
        while len(self._waiting) > HELD or self._bytes > HELD_BYTES:
            self.pop()

    def pop(self) -> bytes:
        """The oldest."""
        question = self._waiting.popleft()
        self._bytes -= len(question)
        return question


class Questions(Generic[Who]):
    """Who waits to ask."""

    def __init__(self, heard: Heard | None) -> None:
        self._heard = heard
        self._pace = Pace(*PACE)
        self._first: Turns[Who] = Turns()
        self._others: Turns[Who] = Turns()
        self._firsts = 0
        self._told_at_s, self._since_told = 0.0, 0
        self._is_due = False

    def hold(self, who: Who, question: bytes) -> None:
        """It is passed on in its turn, at once if nobody else waits."""
        waits = bool(who.held)
        who.held.add(question)
        if not waits:
            self._wait(who)
        if not self._is_due:
            self._pass_on()

    def gone(self, who: Who) -> bool:
        """It has left; whether it waited."""
        return self._first.gone(who) or self._others.gone(who)

    def shows(self, who: Who) -> None:
        """It has shown more of itself."""
        if self.gone(who):
            self._wait(who)

    def _wait(self, who: Who) -> None:
        if not who.held:
            return
        now_s = time.monotonic()
        asks_much = who.held.little.wait_s(now_s) > 0.0
        # Whoever proved the pin and asks little is a page: strangers come anew as often as they like.
        if who.held.first.wait_s(now_s) and (asks_much or who.standing is not Standing.PROVED):
            self._others.wait(who, much=asks_much)
        else:
            self._first.wait(who)

    def _next(self) -> Who:
        # As of rows: of nine questions eight are of who goes first, if there are so many.
        is_first = bool(self._first) and not (self._others and self._firsts >= SHARE)
        self._firsts = self._firsts + 1 if is_first and self._others else 0
        turns = self._first if is_first else self._others
        who = turns.next()
        turns.passed_on(1)
        return who

    def _pass_on(self) -> None:
        while (self._first or self._others) and self._may_ask(time.monotonic()):
            who = self._next()
            self._pace.said()
            self._since_told += 1
            who.held.first.said()
            who.held.little.said()
            who.ask_swarm(who.held.pop())
            self._wait(who)
        self._is_due = bool(self._first or self._others)
        if self._is_due:
            asyncio.get_running_loop().call_later(LOOK_S, self._pass_on)

    def _may_ask(self, now_s: float) -> bool:
        if self._pace.wait_s(now_s):
            return False
        if self._heard is None:
            return True
        if self._heard.told_at_s != self._told_at_s:
            self._told_at_s, self._since_told = self._heard.told_at_s, 0
        return not self._told_at_s or self._heard.questions + self._since_told < AT_GATEWAY
