"""Messages that came and wait to be read: which is next, and which are dropped."""

from __future__ import annotations

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable

from .broker_packets import Arrived
from .packets import Emptied

# What may wait to be read: room for a burst of small messages, and no more memory than a small machine has.
INCOMING_MESSAGES = 2000  # under a second of work: what waits longer is stale news and late commands
# A server that has so many behind a message leaves what has waited so long unopened. Opened, it would be refused as
# late, and so would all behind it: a server that works through a backlog in its order obeys nobody.
BACKLOG, STALE_S = 50, 0.2
INCOMING_BYTES = 64 * 1024 * 1024


class Incoming(asyncio.Queue[Arrived]):
    """Messages that wait to be read, bounded in number and in bytes of topic and payload; the newest are dropped.

    Of more than a few those that have waited longer than `stale_s` are dropped as well, whosesoever they are.

    `on_overrun` is called for every message that is dropped, `on_read` for every one that is read, with the seconds it
    has waited here; `emptied` tells since when a message that comes now may have waited.
    """

    def __init__(
        self,
        on_overrun: Callable[[], None],
        emptied: Emptied,
        on_read: Callable[[float], None],
        maxsize: int = INCOMING_MESSAGES,
        max_bytes: int = INCOMING_BYTES,
        stale_s: float = math.inf,
    ) -> None:
        super().__init__()
        self._most, self._stale_s = maxsize, stale_s
        self._emptied = emptied
        self._on_read = on_read
        self._on_overrun = on_overrun
        self._room_bytes = max_bytes
        self._row: deque[tuple[float, Arrived]] = deque()  # since when they may have waited, and they

    def qsize(self) -> int:
        """How many wait."""
        return len(self._row)

    def empty(self) -> bool:
        """Whether none waits."""
        return not self._row

    def put_nowait(self, message: Arrived) -> None:
        """Take the message or drop it; never `QueueFull`."""
        if len(self._row) >= self._most or message.size > self._room_bytes:
            self._on_overrun()
        else:
            super().put_nowait(message)

    def _put(self, message: Arrived) -> None:
        self._room_bytes -= message.size
        self._row.append((self._emptied.at_s, message))

    def _get(self) -> Arrived:
        while True:
            since_s, message = self._row.popleft()
            self._room_bytes += message.size
            waited_s = time.monotonic() - since_s
            if waited_s <= self._stale_s or self.qsize() < BACKLOG:
                self._on_read(waited_s)
                return message
            self._on_overrun()
