"""Requests that wait for their answers, which get a share of this loop's time and no more.

The list of a thousand robots is 20 ms of work: whoever asks for it fifty times a second shall hold up no command.
"""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable

from phalanx.errors import Overrun
from phalanx.link.messages import Request

WAITING = 256  # requests; clients ask again
# As they came: empty lists in a list are twenty-four times as long when they are read.
WAITING_BYTES = 256 * 1024
REST = 2.0  # for so many times as long as it took to answer, others have the loop


class Answers:
    """Who waits: of one client, and with one number, only what it asked last. `answer` must not raise."""

    def __init__(self, answer: Callable[[Request], Awaitable[None]]) -> None:
        self._answer = answer
        self._waiting: OrderedDict[tuple[str, int], Request] = OrderedDict()
        self._bytes = 0
        self._asked = asyncio.Event()

    def __len__(self) -> int:
        """How many wait."""
        return len(self._waiting)

    def ask(self, request: Request) -> None:
        """It is answered in its turn. Raises: Overrun: too many wait."""
        whose = request.client_id, request.number
        before = self._waiting.get(whose)
        grown = self._bytes + request.size - (before.size if before else 0)
        if grown > WAITING_BYTES or (len(self._waiting) >= WAITING and before is None):
            raise Overrun("asked faster than it could be answered")
        self._waiting[whose] = request
        self._bytes = grown
        self._asked.set()

    async def run(self) -> None:
        """Answer, until cancelled."""
        while True:
            await self._asked.wait()
            _, request = self._waiting.popitem(last=False)
            self._bytes -= request.size
            if not self._waiting:
                self._asked.clear()
            began_s = time.thread_time()
            await self._answer(request)
            await asyncio.sleep(REST * (time.thread_time() - began_s))
