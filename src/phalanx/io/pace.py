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

    def wait_s(self, now_s: float, words: int = 1) -> float:
        """How long so many may not be said, `now_s` on a clock that never runs backwards; 0 if they may."""
        if self._at_s is not None:
            self._left = min(self._at_once, self._left + (now_s - self._at_s) * self._per_s)
        self._at_s = now_s
        return max(0.0, (words - self._left) / self._per_s)

    def said(self, words: int = 1) -> None:
        """So many were said; those that were too many are waited for, but as many as may be said at once at most."""
        self._left = max(-self._at_once, self._left - words)
