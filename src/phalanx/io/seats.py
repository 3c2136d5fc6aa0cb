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


class _Place(Generic[Who]):
    """Who comes from one place: those who said nothing that we serve yet, and the others, who was silent longest first.

    So whoever comes by the thousand makes us search nothing.
    """

    def __init__(self) -> None:
        self.strangers: dict[Who, None] = {}
        self.known: dict[Who, None] = {}

    def __len__(self) -> int:
        return len(self.strangers) + len(self.known)

    def first(self, but: Who) -> Who:
        """Who should leave. Those who come and say nothing push out each other, once they are more than the others."""
        rows = (self.strangers, self.known) if len(self.strangers) > len(self.known) else (self.known, self.strangers)
        return next((who for row in rows for who in row if who is not but), but)


class Seats(Generic[Who]):
    """Who sits where."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._count = 0
        self._from: dict[str, _Place[Who]] = {}

    def __iter__(self) -> Iterator[Who]:
        for place in self._from.values():
            yield from place.strangers
            yield from place.known

    def __len__(self) -> int:
        return self._count

    def take(self, who: Who) -> None:
        """One more; somebody leaves if that is one too many."""
        self._from.setdefault(who.place, _Place()).strangers[who] = None
        self._count += 1
        if self._count > self._most:
            crowd = max(map(len, self._from.values()))
            firsts = [place.first(who) for place in self._from.values() if len(place) == crowd]
            min(firsts, key=lambda each: (each is who, each.heard_at_s)).leave()

    def heard(self, who: Who) -> None:
        """It said something that we serve, just now."""
        place = self._from.get(who.place, _Place())
        for row in (place.strangers, place.known):
            if who in row:
                del row[who]
                place.known[who] = None
                return

    def gone(self, who: Who) -> None:
        """It has left."""
        place = self._from.get(who.place, _Place())
        for row in (place.strangers, place.known):
            if who in row:
                del row[who]
                self._count -= 1
                if not place:
                    del self._from[who.place]
                return


def place_of(address: str) -> str:
    """Where one comes from: an address, or the network that one machine has as many addresses of as it likes."""
    try:
        ip = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(ip, ipaddress.IPv6Address):
        return str(ip.ipv4_mapped or ipaddress.ip_network((ip, 64), strict=False))
    return str(ip)
