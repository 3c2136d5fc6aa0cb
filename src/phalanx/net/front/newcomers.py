"""Connections that were not admitted yet: so many of one address, and in all."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Protocol

from phalanx.config.front import FrontConfig

from .turns import Rows


class Newcomer(Protocol):
    """A connection, or a TLS handshake."""

    until_s: float  # when it is closed, if it has gone no further by then

    def leave(self) -> None:
        """Close it."""


class Newcomers:
    """Unfinished handshakes. One too many closes the oldest of its address, or of the address that has most.

    Refusing the one that comes would lock honest visitors out.

    Args:
        on_silent: called with the address of each that is closed because it went no further.
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
        """Count a connection, or count it as the newest again."""
        self.remove(newcomer)
        self._rows.add(address, newcomer)
        self._addresses[newcomer] = address
        if self._rows.count(address) > self._limits.newcomers_max_per_address:
            self._close_oldest(address)
        elif len(self._rows) > self._limits.newcomers_max:
            self._close_oldest(self._rows.crowded())

    def remove(self, newcomer: Newcomer) -> None:
        """Count a connection no longer."""
        address = self._addresses.pop(newcomer, None)
        if address is not None:
            self._rows.remove(address, newcomer)

    def sweep(self, now_s: float) -> None:
        """Close those whose time is over."""
        for newcomer in [each for each in self if each.until_s <= now_s]:
            self._close(newcomer)

    def _close_oldest(self, address: str) -> None:
        self._close(self._rows.oldest(address))

    def _close(self, newcomer: Newcomer) -> None:
        self._on_silent(self._addresses[newcomer])
        self.remove(newcomer)
        newcomer.leave()
