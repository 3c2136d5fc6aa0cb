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

    def may(self, now_s: float) -> bool:
        """Whether one more may be said, `now_s` on a clock that never runs backwards; it is counted if so."""
        self._left = min(self._at_once, self._left + (now_s - self._at_s) * self._per_s)
        self._at_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
