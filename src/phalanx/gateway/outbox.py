"""Queue of changes to send to visitors, in turn, so that an update stays short however much changes at once.

A newer entry of the same key replaces a waiting one and keeps its position. So the queue is no longer than the number
of robots.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from phalanx.link.envelope import encode_json

KEY_BYTES = 6  # JSON around a list's name and items


@dataclass(frozen=True, slots=True)
class Entry:
    """An item of one of an update's lists.

    Attributes:
        sent: called after the entry was sent.
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
# Called when the key's turn comes; returns no entries if there is nothing left to send.
Make = Callable[[], Iterable[Entry]]


@dataclass(slots=True)
class Batch:
    """The entries that fit an update. Attributes: lists: by name; size: as JSON, at most."""

    lists: dict[str, list[Any]] = field(default_factory=dict)
    size: int = 0
    taken: list[Key] = field(default_factory=list)
    entries: list[Entry] = field(default_factory=list)

    def costs(self, entries: Sequence[Entry]) -> int:
        """Return the additional length of these entries."""
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
    """Waiting entries by key, in order of arrival."""

    def __init__(self) -> None:
        self._waiting: dict[Key, Make] = {}

    def __len__(self) -> int:
        """Return the number of waiting keys."""
        return len(self._waiting)

    def put(self, key: Key, make: Make) -> None:
        """Enqueue the entries that `make` will return; a key that already waits keeps its position."""
        self._waiting[key] = make

    def put_item(self, key: Key, list_name: str, item: Any) -> None:
        """Enqueue an item. Raises: ValueError, TypeError: it is not JSON; nothing is enqueued."""
        entry = Entry(list_name, item)  # encoded now: an invalid item must not block the queue
        self.put(key, lambda: (entry,))

    def forget(self, key: Key) -> None:
        """Remove a key from the queue."""
        self._waiting.pop(key, None)

    def forget_all(self, list_name: str) -> None:
        """Remove all keys whose first part is `list_name`."""
        for key in [key for key in self._waiting if key[0] == list_name]:
            del self._waiting[key]

    def next(self, limit_bytes: int) -> Batch:
        """Return the entries that fit, at least one if there is any; they stay queued until `sent` is called.

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
        """Remove the entries of a batch from the queue, as they were sent."""
        for key in batch.taken:
            self._waiting.pop(key, None)
        for entry in batch.entries:
            entry.sent()
