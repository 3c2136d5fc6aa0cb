"""Stores of the rows that outlive the gateway: visitors that may resume, tickets, and settings of admission.

Rows are durable when `write` returns, and a write is atomic. So a change is written before it is acknowledged.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol


class Store(Protocol):
    """Store of rows by key, both encoded as in the byte table (sessions.py)."""

    def load(self) -> dict[bytes, bytes]:
        """Return all rows by their keys."""
        ...

    def write(self, rows: Mapping[bytes, bytes | None]) -> None:
        """Write rows, and delete those that are None, in one transaction. Return when all are on disk."""
        ...


class GroupedStore:
    """Store that, while `is_grouping`, keeps rows until `flush`, so that many writes wait for the disk once.

    A caller that groups must not acknowledge any of the writes before `flush` has returned.
    """

    def __init__(self, store: Store) -> None:
        self.is_grouping = False
        self.writes = 0
        self._store = store
        self._rows: dict[bytes, bytes | None] = {}

    def load(self) -> dict[bytes, bytes]:
        """Return all rows by their keys."""
        return self._store.load()

    def write(self, rows: Mapping[bytes, bytes | None]) -> None:
        """Write rows, with those kept before; or keep them while grouping."""
        self.writes += 1
        if self.is_grouping:
            self._rows |= rows
        else:
            self._store.write(self._rows | dict(rows))
            self._rows = {}

    def flush(self) -> None:
        """Write the kept rows; they stay kept if that fails."""
        if self._rows:
            self.write({})


class MemoryStore:
    """Store in memory: for tests, and for swarms that do not persist their visitors."""

    def __init__(self) -> None:
        self.rows: dict[bytes, bytes] = {}

    def load(self) -> dict[bytes, bytes]:
        """Return all rows by their keys."""
        return dict(self.rows)

    def write(self, rows: Mapping[bytes, bytes | None]) -> None:
        """Write rows, and delete those that are None."""
        for key, row in rows.items():
            if row is None:
                self.rows.pop(key, None)
            else:
                self.rows[key] = row
