"""Bounded queue of received MQTT messages, which drops the newest or stale ones under load."""

from __future__ import annotations

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable

from .broker_packets import Arrived
from .packets import SocketEmptiedAt

# Limits of the queue: room for a burst of small messages, within the memory of a small machine.
INCOMING_MESSAGES = 2000  # under a second of work
# With a backlog of this length, messages older than STALE_S are dropped unopened. Otherwise a server that works through
# the backlog would refuse each command as late when its turn comes.
BACKLOG, STALE_S = 50, 0.2
INCOMING_BYTES = 64 * 1024 * 1024


class Incoming(asyncio.Queue[Arrived]):
    """Queue bounded in messages and in bytes of topic and payload; a message beyond the bounds is dropped.

    With a backlog, messages that have waited longer than `stale_s` are dropped as well.

    Args:
        on_overrun: called for each message that is dropped.
        emptied: time since which a message that arrives now may have waited in the socket.
        on_read: called for each message that is read, with its waiting time in seconds.
    """

    def __init__(
        self,
        on_overrun: Callable[[], None],
        emptied: SocketEmptiedAt,
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
        self._row: deque[tuple[float, Arrived]] = deque()  # messages, each with the earliest time of its arrival

    def qsize(self) -> int:
        """Return the number of queued messages."""
        return len(self._row)

    def empty(self) -> bool:
        """Return whether the queue is empty."""
        return not self._row

    def put_nowait(self, message: Arrived) -> None:
        """Queue a message, or drop it; never raises `QueueFull`."""
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
