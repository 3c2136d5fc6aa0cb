"""Whose turn it is: who has proved the pin, one head after another; of the others place by place.

However many come from one address, those who did not prove it wait for each other, and everybody elsewhere for one of
them at a time. Whoever says much waits beside who says little.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from typing import Generic, Protocol, TypeVar

from .heads import Standing


class Placed(Hashable, Protocol):
    """Somebody who waits."""

    place: str  # where it comes from
    standing: Standing


Who = TypeVar("Who", bound=Placed)


class _Row(Generic[Who]):
    def __init__(self, *, by_head: bool = False) -> None:
        self._by_head = by_head
        self._from: OrderedDict[Hashable, OrderedDict[Who, None]] = OrderedDict()

    def __len__(self) -> int:
        """How many have their turn before the first has another."""
        return len(self._from)

    def add(self, who: Who) -> None:
        self._from.setdefault(who if self._by_head else who.place, OrderedDict())[who] = None

    def pop(self) -> Who:
        place, waiting = self._from.popitem(last=False)
        who, _ = waiting.popitem(last=False)
        if waiting:
            self._from[place] = waiting
        return who

    def drop(self, who: Who) -> bool:
        """Whether it was in it."""
        place = who if self._by_head else who.place
        waiting = self._from.get(place, OrderedDict())
        was_in_it = who in waiting
        waiting.pop(who, None)
        if not waiting:
            self._from.pop(place, None)
        return was_in_it


# Of nine words that are passed on, eight are of heads; of the others' nine, eight of who hears the swarm, and so on; if
# they say so much. Each of who says much counts as three: that is no reason for a gateway to have much to do.
SHARE, DEAR = 8, 3
HEADS, _, _, STRANGERS, LOUD = ROWS = range(len(Standing) + 1)
SHARES = tuple(SHARE ** (LOUD - row) for row in ROWS)
# Words in a turn, and about as many in one turn of each, so that nobody's few words are late for others' many.
TURN, ROUND = 16, 64


class Turns(Generic[Who]):
    """Who waits for a turn, by what they have shown, and whoever said much: each row has its share."""

    def __init__(self) -> None:
        self._rows: tuple[_Row[Who], ...] = tuple(_Row(by_head=row == HEADS) for row in ROWS)
        self._passed = [0.0] * len(ROWS)  # words by share, of each row
        self._now = 0.0  # as much as of the row whose turn it was; who did not wait gets nothing for that
        self._row = HEADS  # whose turn it is
        self._is_idle = False  # nothing was passed on in it, so far
        self.words = TURN  # that it is worth

    def __bool__(self) -> bool:
        return any(self._rows)

    def wait(self, who: Who, *, much: bool = False) -> None:
        """Somebody waits, who said `much` lately or not."""
        row = LOUD if much else STRANGERS - who.standing
        if not self._rows[row]:
            self._passed[row] = max(self._passed[row], self._now)
        self._rows[row].add(who)

    def next(self) -> Who:
        """Whose turn it is; somebody must wait."""
        if self._is_idle:  # whose words are all late has turns without end, and so must count
            self._passed[self._row] += 1 / SHARES[self._row]
        self._row = min((row for row in ROWS if self._rows[row]), key=self._passed.__getitem__)
        self._now, self._is_idle = self._passed[self._row], True
        self.words = max(1, min(TURN, ROUND // len(self._rows[self._row])))
        return self._rows[self._row].pop()

    def passed_on(self, words: int) -> int:
        """As how many it counts that so many were passed on, of whose turn it is."""
        self._is_idle = self._is_idle and not words
        self._passed[self._row] += words / SHARES[self._row]
        return words * DEAR if self._row == LOUD else words

    def gone(self, who: Who) -> bool:
        """It does not wait any more; whether it did."""
        return sum(row.drop(who) for row in self._rows) > 0
