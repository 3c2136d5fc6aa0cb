"""Seats at a server: so many in all, and none that one address has to itself.

When all are taken, one more takes that of whoever was silent longest of those from where most are: so whoever has one
address pushes out only who shares it.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Iterator
from typing import Generic, Protocol, TypeVar


class Seated(Protocol):
    """A connection."""

    place: str  # where it comes from
    heard_at_s: float

    def leave(self) -> None:
        """Hang up at once, and say that it has gone."""


Who = TypeVar("Who", bound=Seated)


class Seats(Generic[Who]):
    """Who sits where."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._count = 0
        # By place, who was silent longest first: whoever comes by the thousand makes us search nothing.
        self._from: dict[str, dict[Who, None]] = {}

    def __iter__(self) -> Iterator[Who]:
        for some in self._from.values():
            yield from some

    def __len__(self) -> int:
        return self._count

    def take(self, who: Who) -> None:
        """One more; somebody leaves if that is one too many."""
        self._from.setdefault(who.place, {})[who] = None
        self._count += 1
        if self._count > self._most:
            crowd = max(map(len, self._from.values()))
            most = [some for some in self._from.values() if len(some) == crowd]
            others = (next((each for each in some if each is not who), who) for some in most)
            min(others, key=lambda each: (each is who, each.heard_at_s)).leave()

    def heard(self, who: Who) -> None:
        """It said something just now."""
        some = self._from.get(who.place, {})
        if who in some:
            del some[who]
            some[who] = None

    def gone(self, who: Who) -> None:
        """It has left."""
        some = self._from.get(who.place, {})
        if who in some:
            del some[who]
            self._count -= 1
            if not some:
                del self._from[who.place]


def place_of(address: str) -> str:
    """Where one comes from: an address, or the network that one machine has as many addresses of as it likes."""
    try:
        ip = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(ip, ipaddress.IPv6Address):
        return str(ip.ipv4_mapped or ipaddress.ip_network((ip, 64), strict=False))
    return str(ip)
