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
