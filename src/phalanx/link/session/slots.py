"""Constant sending rate: one record per slot, so that neither times nor sizes reveal which command is sent."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from phalanx.errors import UsageError

from .client import SessionClient
from .events import Transmit

LONGEST = 64  # records in the queue
SealRecord = Callable[[int], Transmit]  # seals a record at this time, ms; only then, so that it names the newest update


@dataclass(frozen=True, slots=True)
class _Waiting:
    say: SealRecord
    robot: str
    drop: Callable[[], None]


class Slots:
    """Send queue of one client.

    Attributes:
        steady: sent in slots without a queued record, such as the wheels of a joystick; None: `alive`.
    """

    def __init__(self) -> None:
        self.steady: SealRecord | None = None
        self._stops: deque[SealRecord] = deque(maxlen=LONGEST)
        self._waiting: deque[_Waiting] = deque()
        self._steady_is_next = False

    @property
    def waits(self) -> bool:
        """Return whether a record is queued."""
        return bool(self._stops or self._waiting)

    def put(self, say: SealRecord, robot: str = "", drop: Callable[[], None] = lambda: None) -> None:
        """Queue a request, or a command for a robot; `drop` is called if a stop for that robot removes it.

        Raises: UsageError: the queue is full.
        """
        if len(self._waiting) >= LONGEST:
            raise UsageError(f"{LONGEST} messages are queued already", "send fewer at a time")
        self._waiting.append(_Waiting(say, robot, drop))

    def stop(self, say: SealRecord, robot: str) -> None:
        """Queue a stop before all other records, and drop the robot's queued commands, which are older."""
        self._stops.append(say)
        dropped = [each for each in self._waiting if each.robot == robot]
        self._waiting = deque(each for each in self._waiting if each.robot != robot)
        for each in dropped:
            each.drop()

    def take(self, client: SessionClient) -> SealRecord:
        """Return the record for this slot. If both exist, queued records and the steady one alternate."""
        if self._stops:
            return self._stops.popleft()
        self._steady_is_next = not self._steady_is_next
        if self._waiting and not (self.steady and self._steady_is_next):
            return self._waiting.popleft().say
        return self.steady or client.alive

    def clear(self) -> None:
        """Drop all records: the session is over, or was lost."""
        self.steady = None
        self._stops.clear()
        self._waiting.clear()
