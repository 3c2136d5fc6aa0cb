"""Whose turn it is: place by place, and one after another within a place.

However many come from one address, they wait for each other, and everybody elsewhere for one of them at a time.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from typing import Generic, Protocol, TypeVar


class Placed(Hashable, Protocol):
    """Somebody who waits."""

    place: str  # where it comes from


Who = TypeVar("Who", bound=Placed)


class _Row(Generic[Who]):
    def __init__(self) -> None:
        self._from: OrderedDict[str, OrderedDict[Who, None]] = OrderedDict()

    def __bool__(self) -> bool:
        return bool(self._from)

    def add(self, who: Who) -> None:
        self._from.setdefault(who.place, OrderedDict())[who] = None

    def pop(self) -> Who:
        place, waiting = self._from.popitem(last=False)
        who, _ = waiting.popitem(last=False)
        if waiting:
            self._from[place] = waiting
        return who

    def drop(self, who: Who) -> None:
        waiting = self._from.get(who.place, OrderedDict())
        waiting.pop(who, None)
        if not waiting:
            self._from.pop(who.place, None)


# Of nine words that are passed on, eight are of who said little lately, if they say so much; and each of the others'
# counts as three: who says much is no reason for a gateway to have much to do.
SHARE, DEAR = 8, 3
MOST_AHEAD = 32


class Turns(Generic[Who]):
    """Who waits for a turn: who said little lately; and the others, who have a small share while there are such."""

    def __init__(self) -> None:
        self._little: _Row[Who] = _Row()
        self._much: _Row[Who] = _Row()
        self._is_little = False  # whose turn it is
        self._ahead = 0  # how much more of those was passed on who said little

    def __bool__(self) -> bool:
        return bool(self._little) or bool(self._much)

    def wait(self, who: Who, *, much: bool = False) -> None:
        """Somebody waits, who said `much` lately or not."""
        (self._much if much else self._little).add(who)

    def next(self) -> Who:
        """Whose turn it is; somebody must wait."""
        self._is_little = bool(self._little) and not (self._ahead > 0 and self._much)
        return (self._little if self._is_little else self._much).pop()

    def passed_on(self, words: int) -> int:
        """As how many it counts that so many were passed on, of whose turn it is."""
        ahead = self._ahead + (words if self._is_little else -words * SHARE)
        self._ahead = max(-MOST_AHEAD, min(ahead, MOST_AHEAD))
        return words if self._is_little else words * DEAR

    def gone(self, who: Who) -> None:
        """It does not wait any more."""
        self._little.drop(who)
        self._much.drop(who)
