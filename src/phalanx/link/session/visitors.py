"""Visitors: who was admitted, what each may do, and the secret with which each resumes.

Every change is written before its caller goes on, so that no removed visitor comes back after a crash.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain, count

from phalanx.config.session import SessionConfig
from phalanx.wire.sessions import DOOR_KEY, DOOR_ROW, VISITOR_KEY, VISITOR_ROW

from .errors import TooMany, UnknownSecret
from .messages import Role
from .nickname import NICKNAME_CHARACTERS, looks
from .secret import NO_ID, RESUME_BYTES, Kind, Secret
from .store import Store

NO_SECRET = bytes(RESUME_BYTES)
LINE = "\n"
FEW = 100  # with one name: so many numbers are tried each time, those above once
Rows = Mapping[bytes, bytes | None]
Spend = Callable[[bytes], Rows]  # a use of this ticket; returns what is written with it


@dataclass(frozen=True, slots=True)
class Visitor:
    """Somebody who was admitted."""

    id: int
    name: str
    role: Role
    waiting: bool  # for approval
    robots: frozenset[str]  # that it may drive; empty: any
    ticket: bytes  # id of the ticket that it joined with; zeros: none
    expires_s: int  # Unix time until which it may resume
    secret: bytes = field(repr=False)  # with which it resumes; zeros: a newcomer, which has confirmed none yet
    pending: bytes = field(default=NO_SECRET, repr=False)  # its successor, not yet confirmed; zeros: none

    @property
    def is_new(self) -> bool:
        """Return whether it may not have read its first secret: it may come again as it came."""
        return self.secret == NO_SECRET

    def secrets(self) -> list[Secret]:
        """Return the secrets that are valid now."""
        return [Secret(Kind.RESUME, raw) for raw in (self.secret, self.pending) if raw != NO_SECRET]


class Visitors:
    """All who may resume."""

    def __init__(self, config: SessionConfig, store: Store) -> None:
        """Load them. Raises: MalformedRecord: the store has rows of another form."""
        self._config, self._store = config, store
        self._all: dict[int, Visitor] = {}
        self._by_secret: dict[bytes, tuple[int, Secret]] = {}
        self._by_look: dict[str, int] = {}
        self._number = FEW  # behind the next name of which there are many
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
        """Return who resumes with a secret of this id. Raises: UnknownSecret."""
        known = self._by_secret.get(secret_id)
        visitor = self._all[known[0]] if known else None
        if known is None or visitor is None or visitor.expires_s <= unix_s:
            raise UnknownSecret("no such resume secret")
        return visitor, known[1]

    def replaced(self, ticket: bytes, uses: int, connected: Mapping[int, object]) -> int:
        """Return whose place the next newcomer by a ticket takes, if all its uses have newcomers; 0: nobody's."""
        new = [each.id for each in self._all.values() if each.is_new and each.ticket == ticket]
        return min(new, key=lambda each: (each in connected, each)) if len(new) >= uses > 0 else 0

    def admit(self, made: Visitor, connected: Mapping[int, object], unix_s: int, replaced: int = 0) -> Visitor:
        """Write a new visitor, under an id that nobody had and a nickname like nobody's, in place of another or none.

        Raises: TooMany: no place is free, and none may be taken.
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
        """Write what has changed of a visitor, and return it. Raises: UnknownSecret: it was removed."""
        if visitor.id not in self._all:
            raise UnknownSecret("a visitor that was removed")
        self._store.write({**(beside or {}), _key(visitor.id): _row(visitor)})
        self._forget(visitor.id)
        self._keep(visitor)
        return visitor

    def renew(self, visitor_id: int, used: bytes, fresh: bytes, unix_s: int, spend: Spend) -> Visitor:
        """Give a visitor the next secret to resume with; the one that it used stays valid until it has stored that.

        A next one that was given before and not confirmed is given again: a client that has stored it, and whose word
        is still on its way when an older connection's first record arrives, would have no valid secret else.

        Raises: UnknownSecret: it was removed.
        """
        visitor = self._all.get(visitor_id)
        if visitor is None:
            raise UnknownSecret("a visitor that was removed")
        expires_s = unix_s + self._config.resume_s
        given = visitor.pending if used == visitor.secret and visitor.pending != NO_SECRET else fresh
        renewed = replace(visitor, secret=used, pending=given, expires_s=expires_s)
        return self.change(renewed, spend(visitor.ticket) if visitor.is_new else None)

    def stored(self, visitor_id: int, secret_id: bytes, spend: Spend) -> None:
        """Drop the secret before, as the visitor has stored its successor. A newcomer's ticket is used with that."""
        visitor = self._all.get(visitor_id)
        if visitor and visitor.pending != NO_SECRET and Secret(Kind.RESUME, visitor.pending).id == secret_id:
            beside = spend(visitor.ticket) if visitor.is_new else None
            self.change(replace(visitor, secret=visitor.pending, pending=NO_SECRET), beside)

    def remove(self, ids: set[int], beside: Rows | None = None, *, approval: bool) -> None:
        """Remove visitors, with the rows `beside`; newcomers wait for approval from now on, or not."""
        self.approval = approval
        gone: dict[bytes, bytes | None] = {_key(each): None for each in sorted(ids)}
        self._store.write({**(beside or {}), **gone, DOOR_KEY.encode(): self._door()})
        for each in ids & self._all.keys():
            self._forget(each)

    def set_approval(self, approval: bool) -> None:
        """Write whether newcomers wait for approval."""
        self.remove(set(), approval=approval)

    def _room(self, made: Visitor, connected: Mapping[int, object], unix_s: int) -> list[int]:
        """Return whom to forget for a newcomer: those whose time is over, or who would be first.

        Who came without a ticket takes no place of one who came with one: anybody can do so as often as he likes.
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
        """Return a nickname that looks like no visitor's: it says who drives."""
        wish = wish or f"Visitor {self._next}"
        if self._is_free(looks(wish), gone):
            return wish
        short = wish[: NICKNAME_CHARACTERS - 6].strip()
        seen = looks(short)
        number = next(
            number
            for number in chain(range(2, FEW), count(self._number))
            if self._is_free({each + digits for each in seen for digits in looks(str(number))}, gone)
        )
        self._number = max(self._number, number + 1)
        return f"{short} {number}"

    def _is_free(self, seen: set[str], gone: list[int]) -> bool:
        return all(self._by_look.get(each) in (None, *gone) for each in seen)

    def _door(self) -> bytes:
        return DOOR_ROW.encode(approval=self.approval, next_visitor=self._next)

    def _keep(self, visitor: Visitor) -> None:
        self._all[visitor.id] = visitor
        for each in looks(visitor.name):
            self._by_look.setdefault(each, visitor.id)
        for secret in visitor.secrets():
            self._by_secret[secret.id] = visitor.id, secret

    def _forget(self, visitor_id: int) -> None:
        visitor = self._all.pop(visitor_id)
        for each in looks(visitor.name):
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
