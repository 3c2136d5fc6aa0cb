"""Replay cache: each authentic message is accepted once."""

from __future__ import annotations

import math

from phalanx.errors import CacheFull, Replayed, Stale

LEAST_AT_ONCE = 64  # burst that a small cache accepts too: a command for each of many robots comes in one second


class ReplayCache:
    """Set of the received (epoch, IV), each kept until its message is stale: |now - timestamp| > `tolerance_s`.

    A full cache refuses messages: if it dropped entries that are not stale, a flood would make replays possible. Apart
    from a burst of an eighth of its capacity, it accepts messages no faster than entries expire. So it is full only
    while a flood lasts, whatever timestamps the flood has.

    Source: docs/spec/link.md; the published packages have no cache and accept a replayed ciphertext.
    """

    def __init__(self, capacity: int, tolerance_s: float) -> None:
        self._capacity = capacity
        self._at_once = max(LEAST_AT_ONCE, capacity / 8)
        # A message with a future timestamp is kept for twice the tolerance, and up to 2 s more until it is swept.
        self._a_second = capacity * 7 / 8 / (2 * tolerance_s + 2)
        self._room = self._at_once
        self._filled_at_s = -math.inf
        self._tolerance_s = tolerance_s
        self._seen: set[tuple[str, bytes]] = set()
        # Entries by the whole second in which they expire: a sweep drops whole seconds and never sorts.
        self._by_second: dict[int, list[tuple[str, bytes]]] = {}
        self._swept_to = -math.inf

    def __len__(self) -> int:
        return len(self._seen)

    def enter(self, epoch: str, iv: bytes, timestamp_s: float, now_s: float) -> None:
        """Record an authentic message, or refuse it. A refused message leaves the cache unchanged.

        Args:
            epoch: topic of the message's epoch.
            timestamp_s: the sender's clock; finite.

        Raises: Stale, Replayed, CacheFull.
        """
        skew_s = timestamp_s - now_s
        if not abs(skew_s) <= self._tolerance_s:
            raise Stale(skew_s, self._tolerance_s)
        self._sweep(now_s)
        second = math.floor(timestamp_s + self._tolerance_s) + 1
        if second <= self._swept_to:
            # The clock was set back: the cache may have dropped this message already.
            raise Stale(skew_s, self._tolerance_s)
        entry = (epoch, iv)
        if entry in self._seen:
            raise Replayed("IV received before")
        if len(self._seen) >= self._capacity:
            raise CacheFull(f"{self._capacity} messages within {2 * self._tolerance_s:g} s")
        if now_s > self._filled_at_s:
            self._room = min(self._at_once, self._room + (now_s - self._filled_at_s) * self._a_second)
        self._filled_at_s = now_s
        if self._room < 1:
            raise CacheFull(f"{self._a_second:g} messages a second")
        self._room -= 1
        self._seen.add(entry)
        self._by_second.setdefault(second, []).append(entry)

    def _sweep(self, now_s: float) -> None:
        if now_s <= self._swept_to + 1:
            return
        # An entry of second s is stale from s on: its timestamp + tolerance is below s.
        for second in [second for second in self._by_second if second <= now_s]:
            self._seen.difference_update(self._by_second.pop(second))
        self._swept_to = math.floor(now_s)
