"""A constant rate: one record in each slot, whatever is said. So neither times nor sizes tell a turn from a stop."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from phalanx.errors import UsageError

from .client import SessionClient
from .events import Transmit

LONGEST = 64  # records that wait for their slots
Say = Callable[[int], Transmit]  # seals a record at this time, ms: so it names the newest update


@dataclass(frozen=True, slots=True)
class _Waiting:
    say: Say
    robot: str
    drop: Callable[[], None]


class Slots:
    """What one client says next.

    Attributes:
        steady: what is said in slots in which nothing else is, such as the wheels of a joystick; None: `alive`.
    """

    def __init__(self) -> None:
        self.steady: Say | None = None
        self._stops: deque[Say] = deque(maxlen=LONGEST)
        self._waiting: deque[_Waiting] = deque()
        self._steady_is_next = False

    @property
    def waits(self) -> bool:
        """Return whether a record waits for its slot."""
        return bool(self._stops or self._waiting)

    def put(self, say: Say, robot: str = "", drop: Callable[[], None] = lambda: None) -> None:
        """Queue a request, or a command for a robot; `drop` is called if a stop comes before it is sent.

        Raises: UsageError: too many wait.
        """
        if len(self._waiting) >= LONGEST:
            raise UsageError(f"{LONGEST} messages wait already", "fewer at a time")
        self._waiting.append(_Waiting(say, robot, drop))

    def stop(self, say: Say, robot: str) -> None:
        """Queue a stop before all else, and drop the robot's commands that wait: they were given before it."""
        self._stops.append(say)
        dropped = [each for each in self._waiting if each.robot == robot]
        self._waiting = deque(each for each in self._waiting if each.robot != robot)
        for each in dropped:
            each.drop()

    def take(self, client: SessionClient) -> Say:
        """Return what to say in this slot. What waits leaves every other slot to what is steady."""
        if self._stops:
            return self._stops.popleft()
        self._steady_is_next = not self._steady_is_next
        if self._waiting and not (self.steady and self._steady_is_next):
            return self._waiting.popleft().say
        return self.steady or client.alive

    def clear(self) -> None:
        """Forget all: the session is over, or was lost."""
        self.steady = None
        self._stops.clear()
        self._waiting.clear()
