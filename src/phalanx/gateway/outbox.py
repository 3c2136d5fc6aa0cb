"""Queue what visitors are still to be sent, in turns: an update is short, however much changes at once.

An entry waits behind those that were there before it. While it waits, a newer one of its key takes its place, so that
the queue is no longer than there are robots.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from phalanx.link.envelope import encode_json

KEY_BYTES = 6  # of a list besides its name and elements


@dataclass(frozen=True, slots=True)
class Entry:
    """An element of one of a frame's lists.

    Attributes:
        sent: to be called when it was sent.
        size: its length as JSON.

    Raises: ValueError, TypeError: it is not JSON.
    """

    list_name: str
    item: Any
    sent: Callable[[], None] = lambda: None
    size: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", len(encode_json(self.item)) + 1)


Key = tuple[Any, ...]
# Entries when their turn comes; none if there is nothing to send any longer.
Make = Callable[[], Iterable[Entry]]


@dataclass(slots=True)
class Batch:
    """The part of the queue that fits an update. Attributes: lists: by their names; size: as JSON, at most."""

    lists: dict[str, list[Any]] = field(default_factory=dict)
    size: int = 0
    taken: list[Key] = field(default_factory=list)
    entries: list[Entry] = field(default_factory=list)

    def costs(self, entries: Sequence[Entry]) -> int:
        """Return by how much entries make it longer."""
        new = {entry.list_name for entry in entries} - self.lists.keys()
        return sum(entry.size for entry in entries) + sum(len(name) + KEY_BYTES for name in new)

    def add(self, key: Key, entries: Sequence[Entry], cost: int) -> None:
        """Add the entries of a key."""
        self.taken.append(key)
        self.size += cost
        for entry in entries:
            self.entries.append(entry)
            self.lists.setdefault(entry.list_name, []).append(entry.item)


class Outbox:
    """Entries by key, the longest waiting first."""

    def __init__(self) -> None:
        self._waiting: dict[Key, Make] = {}

    def __len__(self) -> int:
        """Return how many keys wait."""
        return len(self._waiting)

    def put(self, key: Key, make: Make) -> None:
        """Have what `make` returns sent; a key that waits keeps its place."""
        self._waiting[key] = make

    def put_item(self, key: Key, list_name: str, item: Any) -> None:
        """Have an item sent. Raises: ValueError, TypeError: it is not JSON, and nothing waits."""
        entry = Entry(list_name, item)  # made now: what is not JSON must not stop all that waits behind it
        self.put(key, lambda: (entry,))

    def forget(self, key: Key) -> None:
        """Have nothing of a key sent."""
        self._waiting.pop(key, None)

    def forget_all(self, list_name: str) -> None:
        """Have nothing sent whose key begins so."""
        for key in [key for key in self._waiting if key[0] == list_name]:
            del self._waiting[key]

    def next(self, limit_bytes: int) -> Batch:
        """Return what fits, at least one entry if there is any; it waits until `sent` is called.

        Raises: ValueError, TypeError: an entry is not JSON.
        """
        batch = Batch()
        for key, make in self._waiting.items():
            entries = tuple(make())
            cost = batch.costs(entries)
            if batch.entries and batch.size + cost > limit_bytes:
                break
            batch.add(key, entries, cost)
        return batch

    def sent(self, batch: Batch) -> None:
        """Note that a batch was sent."""
        for key in batch.taken:
            self._waiting.pop(key, None)
        for entry in batch.entries:
            entry.sent()
