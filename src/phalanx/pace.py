"""Token buckets that limit the rates of clients, visitors and addresses. Times are seconds on a monotonic clock."""

from __future__ import annotations


class TokenBucket:
    """Token bucket: `per_s` tokens a second, at most `at_once` stored. Callers wait for more, or refuse the request."""

    __slots__ = ("_at_once", "_at_s", "_left", "_per_s")

    def __init__(self, per_s: float, at_once: float, now_s: float) -> None:
        self._per_s, self._at_once = per_s, at_once
        self._left, self._at_s = at_once, now_s

    def wait_s(self, now_s: float) -> float:
        """Return the seconds until a token is available; 0 if one is available now."""
        self._left = min(self._at_once, self._left + (now_s - self._at_s) * self._per_s)
        self._at_s = now_s
        return 0.0 if self._left >= 1.0 else (1.0 - self._left) / self._per_s

    def use(self, count: float = 1.0) -> None:
        """Take `count` tokens, even more than are left: `wait_s` includes the debt."""
        self._left -= count

    def take(self, now_s: float) -> bool:
        """Take a token if one is available; return False if not."""
        if self.wait_s(now_s):
            return False
        self._left -= 1.0
        return True

    def is_full(self, now_s: float) -> bool:
        """Return True if the bucket is full again: no token was taken lately."""
        return self._left + (now_s - self._at_s) * self._per_s >= self._at_once


class TokenBuckets:
    """Token buckets by address; `forget` drops those that are full."""

    def __init__(self, per_s: float, at_once: float) -> None:
        self._per_s, self._at_once = per_s, at_once
        self._of: dict[str, TokenBucket] = {}

    def __len__(self) -> int:
        return len(self._of)

    def of(self, address: str, now_s: float) -> TokenBucket:
        """Return the token bucket of an address, which is made at the first call."""
        pace = self._of.get(address)
        if pace is None:
            pace = self._of[address] = TokenBucket(self._per_s, self._at_once, now_s)
        return pace

    def forget(self, now_s: float) -> None:
        """Drop the addresses whose buckets are full; call it about once a second."""
        self._of = {address: pace for address, pace in self._of.items() if not pace.is_full(now_s)}
