"""Queues with round-robin over addresses: the load of one address delays others by one item at a time."""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from phalanx.pace import TokenBucket, TokenBuckets

Item = TypeVar("Item")

# Limits of the pause before the next run: if the common rate is used up, and if all addresses' own rates are.
SOONEST_S, SOONEST_OWN_S, LATEST_S = 0.005, 0.025, 1.0


class Rows(Generic[Item]):
    """Items by address, in the order of arrival."""

    def __init__(self) -> None:
        self._of: OrderedDict[str, OrderedDict[Item, None]] = OrderedDict()
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def __contains__(self, address: str) -> bool:
        return address in self._of

    def __iter__(self) -> Iterator[Item]:
        for row in self._of.values():
            yield from row

    def addresses(self) -> list[str]:
        """Return the addresses with items, in the order of their turns."""
        return list(self._of)

    def count(self, address: str) -> int:
        """Return the number of an address's items."""
        return len(self._of.get(address, ()))

    def add(self, address: str, item: Item) -> None:
        """Append an item for an address."""
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
        """Return the oldest item of an address."""
        return next(iter(self._of[address]))

    def crowded(self) -> str:
        """Return the address with the most items."""
        return max(self._of, key=lambda address: len(self._of[address]))

    def pop(self, address: str) -> Item:
        """Remove and return the oldest item of an address, and move the address to the end of the turns."""
        item = self.oldest(address)
        self.remove(address, item)
        if address in self._of:
            self._of.move_to_end(address)
        return item


class Turns(Generic[Item]):
    """Queue that serves items at a limited rate, round-robin over addresses.

    Args:
        serve: called with each item in its turn.
        refuse: called with each item that is dropped.
        pace: rate of all addresses together; `paces`, if given, has the rate of each address.
        waiting_max: length of the queue; beyond it, the oldest item of the busiest address is dropped.
        has_room: returns whether one more item can be served now; call `run` when that changes.
    """

    def __init__(
        self,
        serve: Callable[[Item], None],
        refuse: Callable[[Item], None],
        pace: TokenBucket,
        paces: TokenBuckets | None = None,
        *,
        waiting_max: int,
        has_room: Callable[[], bool] = lambda: True,
    ) -> None:
        self._serve, self._refuse = serve, refuse
        self._pace, self._paces = pace, paces
        self._most, self._has_room = waiting_max, has_room
        self._rows: Rows[Item] = Rows()
        self._timer: asyncio.TimerHandle | None = None
        self._all_wait = False  # all addresses wait for their own rates, until the timer

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, address: str, item: Item) -> None:
        """Queue an item, and serve it at once if possible."""
        self._rows.add(address, item)
        if len(self._rows) > self._most:
            self._refuse(self._rows.pop(self._rows.crowded()))
        now_s = time.monotonic()
        if not self._timer:
            self.run()
        elif self._all_wait and self._may(address, now_s) and self._has_room() and not self._pace.wait_s(now_s):
            self._serve_one(address, now_s)

    def remove(self, address: str, item: Item) -> bool:
        """Remove an item; return whether it was in the queue."""
        return self._rows.remove(address, item)

    def run(self) -> None:
        """Serve items as far as rates and room allow."""
        if self._timer:
            return
        now_s = time.monotonic()
        self._all_wait = False
        while self._rows and self._has_room():
            if wait_s := self._pace.wait_s(now_s):
                self._look_in(max(wait_s, SOONEST_S))
                return
            address = next((each for each in self._rows.addresses() if self._may(each, now_s)), None)
            if address is None:
                self._all_wait = True
                self._look_in(max(min(self._own_s(each, now_s) for each in self._rows.addresses()), SOONEST_OWN_S))
                return
            self._serve_one(address, now_s)

    def charge(self, address: str, count: float) -> None:
        """Take turns from the allowance of an address; a negative number returns them."""
        if self._paces is not None:
            self._paces.of(address, time.monotonic()).use(count)

    def forget(self, now_s: float) -> None:
        """Drop the rate limits of addresses with a full allowance; call it about once a second."""
        if self._paces is not None:
            self._paces.forget(now_s)

    def close(self) -> None:
        """Refuse all items in the queue."""
        if self._timer:
            self._timer.cancel()
        for item in list(self._rows):
            self._refuse(item)
        self._rows = Rows()

    def _may(self, address: str, now_s: float) -> bool:
        return address in self._rows and not self._own_s(address, now_s)

    def _own_s(self, address: str, now_s: float) -> float:
        return 0.0 if self._paces is None else self._paces.of(address, now_s).wait_s(now_s)

    def _serve_one(self, address: str, now_s: float) -> None:
        self._pace.use()
        if self._paces is not None:
            self._paces.of(address, now_s).use()
        self._serve(self._rows.pop(address))

    def _look_in(self, wait_s: float) -> None:
        self._timer = asyncio.get_running_loop().call_later(min(wait_s, LATEST_S), self._look_again)

    def _look_again(self) -> None:
        self._timer = None
        self.run()
