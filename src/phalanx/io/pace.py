"""How fast one may speak: so many words a second, and some at once after a silence (a token bucket)."""

from __future__ import annotations

from .heard import TELL_S, Heard

# Words a second of all visitors together, and for how long of it at once. A fast machine's gateway hears the most
# beside its other work; one that is behind the least at least, so that whoever has a turn is heard at all.
MOST_PER_S, LEAST_PER_S = 2500.0, 20.0
AT_ONCE_S, AT_ONCE_BEHIND_S = 0.5, 0.1
# A command is obeyed for 0.3 s; with others behind it, what waits 0.2 s at the gateway is not even read.
BEHIND_S = 0.1
# Every `TELL_S`; and of words a second lately, and of them when it fell behind, so much.
SLOWER, FASTER, BACK = 0.85, 1.05, 1.25
LATEST, KNOWN = 0.3, 0.7
MANY = 200.0


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


class HousePace(Pace):
    """Of all visitors together: as fast as the gateway keeps up with, which it tells; else the fastest."""

    def __init__(self, heard: Heard | None) -> None:
        super().__init__(MOST_PER_S, AT_ONCE_S * MOST_PER_S)
        self._heard, self._looked_at_s = heard, 0.0
        self._was_behind = False
        self._words = 0
        self._said_per_s = self._known_per_s = 0.0

    def wait_s(self, now_s: float, words: int = 1) -> float:
        """As of any pace."""
        if self._heard and now_s - self._looked_at_s >= TELL_S:
            # Whoever was not asked for long has nothing to be slow for; a look that comes late is one look.
            looks = min((now_s - self._looked_at_s) / TELL_S, MANY)
            self._looked_at_s = now_s
            self._said_per_s += (self._words / (looks * TELL_S) - self._said_per_s) * LATEST
            self._words = 0
            self._follow(self._heard.behind_s(now_s) > BEHIND_S, looks)
        return super().wait_s(now_s, words)

    def said(self, words: int = 1) -> None:
        """As of any pace."""
        self._words += words
        super().said(words)

    def _follow(self, is_behind: bool, looks: float) -> None:
        # Most of what was said when it fell behind it could hear: a moment's pause shall cost nobody seconds.
        if is_behind and not self._was_behind:
            self._known_per_s = KNOWN * self._said_per_s
        self._was_behind = is_behind
        step = SLOWER if is_behind else (BACK if self._per_s < self._known_per_s else FASTER) ** looks
        self._per_s = min(MOST_PER_S, max(LEAST_PER_S, self._per_s * step))
        self._at_once = self._per_s * (AT_ONCE_S if self._per_s == MOST_PER_S else AT_ONCE_BEHIND_S)
