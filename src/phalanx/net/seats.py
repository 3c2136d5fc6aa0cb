"""Limit of a server's connections ("seats"), shared fairly among addresses.

When all seats are taken, a new connection evicts one of the address with the most connections, so a client with one
address evicts only connections of that address. Of these the one that was idle longest is evicted, first among those
that were served nothing yet. Known connections keep their seats.
"""

from __future__ import annotations

import ipaddress
import itertools
import resource
from collections.abc import Iterator
from typing import Generic, Protocol, TypeVar


class Seated(Protocol):
    """Connection that has a seat."""

    place: str  # address or network of the client, see `place_of`
    heard_at_s: float  # time of its last request

    def leave(self) -> None:
        """Close the connection at once, and call `Seats.gone`."""


Who = TypeVar("Who", bound=Seated)

KNOWN_PERCENT = 90  # share of the seats above which known connections are evicted too


class _Place(Generic[Who]):
    """Connections of one place: those that were served nothing yet, and those that were.

    Both are ordered by idle time, longest first, so that an eviction needs no search.
    """

    def __init__(self) -> None:
        self.strangers: dict[Who, None] = {}
        self.served: dict[Who, None] = {}

    def __len__(self) -> int:
        return len(self.strangers) + len(self.served)

    def __iter__(self) -> Iterator[Who]:
        return itertools.chain(self.strangers, self.served)

    def first(self, but: Who) -> Who:
        """Return the connection to evict, not `but`: a stranger if most are strangers, else a served one."""
        row = self if 2 * len(self.strangers) > len(self) else self.served
        return next((who for who in row if who is not but), but)

    def drop(self, who: Who) -> bool:
        """Remove a connection; return whether it was there."""
        for row in (self.strangers, self.served):
            if who in row:
                del row[who]
                return True
        return False


class _Places(Generic[Who]):
    """Connections by place."""

    def __init__(self) -> None:
        self._count = 0
        self._from: dict[str, _Place[Who]] = {}
        # Places by their number of connections, in the order of their last change, so that no search is needed.
        self._crowds: dict[int, dict[str, None]] = {}
        self._crowd = 0

    def __iter__(self) -> Iterator[Who]:
        return itertools.chain.from_iterable(self._from.values())

    def __len__(self) -> int:
        return self._count

    def add(self, who: Who) -> None:
        place = self._from.setdefault(who.place, _Place())
        place.strangers[who] = None
        self._count += 1
        self._is_now(who.place, len(place) - 1, len(place))

    def first(self, but: Who) -> Who:
        """Return the connection to evict, of the place with the most connections."""
        crowded = next(iter(self._crowds[self._crowd]))
        return self._from[crowded].first(but)

    def _is_now(self, place: str, before: int, crowd: int) -> None:
        if before:
            del self._crowds[before][place]
            if not self._crowds[before]:
                del self._crowds[before]
        if crowd:
            self._crowds.setdefault(crowd, {})[place] = None
        if self._crowd not in self._crowds or crowd > self._crowd:
            self._crowd = crowd

    def heard(self, who: Who) -> bool:
        """Mark a connection as served just now; return whether it is here."""
        place = self._from.get(who.place, _Place())
        if not place.drop(who):
            return False
        place.served[who] = None
        self._is_now(who.place, len(place), len(place))
        return True

    def drop(self, who: Who) -> bool:
        """Remove a connection; return whether it was here."""
        place = self._from.get(who.place, _Place())
        if not place.drop(who):
            return False
        self._count -= 1
        self._is_now(who.place, len(place) + 1, len(place))
        if not place:
            del self._from[who.place]
        return True


class Seats(Generic[Who]):
    """All connections with a seat: known ones, which are evicted last, and others."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._guests: _Places[Who] = _Places()
        self._known: _Places[Who] = _Places()

    def __iter__(self) -> Iterator[Who]:
        return itertools.chain(self._guests, self._known)

    def __len__(self) -> int:
        return len(self._guests) + len(self._known)

    def take(self, who: Who) -> None:
        """Give a new connection a seat; evict one if there are too many."""
        self._guests.add(who)
        if len(self) > self._most:
            crowded = 100 * len(self._known) > KNOWN_PERCENT * self._most
            (self._known if crowded else self._guests).first(who).leave()

    def heard(self, who: Who) -> None:
        """Record a request of a connection that is being served."""
        if not self._guests.heard(who):
            self._known.heard(who)

    def mark_known(self, who: Who) -> None:
        """Mark a connection as known, so that strangers do not evict it."""
        if self._guests.drop(who):
            self._known.add(who)
            self._known.heard(who)

    def gone(self, who: Who) -> None:
        """Free the seat of a closed connection."""
        if not self._guests.drop(who):
            self._known.drop(who)


def place_of(address: str) -> str:
    """Return what a client is counted by: its IPv4 address, or the /64 network of its IPv6 address."""
    try:
        ip = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(ip, ipaddress.IPv6Address):
        return str(ip.ipv4_mapped or ipaddress.ip_network((ip, 64), strict=False))
    return str(ip)


def raise_file_limit(wanted: int) -> int:
    """Raise the limit of open files to `wanted`, as far as the system allows; return the limit.

    A classroom of phones, or one client with a script, can reach the usual soft limit of 1024.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    return files()


def files() -> int:
    """Return the limit of open files."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return 2**31 if soft == resource.RLIM_INFINITY else soft


def connection_limit(wanted: int, files_each: int = 1) -> int:
    """Return `wanted` connections, reduced so that they need at most a quarter of the open files allowed."""
    return max(1, min(wanted, files() // 4 // files_each))
