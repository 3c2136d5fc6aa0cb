"""How far a gateway has come with what it is told, which the guard reads without asking.

What a machine can do, and what else it does meanwhile, is no constant.

Numbers that both processes have in memory: three that the gateway writes, and how much the guard has dropped. Each is
written at once, and one that is a moment older than another harms nothing.
"""

from __future__ import annotations

import mmap
from pathlib import Path

NUMBERS = 4
EACH_BYTES = 8
TOLD_S, UNREAD_S, QUESTIONS, DROPPED = range(NUMBERS)
TELL_S = 0.05


class Heard:
    """The numbers in a file at `path`, which is made if it is not there; times are of the machine's monotonic clock.

    0 until the gateway has told them: not known.
    """

    def __init__(self, path: Path) -> None:
        path.touch(mode=0o600)
        with path.open("r+b") as file:
            file.truncate(NUMBERS * EACH_BYTES)
            self._numbers = memoryview(mmap.mmap(file.fileno(), NUMBERS * EACH_BYTES)).cast("d")
        self.path = path

    def tell(self, now_s: float, unread_since_s: float, questions: int) -> None:
        """The oldest message that is not read yet came then, or none is there `now_s`; so many questions wait."""
        self._numbers[UNREAD_S], self._numbers[QUESTIONS] = unread_since_s, questions
        self._numbers[TOLD_S] = now_s

    def forget(self) -> None:
        """Nobody knows any more."""
        self._numbers[TOLD_S] = 0.0

    def behind_s(self, now_s: float) -> float:
        """For how long a message that is read now has waited; who has told nothing for long is behind too."""
        if not self._numbers[TOLD_S]:
            return 0.0
        return max(0.0, now_s - min(self._numbers[UNREAD_S], self._numbers[TOLD_S]) - TELL_S)

    def drop(self) -> None:
        """The guard has dropped a message that came too late to be passed on."""
        self._numbers[DROPPED] += 1

    @property
    def dropped(self) -> int:
        """How many it has dropped so far."""
        return int(self._numbers[DROPPED])

    @property
    def told_at_s(self) -> float:
        """When it said so."""
        return float(self._numbers[TOLD_S])

    @property
    def questions(self) -> int:
        """How many waited for their answers then."""
        return int(self._numbers[QUESTIONS])
