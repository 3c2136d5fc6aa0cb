"""Admitted visitors, with their rights and resume secrets.

Methods store every change before they return, so that no removed visitor comes back after a crash.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain, count

from phalanx.config.session import SessionConfig
from phalanx.wire.sessions import DOOR_KEY, DOOR_ROW, VISITOR_KEY, VISITOR_ROW

from .errors import TooMany, UnknownSecret
from .messages import Role
from .nickname import NICKNAME_CHARACTERS, name_skeletons
from .secret import NO_ID, RESUME_BYTES, Kind, Secret
from .store import Store

NO_SECRET = bytes(RESUME_BYTES)
LINE = "\n"
FEW = 100  # numbers below are tried again for each name, those above only once
Rows = Mapping[bytes, bytes | None]
Spend = Callable[[bytes], Rows]  # counts a use of this ticket; returns the rows to write


@dataclass(frozen=True, slots=True)
class Visitor:
    """A person or program that was admitted, or waits for approval."""

    id: int
    name: str
    role: Role
    waiting: bool  # waits for approval
    robots: frozenset[str]  # robots that it may drive; empty: any
    ticket: bytes  # id of the ticket that it joined with; zeros: none
    expires_s: int  # Unix time until which it may resume
    secret: bytes = field(repr=False)  # resume secret; zeros: a newcomer, which has confirmed none yet
    pending: bytes = field(default=NO_SECRET, repr=False)  # next resume secret, not yet confirmed; zeros: none

    @property
    def is_new(self) -> bool:
        """Return whether it has not confirmed its first secret, so that it may join again with its invitation."""
        return self.secret == NO_SECRET

    def secrets(self) -> list[Secret]:
        """Return the resume secrets that are valid now."""
        return [Secret(Kind.RESUME, raw) for raw in (self.secret, self.pending) if raw != NO_SECRET]


class Visitors:
    """All visitors that may resume, in memory and in the store."""

    def __init__(self, config: SessionConfig, store: Store) -> None:
        """Load the visitors. Raises: MalformedRecord: the store has malformed rows."""
        self._config, self._store = config, store
        self._all: dict[int, Visitor] = {}
        self._by_secret: dict[bytes, tuple[int, Secret]] = {}
        self._by_look: dict[str, int] = {}
        self._number = FEW  # number to try next for a common name
        self.approval, self._next = False, 1
        for key, row in store.load().items():
            if key == DOOR_KEY.encode():
                door = DOOR_ROW.decode(row)
                self.approval, self._next = bool(door["approval"]), door["next_visitor"]
            elif key[:1] == VISITOR_KEY.encode(visitor=0)[:1]:
                self._keep(_visitor(VISITOR_KEY.decode(key)["visitor"], row))

    def __len__(self) -> int:
        return len(self._all)

    def __iter__(self) -> Iterator[Visitor]:
        return iter(list(self._all.values()))

    def find(self, visitor_id: int) -> Visitor | None:
        """Return a visitor, or None if it was removed."""
        return self._all.get(visitor_id)

    def by_secret(self, secret_id: bytes, unix_s: int) -> tuple[Visitor, Secret]:
        """Return the visitor with a resume secret of this id, and the secret. Raises: UnknownSecret."""
        known = self._by_secret.get(secret_id)
        visitor = self._all[known[0]] if known else None
        if known is None or visitor is None or visitor.expires_s <= unix_s:
            raise UnknownSecret("no such resume secret")
        return visitor, known[1]

    def replaced(self, ticket: bytes, uses: int, connected: Mapping[int, object]) -> int:
        """Return the newcomer that the next one with this ticket replaces; 0 while there are fewer than its uses."""
        new = [each.id for each in self._all.values() if each.is_new and each.ticket == ticket]
        return min(new, key=lambda each: (each in connected, each)) if len(new) >= uses > 0 else 0

    def admit(self, made: Visitor, connected: Mapping[int, object], unix_s: int, replaced: int = 0) -> Visitor:
        """Store a new visitor, with a new id and a unique nickname; it may replace another one.

        Raises: TooMany: there are too many visitors, and none may be dropped.
        """
        gone = [replaced] if replaced else self._room(made, connected, unix_s)
        rows: dict[bytes, bytes | None] = {_key(each): None for each in gone}
        visitor = replace(made, id=self._next, name=self._free_name(made.name, gone))
        self._next += 1
        self._store.write(rows | {_key(visitor.id): _row(visitor), DOOR_KEY.encode(): self._door()})
        for each in gone:
            self._forget(each)
        self._keep(visitor)
        return visitor

    def change(self, visitor: Visitor, beside: Rows | None = None) -> Visitor:
        """Store a changed visitor with the rows `beside`, and return it. Raises: UnknownSecret: it was removed."""
        if visitor.id not in self._all:
            raise UnknownSecret("the visitor was removed")
        self._store.write({**(beside or {}), _key(visitor.id): _row(visitor)})
        self._forget(visitor.id)
        self._keep(visitor)
        return visitor

    def renew(self, visitor_id: int, used: bytes, fresh: bytes, unix_s: int, spend: Spend) -> Visitor:
        """Set a visitor's next resume secret; the one that it used stays valid until it has stored the next.

        An unconfirmed next secret is sent again, not replaced: the client may have stored it already, and its
        confirmation may still be on the way when the first record of an older connection arrives.

        Raises: UnknownSecret: the visitor was removed.
        """
        visitor = self._all.get(visitor_id)
        if visitor is None:
            raise UnknownSecret("the visitor was removed")
        expires_s = unix_s + self._config.resume_s
        given = visitor.pending if used == visitor.secret and visitor.pending != NO_SECRET else fresh
        renewed = replace(visitor, secret=used, pending=given, expires_s=expires_s)
        return self.change(renewed, spend(visitor.ticket) if visitor.is_new else None)

    def stored(self, visitor_id: int, secret_id: bytes, spend: Spend) -> None:
        """Drop the old secret, as the visitor has stored the next one. This counts the use of a newcomer's ticket."""
        visitor = self._all.get(visitor_id)
        if visitor and visitor.pending != NO_SECRET and Secret(Kind.RESUME, visitor.pending).id == secret_id:
            beside = spend(visitor.ticket) if visitor.is_new else None
            self.change(replace(visitor, secret=visitor.pending, pending=NO_SECRET), beside)

    def remove(self, ids: set[int], beside: Rows | None = None, *, approval: bool) -> None:
        """Remove visitors, and write the rows `beside`; `approval`: newcomers wait for approval from now on."""
        self.approval = approval
        gone: dict[bytes, bytes | None] = {_key(each): None for each in sorted(ids)}
        self._store.write({**(beside or {}), **gone, DOOR_KEY.encode(): self._door()})
        for each in ids & self._all.keys():
            self._forget(each)

    def set_approval(self, approval: bool) -> None:
        """Set and store whether newcomers wait for approval."""
        self.remove(set(), approval=approval)

    def _room(self, made: Visitor, connected: Mapping[int, object], unix_s: int) -> list[int]:
        """Return the visitors to drop for a newcomer: all expired ones, else one, if possible a newcomer.

        A newcomer without a ticket does not displace a visitor with one, because anybody can join without one again.
        """
        rivals = [each for each in self._all.values() if each.waiting]
        if not made.waiting or len(rivals) < self._config.waiting_max:
            if len(self._all) < self._config.visitors_max:
                return []
            rivals = list(self._all.values())
        away = [each for each in rivals if each.id not in connected]
        over = [each.id for each in away if each.expires_s <= unix_s]
        if over:
            return over
        if made.ticket == NO_ID:
            away = [each for each in away if each.ticket == NO_ID]
        if not away:
            raise TooMany("visitors")
        first = min(away, key=lambda each: (not each.is_new, each.ticket != NO_ID, each.role, each.expires_s, each.id))
        return [first.id]

    def _free_name(self, wish: str, gone: list[int]) -> str:
        """Return a nickname that does not look like another visitor's, because it identifies the driver."""
        wish = wish or f"Visitor {self._next}"
        if self._is_free(name_skeletons(wish), gone):
            return wish
        short = wish[: NICKNAME_CHARACTERS - 6].strip()
        seen = name_skeletons(short)
        number = next(
            number
            for number in chain(range(2, FEW), count(self._number))
            if self._is_free({each + digits for each in seen for digits in name_skeletons(str(number))}, gone)
        )
        self._number = max(self._number, number + 1)
        return f"{short} {number}"

    def _is_free(self, seen: set[str], gone: list[int]) -> bool:
        return all(self._by_look.get(each) in (None, *gone) for each in seen)

    def _door(self) -> bytes:
        return DOOR_ROW.encode(approval=self.approval, next_visitor=self._next)

    def _keep(self, visitor: Visitor) -> None:
        self._all[visitor.id] = visitor
        for each in name_skeletons(visitor.name):
            self._by_look.setdefault(each, visitor.id)
        for secret in visitor.secrets():
            self._by_secret[secret.id] = visitor.id, secret

    def _forget(self, visitor_id: int) -> None:
        visitor = self._all.pop(visitor_id)
        for each in name_skeletons(visitor.name):
            if self._by_look.get(each) == visitor_id:
                del self._by_look[each]
        for secret in visitor.secrets():
            self._by_secret.pop(secret.id, None)


def _key(visitor_id: int) -> bytes:
    return VISITOR_KEY.encode(visitor=visitor_id)


def _row(visitor: Visitor) -> bytes:
    return VISITOR_ROW.encode(
        role=visitor.role,
        waiting=visitor.waiting,
        ticket=visitor.ticket or NO_ID,
        secret=visitor.secret,
        pending=visitor.pending,
        expires_s=visitor.expires_s,
        name=visitor.name.encode(),
        robots=LINE.join(sorted(visitor.robots)).encode(),
    )


def _visitor(visitor_id: int, row: bytes) -> Visitor:
    values = VISITOR_ROW.decode(row)
    robots = frozenset(filter(None, values["robots"].decode().split(LINE)))
    return Visitor(
        visitor_id,
        values["name"].decode(),
        Role(values["role"]),
        bool(values["waiting"]),
        robots,
        values["ticket"],
        values["expires_s"],
        values["secret"],
        values["pending"],
    )
