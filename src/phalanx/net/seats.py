"""Seats at a server: so many in all, and none that one address has to itself.

When all are taken, one more takes that of one from where most are: so whoever has one address pushes out only who
shares it. It is whoever was silent longest, of those first whom we served nothing. Who is known keeps its seat
meanwhile.
"""

from __future__ import annotations

import ipaddress
import itertools
import resource
from collections.abc import Iterator
from typing import Generic, Protocol, TypeVar


class Seated(Protocol):
    """A connection."""

    place: str  # where it comes from
    heard_at_s: float

    def leave(self) -> None:
        """Hang up at once, and say that it has gone."""


Who = TypeVar("Who", bound=Seated)

KNOWN_PERCENT = 90  # of the seats, at most, while there are others to push out


class _Place(Generic[Who]):
    """Who comes from one place: those whom we served nothing yet, and those whom we did.

    In each row who was silent longest is first: so whoever comes by the thousand makes us search nothing.
    """

    def __init__(self) -> None:
        self.strangers: dict[Who, None] = {}
        self.served: dict[Who, None] = {}

    def __len__(self) -> int:
        return len(self.strangers) + len(self.served)

    def __iter__(self) -> Iterator[Who]:
        return itertools.chain(self.strangers, self.served)

    def first(self, but: Who) -> Who:
        """Who should leave. Those who come and say nothing push out each other, once they are more than the others."""
        row = self if 2 * len(self.strangers) > len(self) else self.served
        return next((who for who in row if who is not but), but)

    def drop(self, who: Who) -> bool:
        """It is in no row any more; whether it was in one."""
        for row in (self.strangers, self.served):
            if who in row:
                del row[who]
                return True
        return False


class _Places(Generic[Who]):
    """Who comes from where."""

    def __init__(self) -> None:
        self._count = 0
        self._from: dict[str, _Place[Who]] = {}
        # Places by how many come from there, which was silent longest first: so whoever comes from everywhere makes us
        # search nothing either.
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
        """Who should leave, of where most are."""
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
        """Whether it is here."""
        place = self._from.get(who.place, _Place())
        if not place.drop(who):
            return False
        place.served[who] = None
        self._is_now(who.place, len(place), len(place))
        return True

    def drop(self, who: Who) -> bool:
        """Whether it was here."""
        place = self._from.get(who.place, _Place())
        if not place.drop(who):
            return False
        self._count -= 1
        self._is_now(who.place, len(place) + 1, len(place))
        if not place:
            del self._from[who.place]
        return True


class Seats(Generic[Who]):
    """Who sits where, and of whom we know that they may."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._guests: _Places[Who] = _Places()
        self._known: _Places[Who] = _Places()

    def __iter__(self) -> Iterator[Who]:
        return itertools.chain(self._guests, self._known)

    def __len__(self) -> int:
        return len(self._guests) + len(self._known)

    def take(self, who: Who) -> None:
        """One more; somebody leaves if that is one too many."""
        self._guests.add(who)
        if len(self) > self._most:
            crowded = 100 * len(self._known) > KNOWN_PERCENT * self._most
            (self._known if crowded else self._guests).first(who).leave()

    def heard(self, who: Who) -> None:
        """It said something that we serve, just now."""
        if not self._guests.heard(who):
            self._known.heard(who)

    def know(self, who: Who) -> None:
        """It is known from now on."""
        if self._guests.drop(who):
            self._known.add(who)
            self._known.heard(who)

    def gone(self, who: Who) -> None:
        """It has left."""
        if not self._guests.drop(who):
            self._known.drop(who)


def place_of(address: str) -> str:
    """Where one comes from: an address, or the network that one machine has as many addresses of as it likes."""
    try:
        ip = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(ip, ipaddress.IPv6Address):
        return str(ip.ipv4_mapped or ipaddress.ip_network((ip, 64), strict=False))
    return str(ip)


def allow_files(wanted: int) -> int:
    """How many we may open from now on: at least `wanted`, if the system lets us.

    The usual soft limit of 1024 is a classroom of phones, or one idler with a script.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    return files()


def files() -> int:
    """How many we may open."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return 2**31 if soft == resource.RLIM_INFINITY else soft


def a_share(wanted: int, files_each: int = 1) -> int:
    """Return as many connections as wanted, of so many files each, or what fits a quarter of all files."""
    return max(1, min(wanted, files() // 4 // files_each))
