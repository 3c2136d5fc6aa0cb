"""How fast one may speak: so many words a second, and some at once after a silence (a token bucket)."""

from __future__ import annotations


class Pace:
    """Words that are said.

    Args:
        per_s: on the long run.
        at_once: after a silence.
    """

    def __init__(self, per_s: float, at_once: float) -> None:
        self._per_s, self._at_once = per_s, at_once
        self._left = at_once
        self._at_s = 0.0

    def said(self, now_s: float) -> float:
        """A word was said, `now_s` on a clock that never runs backwards; so long is the next one to wait."""
        self._left = min(self._at_once, self._left + (now_s - self._at_s) * self._per_s) - 1.0
        self._at_s = now_s
        return max(0.0, -self._left / self._per_s)
