"""Who has proved the pin to the guard, which does not know it: whoever the swarm has answered.

Only who has the pin can ask so that it is answered, only the gateway may speak where answers are read, and each such
topic has one reader. So addresses need not be counted where heads can be: a class behind one router is many. Who comes
hears the swarm before it is answered; for that one has to know its topic, which nobody is told who has not the pin.
"""

from __future__ import annotations

from collections import Counter
from enum import IntEnum

from .visitor_packets import PUBLISH, u16, varint

# Of one place: so many phones say all that a gateway hears, and who has the pin may come as often as it likes. Whoever
# is one more is somebody of that place.
HEADS = 100
NEW_WORDS = 12


class Standing(IntEnum):
    """What somebody has shown of itself."""

    STRANGER = 0
    NEW = 1  # it has said no more than `NEW_WORDS`, what whoever comes has to say
    HEARS = 2  # it knows the topic of the swarm, by the pin or because it saw somebody's packets
    PROVED = 3  # it has the pin, and is one of those of its place who count as heads


class Heads:
    """How many of each place have proved it."""

    def __init__(self) -> None:
        self._of: Counter[str] = Counter()

    def one_more(self, place: str) -> bool:
        """Whether there is room for one more there, who is counted then."""
        if self._of[place] >= HEADS:
            return False
        self._of[place] += 1
        return True

    def one_less(self, place: str) -> None:
        """One of them has left."""
        self._of[place] -= 1
        if not self._of[place]:
            del self._of[place]


class Proof:
    """What our broker says to one visitor, looked through for what the swarm says. Source: MQTT §2.1, §3.3."""

    def __init__(self) -> None:
        self._came = b""  # of a packet whose topic has not come whole
        self._skip = 0  # bytes of one whose topic is known

    def of(self, data: bytes, answers: frozenset[bytes]) -> Standing:
        """What it shows that this is said to it next; `answers` are the topics for such that it reads."""
        shown = Standing.STRANGER
        at, data = self._skip, self._came + data
        try:
            while at < len(data):
                length, body = varint(data, at + 1)
                if data[at] & 0xF0 == PUBLISH:
                    end = body + 2 + u16(data, body)
                    if end > len(data):
                        break
                    shown = max(shown, Standing.PROVED if data[body + 2 : end] in answers else Standing.HEARS)
                at = body + length
        except IndexError:
            pass  # the rest of its head comes next
        self._skip, self._came = max(0, at - len(data)), data[at:]
        return shown
