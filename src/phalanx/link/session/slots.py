"""A constant rate: one record in each slot, whatever is said. So neither times nor sizes tell a turn from a stop."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from phalanx.errors import UsageError

from .client import SessionClient
from .events import Transmit

LONGEST = 64  # records that wait for their slots
Say = Callable[[int], Transmit]  # seals a record at this time, ms: so it names the newest update


class Slots:
    """What one client says next.

    Attributes:
        steady: what is said in slots in which nothing else is, such as the wheels of a joystick; None: `alive`.
    """

    def __init__(self) -> None:
        self.steady: Say | None = None
        self._urgent: deque[Say] = deque(maxlen=LONGEST)
        self._waiting: deque[Say] = deque()
        self._steady_is_next = False

    def put(self, say: Say, *, urgent: bool = False) -> None:
        """Queue a record; an urgent one, a stop, comes before all others. Raises: UsageError: too many wait."""
        if urgent:
            self._urgent.append(say)
            return
        if len(self._waiting) >= LONGEST:
            raise UsageError(f"{LONGEST} messages wait already", "fewer at a time")
        self._waiting.append(say)

    def take(self, client: SessionClient) -> Say:
        """Return what to say in this slot. What waits leaves every other slot to what is steady."""
        if self._urgent:
            return self._urgent.popleft()
        self._steady_is_next = not self._steady_is_next
        if self._waiting and not (self.steady and self._steady_is_next):
            return self._waiting.popleft()
        return self.steady or client.alive

    def clear(self) -> None:
        """Forget all: the session is over, or was lost."""
        self.steady = None
        self._urgent.clear()
        self._waiting.clear()
