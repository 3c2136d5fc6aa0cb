"""Joysticks: a robot drives only as long as somebody keeps saying so, and not by words that were held back."""

from __future__ import annotations

import heapq
from collections import deque

EXPIRES_S = 0.3
LATE_S = 1.0
REMEMBERED = 256  # frames: more than are sent in that second


class Told:
    """When frames were sent, and so how long ago somebody spoke who had read up to one of them.

    By the gateway's own clock: whoever speaks has not yet read the next frame.
    """

    def __init__(self) -> None:
        self._sent: deque[tuple[int, float]] = deque(maxlen=REMEMBERED)

    def sent(self, number: int, uptime_s: float) -> None:
        """Frame `number` was sent."""
        self._sent.append((number, uptime_s))

    def age_s(self, seen: int, uptime_s: float) -> float:
        """Seconds for which a word has been under way at least, if its speaker had read frame `seen` last."""
        age_s = 0.0
        for number, sent_at_s in reversed(self._sent):
            if number <= seen:
                break
            age_s = uptime_s - sent_at_s
        return age_s


class Joysticks:
    """Remembers which robots are being driven, and until when.

    A phone whose battery dies, whose owner walks off or whose broker is cut must not leave a robot running.
    """

    def __init__(self) -> None:
        self._until: dict[str, float] = {}
        self._due: list[tuple[float, str]] = []

    def drive(self, address: str, moving: bool, uptime_s: float) -> None:
        """A wheel command was heard."""
        if moving:
            self._until[address] = uptime_s + EXPIRES_S
            heapq.heappush(self._due, (uptime_s + EXPIRES_S, address))
        else:
            self._until.pop(address, None)

    def is_driven(self, address: str) -> bool:
        """Whether its time is not up, or nobody has asked."""
        return address in self._until

    def driven(self) -> list[str]:
        """Robots whose time is not up."""
        return list(self._until)

    def expired(self, uptime_s: float) -> list[str]:
        """Robots to be stopped now; each is named once."""
        stop = []
        while self._due and self._due[0][0] <= uptime_s:
            due_s, address = heapq.heappop(self._due)
            if self._until.get(address) == due_s:
                del self._until[address]
                stop.append(address)
        return stop

    def next_due_s(self) -> float | None:
        """Uptime of the next possible expiry."""
        return self._due[0][0] if self._due else None
