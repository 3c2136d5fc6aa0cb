"""Requests that wait for their answers, which have a share of the event loop's time and no more."""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Hashable
from typing import Generic, TypeVar

from phalanx.errors import Overrun

WAITING = 256  # requests; clients ask again
# As they came: empty lists in a list are twenty-four times as long when they are read.
WAITING_BYTES = 256 * 1024
REST = 2.0  # for so many times as long as it took to answer, others have the loop

Asked = TypeVar("Asked")


class Answers(Generic[Asked]):
    """Requests that wait, `most` of them: of one sender, and of one kind, the last. `answer` must not raise.

    The list of a thousand robots is 20 ms of work: asking for it fifty times a second must hold up no command.
    """

    def __init__(self, answer: Callable[[Asked], Awaitable[None]], most: int = WAITING) -> None:
        self._answer = answer
        self._most, self._most_bytes = most, most * (WAITING_BYTES // WAITING)
        self._waiting: OrderedDict[Hashable, tuple[int, Asked]] = OrderedDict()
        self._bytes = 0
        self._asked = asyncio.Event()

    def ask(self, whose: Hashable, size: int, request: Asked) -> Asked | None:
        """Queue a request; return the one of the same sender and kind whose place it takes, or None.

        Raises: Overrun: too many wait.
        """
        before_size, before = self._waiting.get(whose, (0, None))
        grown = self._bytes + size - before_size
        if grown > self._most_bytes or (len(self._waiting) >= self._most and before is None):
            raise Overrun("asked faster than it could be answered")
        self._waiting[whose] = size, request
        self._bytes = grown
        self._asked.set()
        return before

    async def run(self) -> None:
        """Answer, until cancelled."""
        while True:
            await self._asked.wait()
            _, (size, request) = self._waiting.popitem(last=False)
            self._bytes -= size
            if not self._waiting:
                self._asked.clear()
            began_s = time.thread_time()
            await self._answer(request)
            await asyncio.sleep(REST * (time.thread_time() - began_s))
