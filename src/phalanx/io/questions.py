"""Questions to the swarm, which the guard holds aside: no command is behind one, and whoever asks without end keeps
nobody waiting who asks a little.

The gateway cannot tell visitors apart, for whoever has the pin asks as ever-new clients; here they are connections. An
answer is dear, the list of a thousand robots 20 ms of the gateway's time: so its queue is kept short, and who is next
is decided here, head by head and place by place.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from typing import Generic, Protocol, TypeVar

from .heard import Heard
from .pace import Pace
from .turns import Placed, Turns

PACE = (100.0, 20.0)  # a second, and at once: all together, where the gateway does not say what it can do
AT_GATEWAY = 8  # that wait for their answers there, before more are passed on
# Of one visitor: a page asks four at once, and asks the same again if nothing comes. The newest are kept.
HELD, HELD_BYTES = 4, 16 * 1024
LITTLE = (0.5, 8.0)  # a second, and at once: a page asks every 20 s, a program every 1.5 s if it is not answered
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
        self.little = Pace(*LITTLE)
        self._waiting: deque[bytes] = deque()
        self._bytes = 0

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def add(self, question: bytes) -> None:
        """One more; the oldest go if that is too much."""
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
        self._turns: Turns[Who] = Turns()
        self._told_at_s, self._since_told = 0.0, 0
        self._is_due = False

    def hold(self, who: Who, question: bytes) -> None:
        """It is passed on in its turn, at once if nobody else waits."""
        who.held.add(question)
        self._wait(who)
        if not self._is_due:
            self._pass_on()

    def gone(self, who: Who) -> None:
        """It has left."""
        self._turns.gone(who)

    def shows(self, who: Who) -> None:
        """It has shown more of itself."""
        if self._turns.gone(who):
            self._wait(who)

    def _wait(self, who: Who) -> None:
        if who.held:
            self._turns.wait(who, much=who.held.little.wait_s(time.monotonic()) > 0.0)

    def _pass_on(self) -> None:
        while self._turns and self._may_ask(time.monotonic()):
            who = self._turns.next()
            self._turns.passed_on(1)
            self._pace.said()
            self._since_told += 1
            who.held.little.said()
            who.ask_swarm(who.held.pop())
            self._wait(who)
        self._is_due = bool(self._turns)
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
