"""The replay cache: every authentic message counts once."""

from __future__ import annotations

import math

from phalanx.errors import CacheFull, Replayed, Stale

LEAST_AT_ONCE = 64  # of a small cache too: a list of many robots comes in one second


class ReplayCache:
    """Remembers (epoch, IV) until the message would be stale anyway: until |now - timestamp| passes `tolerance_s`.

    When full it refuses: forgetting inside the window would let a flood reopen the door to a replay. It fills no faster
    than it empties, but for an eighth at once: so it is full for no longer than somebody floods, however the flood is
    dated.

    Source: docs/spec/link.md; the published packages have none and accept a replayed ciphertext.
    """

    def __init__(self, capacity: int, tolerance_s: float) -> None:
        self._capacity = capacity
        self._at_once = max(LEAST_AT_ONCE, capacity / 8)
        # Dated ahead, a message stays for twice the tolerance, and up to two seconds more until its second is swept.
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
        """Take note of an authentic message, or refuse it. A refused message leaves the cache unchanged.

        The epoch is its topic; the timestamp is the sender's, and finite.

        Raises: Stale, Replayed, CacheFull.
        """
        skew_s = timestamp_s - now_s
        if not abs(skew_s) <= self._tolerance_s:
            raise Stale(skew_s, self._tolerance_s)
        self._sweep(now_s)
        second = math.floor(timestamp_s + self._tolerance_s) + 1
        if second <= self._swept_to:
            # The clock was set back: this message may be one we have already forgotten.
            raise Stale(skew_s, self._tolerance_s)
        entry = (epoch, iv)
        if entry in self._seen:
            raise Replayed("this IV was seen before")
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
        # An entry of second s was stale from s on: its timestamp + tolerance lies below s.
        for second in [second for second in self._by_second if second <= now_s]:
            self._seen.difference_update(self._by_second.pop(second))
        self._swept_to = math.floor(now_s)
