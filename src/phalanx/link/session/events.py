"""What a session's ends ask of their surroundings, and what they report."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from .errors import EndReason, Reason
from .messages import Role, Standing
from .secret import Secret


class Now(NamedTuple):
    """The time, as a server is told it."""

    ms: int  # of a clock that never goes back
    unix_s: int  # for tickets and resume secrets, which outlive the process


# --- of a server -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Send:
    """Send bytes to one connection; on a broker, to this topic below the root."""

    connection: int
    data: bytes = field(repr=False)
    topic: str = ""


@dataclass(frozen=True, slots=True)
class Publish:
    """Send an update to these connections; on a broker, once to this topic below the root."""

    connections: tuple[int, ...]
    data: bytes = field(repr=False)
    topic: str


@dataclass(frozen=True, slots=True)
class Listen:
    """On a broker: these topics are this connection's from now on, and no others."""

    connection: int
    topics: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Close:
    """Close a connection once what was sent is out. `reason` is a PeerError's, or an end's in small letters."""

    connection: int
    reason: str


@dataclass(frozen=True, slots=True)
class Joined:
    """A visitor is connected, and admitted or waiting for approval."""

    visitor: int
    name: str
    role: Role
    is_new: bool  # it did not resume
    waiting: bool


@dataclass(frozen=True, slots=True)
class Left:
    """A visitor's connection is over."""

    visitor: int


@dataclass(frozen=True, slots=True)
class Commanded:
    """A visitor that may drive this robot commands it; call `accept` once that was carried out, or `refuse`.

    `is_stop`: stop it, whatever the payload says.
    """

    visitor: int
    robot: str
    name: str
    payload: bytes
    is_stop: bool


@dataclass(frozen=True, slots=True)
class Requested:
    """A visitor asks something; answer with `reply` or `refuse`."""

    visitor: int
    number: int
    name: str
    payload: bytes


@dataclass(frozen=True, slots=True)
class CommandRefused:
    """A command of a visitor was refused: for the trail."""

    visitor: int
    robot: str
    reason: Reason


ServerEvent = Send | Publish | Listen | Close | Joined | Left | Commanded | Requested | CommandRefused


# --- of a client -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Transmit:
    """Send bytes to the server; on a broker, to this topic below the root."""

    data: bytes = field(repr=False)
    topic: str = ""


@dataclass(frozen=True, slots=True)
class Hear:
    """On a broker: subscribe to these topics below the root, and to no others."""

    topics: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Admitted:
    """The server knows this visitor."""

    visitor: int
    name: str


@dataclass(frozen=True, slots=True)
class KeepSecret:
    """Store a secret to resume with, and then call `stored`."""

    secret: Secret
    lifetime_s: int


@dataclass(frozen=True, slots=True)
class Stands:
    """What this visitor may do now."""

    standing: Standing


@dataclass(frozen=True, slots=True)
class Updated:
    """The state of the swarm."""

    state: bytes


@dataclass(frozen=True, slots=True)
class Replied:
    """The answer to a request."""

    number: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class WasRefused:
    """A command (number 0) or a request was refused."""

    number: int
    reason: Reason


@dataclass(frozen=True, slots=True)
class Ended:
    """The session is over; the reason is that of the server, or None: no answer to a handshake."""

    reason: EndReason | None


ClientEvent = Transmit | Hear | Admitted | KeepSecret | Stands | Updated | Replied | WasRefused | Ended
