"""The guard: a process that visitors of a broker of ours come to, and that passes on to it what visitors send.

mosquitto keeps what it is given: sessions that sleep, subscriptions, news for readers that stall, connections that say
nothing. Here each visitor may have a little of everything, and all of them together a fixed amount. What they want of
us they get in turns (`turns.py`), head by head who has proved the pin and place by place the others, and so much at
once that this loop is never late; whoever is not to be contented is hung up on. The control loop lives in another
process, and is held up by nothing of it.

Started by `guarding.py`: `python -m phalanx.io.guard PARENT SOCKET HEARD DOOR…`: whose child it is, the paths of the
broker's socket and of what the gateway tells (`heard.py`), and the numbers of sockets that listen: for whoever watches
us, for programs, and for browsers.
"""

from __future__ import annotations

import asyncio
import signal
import socket
import sys
import time
from collections import Counter
from pathlib import Path

from .children import end_with
from .files import allow_files
from .heads import Heads, Standing
from .heard import Heard
from .pace import HousePace
from .questions import Questions
from .seats import Seats, place_of
from .turns import Turns
from .visitor import READ_BYTES, Visitor

VISITORS = 1000
FILES_EACH, FILES_APART = 2, 64
MANY_FILES = 4096
OUT_OF_FILES_S = 1.0
# For slow readers, many of `visitor.WAITING_BYTES`; and of who says packets that are not whole, and no more of them.
WAITING_IN_ALL_BYTES = 64 * 1024 * 1024
IN_LINE = 8  # between their CONNECT and its answer, place by place: the broker's own line knows no places
AT_ONCE_S = 0.002  # before we look who else said something, and who comes
FEW_PACKETS_S = 0.002
CHECK_S = 0.25
# We are busy if we pass on all that we may, or use so much of a processor's time; not if it is others who do.
BUSY = 0.25
PATIENCE = 12  # checks


class House(Seats[Visitor]):
    """Who is here, who has a turn, and what waits for them."""

    def __init__(self, broker: str, most: int, heard: Heard | None = None) -> None:
        super().__init__(most)
        self.broker = broker
        self.buffer = memoryview(bytearray(READ_BYTES))
        self.questions: Questions[Visitor] = Questions(heard)
        self._heard, self._pace = heard, HousePace(heard)
        self.waiting_bytes = 0
        self._turns: Turns[Visitor] = Turns()
        self._line: Turns[Visitor] = Turns()
        self._heads = Heads()
        self._readers: dict[bytes, Visitor] = {}
        self._asking = 0
        self._is_busy = self._has_turns = False
        self._used_s = time.thread_time()

    def wants(self, visitor: Visitor) -> None:
        """It gets a turn."""
        self._turns.wait(visitor, much=visitor.says_much(time.monotonic()))
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

    def shows(self, visitor: Visitor, shown: Standing) -> None:
        """It hears the swarm, or was answered: then it counts as a head, if there is room for one more of its place."""
        if visitor.standing is Standing.HEARS is shown:
            return
        if shown is Standing.PROVED and self._heads.one_more(visitor.place):
            visitor.standing = shown
            self.know(visitor)
        else:
            visitor.standing = Standing.HEARS
        if self._turns.gone(visitor):  # it waits among those who have shown less
            self._turns.wait(visitor, much=visitor.says_much(time.monotonic()))
        self.questions.shows(visitor)

    def asks(self, visitor: Visitor) -> None:
        """It asks the broker to let it in, when it is its turn."""
        self._line.wait(visitor)
        self._next_in_line()

    def _next_in_line(self) -> None:
        while self._line and self._asking < IN_LINE:
            self._asking += 1
            self._line.next().ask()

    def answered(self) -> None:
        """The broker has answered one."""
        self._asking -= 1
        self._next_in_line()

    def reads(self, visitor: Visitor, answers: frozenset[bytes]) -> None:
        """It alone reads these answers now: with many readers a small question was gigabytes for the broker.

        Whoever read one before reads it no longer, and keeps all else: its name can be learnt. It may be the same
        phone, which came again.
        """
        for name in visitor.answers - answers:
            del self._readers[name]
        for name in answers - visitor.answers:
            if other := self._readers.get(name):
                other.loses(name)
        self._readers.update(dict.fromkeys(answers, visitor))
        visitor.answers = answers

    def forget(self, visitor: Visitor) -> None:
        """It has left, and wants nothing any more."""
        self.reads(visitor, frozenset())
        self.gone(visitor)
        if visitor.standing is Standing.PROVED:
            visitor.standing = Standing.STRANGER
            self._heads.one_less(visitor.place)
        for row in (self._turns, self._line, self.questions):
            row.gone(visitor)

    def quiet(self, now_s: float) -> None:
        """Hang up on half of those who say too much again and again, or while we are busy much or without an end.

        Of those first who come from where the most of them do, and who did so for longest.
        """
        before_s, self._used_s = self._used_s, time.thread_time()
        is_busy = self._is_busy or self._used_s - before_s > BUSY * CHECK_S
        self._is_busy = False
        for visitor in self:
            is_loud = visitor.says_too_much(now_s) or (is_busy and visitor.says_much(now_s))
            visitor.loud_checks = visitor.loud_checks + 1 if is_loud else 0
        loud = [visitor for visitor in self if visitor.loud_checks >= PATIENCE]
        places = Counter(visitor.place for visitor in loud)
        loud.sort(key=lambda each: (places[each.place], each.loud_checks), reverse=True)
        for visitor in loud[: (len(loud) + 1) // 2]:
            visitor.leave()

    def waits(self, more: int) -> None:
        """So many bytes more, or less, wait for visitors or for us."""
        self.waiting_bytes += more
        if self.waiting_bytes > WAITING_IN_ALL_BYTES:
            self.make_room()

    def make_room(self) -> None:
        """Hang up on those for whom and of whom we keep the most, until what we keep is a part of what may be."""
        kept = sorted(self, key=Visitor.kept_bytes, reverse=True)
        self.waiting_bytes = sum(map(Visitor.kept_bytes, kept))
        if self.waiting_bytes > WAITING_IN_ALL_BYTES:
            for visitor in kept:
                if self.waiting_bytes <= WAITING_IN_ALL_BYTES // 2:
                    return
                self.waiting_bytes -= visitor.kept_bytes()
                visitor.leave()

    async def watch(self) -> None:
        """Hang up on who says nothing at first, reads nothing or is too loud, until cancelled."""
        while True:
            await asyncio.sleep(CHECK_S)
            self.check(time.monotonic())

    def check(self, now_s: float) -> None:
        """What is done every `CHECK_S`."""
        for visitor in [v for v in self if v.is_overdue(now_s)]:
            visitor.leave()
        self.make_room()
        self.quiet(now_s)


class Door:
    """One at which visitors come."""

    def __init__(self, house: House, listening: socket.socket, *, browser: bool) -> None:
        self._house, self._listening, self._browser = house, listening, browser
        listening.setblocking(False)

    def open(self) -> None:
        """Whoever comes is let in."""
        asyncio.get_running_loop().add_reader(self._listening, self._come)

    def _come(self) -> None:
        until_s = time.monotonic() + AT_ONCE_S
        while time.monotonic() < until_s:
            try:
                connection, address = self._listening.accept()
            except (BlockingIOError, ConnectionError):
                return
            except OSError:  # no file is left: somebody goes soon
                loop = asyncio.get_running_loop()
                loop.remove_reader(self._listening)
                loop.call_later(OUT_OF_FILES_S, self.open)
                return
            connection.setblocking(False)
            place = place_of(address[0]) if address else ""
            Visitor(self._house, connection, place, browser=self._browser)


async def guard(broker: str, heard: Heard, *doors: socket.socket) -> None:
    """Let visitors in until SIGTERM."""
    house = House(broker, min(VISITORS, (allow_files(MANY_FILES) - FILES_APART) // FILES_EACH), heard)
    over = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, over.set)
    for listening in doors:
        Door(house, listening, browser=listening is doors[-1]).open()
    watching = asyncio.create_task(house.watch())
    await over.wait()
    watching.cancel()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the gateway, which ends us when the last word is out
    parent, broker, heard, *doors = sys.argv[1:]
    end_with(int(parent))
    asyncio.run(guard(broker, Heard(Path(heard)), *(socket.socket(fileno=int(number)) for number in doors)))
