"""Limits of connections that are not admitted yet, per address and in total."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Protocol

from phalanx.config.front import FrontConfig

from .turns import Rows


class Newcomer(Protocol):
    """Connection or TLS handshake that is not complete."""

    until_s: float  # deadline

    def leave(self) -> None:
        """Close the connection."""


class Newcomers:
    """Incomplete handshakes. If there are too many, the oldest of the address, or of the busiest address, is closed.

    Refusing new ones instead would lock out honest visitors.

    Args:
        on_silent: called with the address of each newcomer that is closed, by a limit or its deadline.
    """

    def __init__(self, limits: FrontConfig, on_silent: Callable[[str], None]) -> None:
        self._limits, self._on_silent = limits, on_silent
        self._rows: Rows[Newcomer] = Rows()
        self._addresses: dict[Newcomer, str] = {}

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[Newcomer]:
        return iter(self._rows)

    def add(self, address: str, newcomer: Newcomer) -> None:
        """Add a connection, or make it the newest again."""
        self.remove(newcomer)
        self._rows.add(address, newcomer)
        self._addresses[newcomer] = address
        if self._rows.count(address) > self._limits.newcomers_max_per_address:
            self._close_oldest(address)
        elif len(self._rows) > self._limits.newcomers_max:
            self._close_oldest(self._rows.crowded())

    def remove(self, newcomer: Newcomer) -> None:
        """Remove a connection, if it is here."""
        address = self._addresses.pop(newcomer, None)
        if address is not None:
            self._rows.remove(address, newcomer)

    def sweep(self, now_s: float) -> None:
        """Close connections whose deadline has passed."""
        for newcomer in [each for each in self if each.until_s <= now_s]:
            self._close(newcomer)

    def _close_oldest(self, address: str) -> None:
        self._close(self._rows.oldest(address))

    def _close(self, newcomer: Newcomer) -> None:
        self._on_silent(self._addresses[newcomer])
        self.remove(newcomer)
        newcomer.leave()
