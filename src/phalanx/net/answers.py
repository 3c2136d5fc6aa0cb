"""Queue of requests, answered with a limited share of the event loop's time."""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Hashable
from typing import Generic, TypeVar

from phalanx.errors import Overrun

WAITING = 256  # requests; clients repeat those that are dropped
# In received bytes: parsed JSON can take 24 times as much, as with lists of empty lists.
WAITING_BYTES = 256 * 1024
REST = 2.0  # pause after an answer, as a multiple of the time that it took

Asked = TypeVar("Asked")


class Answers(Generic[Asked]):
    """Queue of at most `most` requests, with only the last of each sender and kind. `answer` must not raise.

    The list of a thousand robots takes 20 ms: fifty requests a second for it must not delay commands.
    """

    def __init__(self, answer: Callable[[Asked], Awaitable[None]], most: int = WAITING) -> None:
        self._answer = answer
        self._most, self._most_bytes = most, most * (WAITING_BYTES // WAITING)
        self._waiting: OrderedDict[Hashable, tuple[int, Asked]] = OrderedDict()
        self._bytes = 0
        self._asked = asyncio.Event()

    def ask(self, whose: Hashable, size: int, request: Asked) -> Asked | None:
        """Queue a request; return the request of the same sender and kind that it replaces, or None.

        Raises: Overrun: the queue is full.
        """
        before_size, before = self._waiting.get(whose, (0, None))
        grown = self._bytes + size - before_size
        if grown > self._most_bytes or (len(self._waiting) >= self._most and before is None):
            raise Overrun("requests arrive faster than they are answered")
        self._waiting[whose] = size, request
        self._bytes = grown
        self._asked.set()
        return before

    async def run(self) -> None:
        """Answer requests until cancelled."""
        while True:
            await self._asked.wait()
            _, (size, request) = self._waiting.popitem(last=False)
            self._bytes -= size
            if not self._waiting:
                self._asked.clear()
            began_s = time.thread_time()
            await self._answer(request)
            await asyncio.sleep(REST * (time.thread_time() - began_s))
