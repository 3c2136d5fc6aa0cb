"""Rows that survive the gateway: visitors that may resume, tickets, and whether newcomers wait for approval.

A row is durable when `write` returns, and a write is all or nothing: what is acknowledged is written before.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol


class Store(Protocol):
    """Keys and rows, as in the byte table's `store`."""

    def load(self) -> dict[bytes, bytes]:
        """Return all rows by their keys."""
        ...

    def write(self, rows: Mapping[bytes, bytes | None]) -> None:
        """Write rows, and delete those that are None, in one transaction. Returns when all are on disk."""
        ...


class GroupedStore:
    """Writes to a store, or while `is_grouping` keeps rows until `flush`: many writes then wait for the disk once.

    Whoever groups acknowledges nothing of it before `flush` has returned.
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
        """Write rows, or keep them; those that are kept are written with the next, in their order."""
        self.writes += 1
        if self.is_grouping:
            self._rows |= rows
        else:
            self._store.write(self._rows | dict(rows))
            self._rows = {}

    def flush(self) -> None:
        """Write what was kept; it is kept still if that fails."""
        if self._rows:
            self.write({})


class MemoryStore:
    """Rows that are lost with the process: for tests, and for swarms that forget their visitors."""

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
