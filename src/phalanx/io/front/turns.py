"""Queues in which addresses take turns: however many wait from one address, others wait for one of them at a time."""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from phalanx.io.pace import Pace, Paces

Item = TypeVar("Item")

SOONEST_S = 0.005  # between two looks at a queue whose pace is used up


class Rows(Generic[Item]):
    """Items by their address, each row in the order in which they came."""

    def __init__(self) -> None:
        self._of: OrderedDict[str, OrderedDict[Item, None]] = OrderedDict()
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Item]:
        for row in self._of.values():
            yield from row

    def addresses(self) -> list[str]:
        """Return addresses with items, that of the next turn first."""
        return list(self._of)

    def count(self, address: str) -> int:
        """Return how many items an address has."""
        return len(self._of.get(address, ()))

    def add(self, address: str, item: Item) -> None:
        """Append an item to its address's row."""
        self._of.setdefault(address, OrderedDict())[item] = None
        self._count += 1

    def remove(self, address: str, item: Item) -> bool:
        """Remove an item; return whether it was there."""
        row = self._of.get(address)
        if row is None or item not in row:
            return False
        del row[item]
        self._count -= 1
        if not row:
            del self._of[address]
        return True

    def oldest(self, address: str) -> Item:
        """Return the first item of an address."""
        return next(iter(self._of[address]))

    def crowded(self) -> str:
        """Return the address that has most items."""
        return max(self._of, key=lambda address: len(self._of[address]))

    def pop(self, address: str) -> Item:
        """Remove and return the first item of an address, whose next turn comes after all others'."""
        item = self.oldest(address)
        self.remove(address, item)
        if address in self._of:
            self._of.move_to_end(address)
        return item


class Turns(Generic[Item]):
    """Serves items at a pace, one address after another.

    Args:
        serve: called with each item in its turn.
        pace: of all addresses; `paces`, if given, is each address's own.
        waiting_max: more than these push out the oldest of the address that has most, for which `refuse` is called.
        has_room: whether one more can be served just now; call `run` when that changes.
    """

    def __init__(
        self,
        serve: Callable[[Item], None],
        refuse: Callable[[Item], None],
        pace: Pace,
        paces: Paces | None = None,
        *,
        waiting_max: int,
        has_room: Callable[[], bool] = lambda: True,
    ) -> None:
        self._serve, self._refuse = serve, refuse
        self._pace, self._paces = pace, paces
        self._most, self._has_room = waiting_max, has_room
        self._rows: Rows[Item] = Rows()
        self._timer: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, address: str, item: Item) -> None:
        """Let an item wait for its turn, which may be now."""
        self._rows.add(address, item)
        if len(self._rows) > self._most:
            self._refuse(self._rows.pop(self._rows.crowded()))
        self.run()

    def remove(self, address: str, item: Item) -> bool:
        """Let an item wait no longer; return whether it did."""
        return self._rows.remove(address, item)

    def run(self) -> None:
        """Serve whose turn it is, as far as pace and room go."""
        if self._timer:
            return  # the pace is used up until then
        now_s = time.monotonic()
        wait_s = 0.0
        while self._rows and self._has_room():
            wait_s = self._pace.wait_s(now_s)
            if wait_s:
                break
            waits_s = []
            for address in self._rows.addresses():
                own_s = self._paces.of(address, now_s).wait_s(now_s) if self._paces is not None else 0.0
                if own_s:
                    waits_s.append(own_s)
                    continue
                self._pace.use()
                if self._paces is not None:
                    self._paces.of(address, now_s).use()
                self._serve(self._rows.pop(address))
                break
            else:
                wait_s = min(waits_s)
                break
        if wait_s:
            self._timer = asyncio.get_running_loop().call_later(max(wait_s, SOONEST_S), self._look_again)

    def forget(self, now_s: float) -> None:
        """Forget the paces of addresses that used nothing lately; call it about once a second."""
        if self._paces is not None:
            self._paces.forget(now_s)

    def close(self) -> None:
        """Refuse all that wait."""
        if self._timer:
            self._timer.cancel()
        for item in list(self._rows):
            self._refuse(item)
        self._rows = Rows()

    def _look_again(self) -> None:
        self._timer = None
        self.run()
