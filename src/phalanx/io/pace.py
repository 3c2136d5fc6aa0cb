"""How fast one may speak: so many words a second, and some at once after a silence (a token bucket)."""

from __future__ import annotations


class Pace:
    """Words that are said.

    Args:
        per_s: on the long run.
        at_once: after a silence.
        at_first: before any silence; else as many.
    """

    def __init__(self, per_s: float, at_once: float, at_first: float | None = None) -> None:
        self._per_s, self._at_once = per_s, at_once
        self._left = at_once if at_first is None else at_first
        self._at_s: float | None = None

    @property
    def is_rested(self) -> bool:
        """Whether half of what may be said at once was left at the last word."""
        return self._left > self._at_once / 2

    def may(self, now_s: float) -> bool:
        """Whether one more may be said, `now_s` on a clock that never runs backwards; it is counted if so."""
        if self._at_s is not None:
            self._left = min(self._at_once, self._left + (now_s - self._at_s) * self._per_s)
        self._at_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
