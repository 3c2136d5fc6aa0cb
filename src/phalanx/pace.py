"""Rates of clients, visitors and addresses, a token bucket each. Times are seconds on a clock that never runs back."""

from __future__ import annotations


class Pace:
    """A token bucket: up to so many at once. What exceeds it is waited for, or refused."""

    __slots__ = ("_at_once", "_at_s", "_left", "_per_s")

    def __init__(self, per_s: float, at_once: float, now_s: float) -> None:
        self._per_s, self._at_once = per_s, at_once
        self._left, self._at_s = at_once, now_s

    def wait_s(self, now_s: float) -> float:
        """Return how long to wait before one more may be used; 0: not at all."""
        self._left = min(self._at_once, self._left + (now_s - self._at_s) * self._per_s)
        self._at_s = now_s
        return 0.0 if self._left >= 1.0 else (1.0 - self._left) / self._per_s

    def use(self, count: float = 1.0) -> None:
        """Use so many; a debt that this makes is waited for."""
        self._left -= count

    def take(self, now_s: float) -> bool:
        """Use one; return whether there was one."""
        if self.wait_s(now_s):
            return False
        self._left -= 1.0
        return True

    def is_full(self, now_s: float) -> bool:
        """Return whether nothing was used lately."""
        return self._left + (now_s - self._at_s) * self._per_s >= self._at_once


class Paces:
    """A pace for each address, forgotten when it is full again."""

    def __init__(self, per_s: float, at_once: float) -> None:
        self._per_s, self._at_once = per_s, at_once
        self._of: dict[str, Pace] = {}

    def __len__(self) -> int:
        return len(self._of)

    def of(self, address: str, now_s: float) -> Pace:
        """Return the pace of an address."""
        pace = self._of.get(address)
        if pace is None:
            pace = self._of[address] = Pace(self._per_s, self._at_once, now_s)
        return pace

    def forget(self, now_s: float) -> None:
        """Forget addresses that used nothing lately; call it about once a second."""
        self._of = {address: pace for address, pace in self._of.items() if not pace.is_full(now_s)}
