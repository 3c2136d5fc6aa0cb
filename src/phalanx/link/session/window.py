"""Sliding window against replays: each record of a direction and generation is opened once. Source: RFC 4303 §3.4.3."""

from __future__ import annotations

from phalanx.errors import Replayed

WIDTH = 1024  # counters; a record further behind the newest is refused
COUNTER_LIMIT = 1 << 48  # out of reach in practice, and exact in JavaScript's numbers


class Window:
    """The received counters."""

    __slots__ = ("_newest", "_seen")

    def __init__(self) -> None:
        self._newest = -1
        self._seen = 0  # bit k: counter newest - k was received

    def is_newest(self, counter: int) -> bool:
        """Return whether a counter is larger than all received ones."""
        return counter > self._newest

    def check(self, counter: int) -> None:
        """Raise Replayed if the counter was received, or is too old to tell."""
        behind = self._newest - counter
        if counter >= COUNTER_LIMIT or behind >= WIDTH or (behind >= 0 and self._seen >> behind & 1):
            raise Replayed(f"counter {counter}, newest {self._newest}")

    def enter(self, counter: int) -> None:
        """Record a checked counter, once its record is authentic."""
        ahead = counter - self._newest
        if ahead > 0:
            # An authentic counter may jump: an unlimited shift would make a huge integer.
            self._seen = (self._seen << min(ahead, WIDTH) | 1) & ((1 << WIDTH) - 1)
            self._newest = counter
        else:
            self._seen |= 1 << -ahead
