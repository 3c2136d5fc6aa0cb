"""Admission: the invitations that are valid now, and the rights each grants. Only this file holds the codes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from phalanx.config.session import SessionConfig
from phalanx.errors import UsageError
from phalanx.pace import TokenBucket
from phalanx.wire.sessions import TICKET_KEY, TICKET_ROW

from .errors import TooMany, UnknownSecret
from .invitation import new_room_code
from .limits import RoomCodeAttempts
from .messages import Role
from .secret import INVITATION_BYTES, NO_ID, Kind, Secret
from .store import Store
from .visitors import LINE


@dataclass(frozen=True, slots=True)
class Ticket:
    """Invitation for a fixed number of uses. Raises: UsageError."""

    secret: Secret = field(repr=False)
    role: Role
    uses: int  # uses left
    expires_s: int  # Unix time
    name: str = ""  # nickname of the visitor; empty: the visitor chooses
    robots: frozenset[str] = frozenset()  # robots that the visitor may drive; empty: any

    def __post_init__(self) -> None:
        if self.uses < 1:
            raise UsageError(f"a ticket for {self.uses} uses", "use 1 or more")
        if self.role is Role.OPERATE and self.uses != 1:
            raise UsageError("an operator's ticket for more than one use", "make one for each operator")


@dataclass(frozen=True, slots=True)
class Grant:
    """Rights that an invitation grants."""

    role: Role
    name: str = ""
    robots: frozenset[str] = frozenset()
    ticket: bytes = NO_ID
    uses: int = 0  # uses left of that ticket


class InvitationRegistry:
    """The open code, the room code and the tickets of a swarm.

    Attributes:
        open_role: role that the open code and the room code grant; never OPERATE.
    """

    def __init__(
        self, config: SessionConfig, store: Store, random_bytes: Callable[[int], bytes], now_ms: int, open_role: Role
    ) -> None:
        if open_role is Role.OPERATE:
            raise UsageError("an open code never admits operators", "make a ticket")
        self._config, self._store, self._random_bytes = config, store, random_bytes
        self.open_role = open_role
        self._tries = RoomCodeAttempts(config)
        self._tickets: dict[bytes, Ticket] = {}
        self._hellos: dict[bytes, TokenBucket] = {}  # limits of first messages with a ticket, on a broker
        for key, row in store.load().items():
            if key[:1] == TICKET_KEY.encode(id=NO_ID)[:1]:
                self._tickets[TICKET_KEY.decode(key)["id"]] = _ticket(row)
        self._before: Secret | None = None
        self._room: str | None = None
        self._code = self._new_code(now_ms)

    @property
    def code(self) -> Secret:
        """Return the secret of the current open code."""
        return self._code

    @property
    def room(self) -> str | None:
        """Return the current room code, eight digits; None if there is none."""
        return self._room

    def left_ms(self, now_ms: int) -> int:
        """Return the time until the open code changes."""
        return max(0, self._code_ms + self._config.code_ms - now_ms)

    def overlaps(self, now_ms: int) -> bool:
        """Return whether the previous open code is still accepted."""
        return len(self._codes(now_ms)) == 2

    def tickets(self) -> list[Ticket]:
        """Return the tickets with uses left; expired ones are included until the next ticket is added."""
        return list(self._tickets.values())

    def tick(self, now_ms: int) -> bool:
        """Change the open code when due, and accept the previous one for a while; return whether it changed."""
        age = now_ms - self._code_ms
        if age >= self._config.code_overlap_ms:
            self._before = None
        if age < self._config.code_ms:
            return False
        before = self._code
        self._code = self._new_code(now_ms)
        self._before = before
        return True

    def new_code(self, now_ms: int) -> None:
        """Replace the open code, and the room code if there is one; the old ones are refused from now on."""
        self._code = self._new_code(now_ms)
        self._before = None
        if self._room is not None:
            self.show_room()

    def show_room(self) -> str:
        """Make a new room code, with a new budget of attempts; return its digits. The old one is refused."""
        self._tries.begin()
        self._room = new_room_code(self._random_bytes)
        return self._room

    def hide_room(self) -> None:
        """Remove the room code."""
        self._room = None

    def add_ticket(self, ticket: Ticket, unix_s: int) -> None:
        """Store a ticket before it is shown, and delete expired ones. Raises: UsageError: there are too many."""
        over = [each for each, known in self._tickets.items() if known.expires_s <= unix_s]
        if len(self._tickets) - len(over) >= self._config.tickets_max:
            left_s = min(each.expires_s for each in self._tickets.values()) - unix_s
            hint = f"wait {max(0, left_s)} s until one expires, or make one ticket for many --uses"
            raise UsageError(f"more than {self._config.tickets_max} tickets", hint)
        rows: dict[bytes, bytes | None] = {_key(ticket): _row(ticket)}
        for each in over:
            rows |= self.revoke_ticket(each)
        self._store.write(rows)
        self._tickets[ticket.secret.id] = ticket

    def revoke_ticket(self, ticket_id: bytes) -> dict[bytes, bytes | None]:
        """Refuse a ticket from now on; return the rows that the caller has to write."""
        ticket = self._tickets.pop(ticket_id, None)
        self._hellos.pop(ticket_id, None)
        return {_key(ticket): None} if ticket else {}

    def count_hello(self, ticket_id: bytes, now_ms: int) -> None:
        """Count a first message on a broker with a valid ticket; the burst allows one per use. Raises: TooMany."""
        if ticket_id not in self._hellos:
            at_once = self._config.handshakes_at_once + self._tickets[ticket_id].uses
            self._hellos[ticket_id] = TokenBucket(self._config.handshakes_per_min / 60, at_once, now_ms / 1000)
        if not self._hellos[ticket_id].take(now_ms / 1000):
            raise TooMany("first messages with this ticket")

    def secret(self, kind: Kind, secret_id: bytes, address: str, now_ms: int, unix_s: int) -> Secret:
        """Return the secret with the kind and id of a first message. Raises: UnknownSecret; TriesUsedUp."""
        if kind is Kind.ROOM:
            if self._room is None or secret_id != NO_ID:
                raise UnknownSecret("there is no room code")
            self._tries.count(address, now_ms)
            return Secret(Kind.ROOM, self._room.encode())
        ticket = self._tickets.get(secret_id) if kind is Kind.TICKET else None
        if ticket and ticket.expires_s > unix_s:
            return ticket.secret
        for secret in self._codes(now_ms) if kind is Kind.OPEN else ():
            if secret.id == secret_id:
                return secret
        raise UnknownSecret("no such invitation")

    def use(self, secret: Secret, now_ms: int, unix_s: int) -> Grant:
        """Return the rights that a secret grants, once its handshake is confirmed: it may have been revoked since.

        `spend` counts the use of a ticket, later. Raises: UnknownSecret.
        """
        if secret.kind is Kind.ROOM:
            if self._room is None or secret.raw != self._room.encode():
                raise UnknownSecret("the room code has changed")
            return Grant(self.open_role)
        if secret.kind is Kind.TICKET:
            ticket = self._tickets.get(secret.id)
            if ticket is None or ticket.expires_s <= unix_s:
                raise UnknownSecret("the ticket is used up or revoked")
            return Grant(ticket.role, ticket.name, ticket.robots, secret.id, ticket.uses)
        if all(secret.raw != code.raw for code in self._codes(now_ms)):
            raise UnknownSecret("the code has changed")
        return Grant(self.open_role)

    def used(self, secret: Secret, address: str) -> None:
        """Replace a room code that has admitted a visitor; the budget for guesses stays the same."""
        if secret.kind is Kind.ROOM:
            self._tries.forgive(address)
            self._room = new_room_code(self._random_bytes)

    def spend(self, ticket_id: bytes) -> dict[bytes, bytes | None]:
        """Count a use of a ticket, once its visitor can resume; return the rows that the caller has to write."""
        ticket = self._tickets.get(ticket_id)
        if ticket is None or ticket.uses == 1:
            return self.revoke_ticket(ticket_id)
        self._tickets[ticket_id] = left = replace(ticket, uses=ticket.uses - 1)
        return {_key(left): _row(left)}

    def _codes(self, now_ms: int) -> list[Secret]:
        overlaps = self._before is not None and now_ms - self._code_ms < self._config.code_overlap_ms
        return [self._code, *([self._before] if self._before and overlaps else [])]

    def _new_code(self, now_ms: int) -> Secret:
        self._code_ms = now_ms
        return Secret(Kind.OPEN, self._random_bytes(INVITATION_BYTES))


def _key(ticket: Ticket) -> bytes:
    return TICKET_KEY.encode(id=ticket.secret.id)


def _row(ticket: Ticket) -> bytes:
    return TICKET_ROW.encode(
        secret=ticket.secret.raw,
        role=ticket.role,
        uses=ticket.uses,
        expires_s=ticket.expires_s,
        name=ticket.name.encode(),
        robots=LINE.join(sorted(ticket.robots)).encode(),
    )


def _ticket(row: bytes) -> Ticket:
    values = TICKET_ROW.decode(row)
    return Ticket(
        Secret(Kind.TICKET, values["secret"]),
        Role(values["role"]),
        values["uses"],
        values["expires_s"],
        values["name"].decode(),
        frozenset(filter(None, values["robots"].decode().split(LINE))),
    )
