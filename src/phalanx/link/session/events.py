"""Events of `SessionServer` and `SessionClient`: requests for I/O to their callers, and reports."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from .errors import EndReason, Reason
from .messages import Role, Standing
from .secret import Secret


class Now(NamedTuple):
    """Time, as an argument of the server's methods."""

    ms: int  # monotonic clock
    unix_s: int  # Unix time, for tickets and resume secrets, which outlive the process


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
class SetConnectionTopics:
    """On a broker: set the topics of this connection to exactly these."""

    connection: int
    topics: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Close:
    """Close a connection after flushing. `reason` is that of a PeerError, or an EndReason's name in lower case."""

    connection: int
    reason: str


@dataclass(frozen=True, slots=True)
class Joined:
    """A visitor has connected; it is admitted, or waits for approval."""

    visitor: int
    name: str
    role: Role
    is_new: bool  # it did not resume
    waiting: bool


@dataclass(frozen=True, slots=True)
class Left:
    """A visitor has disconnected."""

    visitor: int


@dataclass(frozen=True, slots=True)
class Commanded:
    """A permitted command of a visitor; call `accept` once it was carried out, or `refuse`.

    `is_stop`: stop the robot, whatever the payload is.
    """

    visitor: int
    robot: str
    name: str
    payload: bytes
    is_stop: bool


@dataclass(frozen=True, slots=True)
class Requested:
    """A request of a visitor; answer with `reply` or `refuse`."""

    visitor: int
    number: int
    name: str
    payload: bytes


@dataclass(frozen=True, slots=True)
class CommandRefused:
    """A command of a visitor was refused; for the trail."""

    visitor: int
    robot: str
    reason: Reason


ServerEvent = Send | Publish | SetConnectionTopics | Close | Joined | Left | Commanded | Requested | CommandRefused


# --- of a client -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Transmit:
    """Send bytes to the server; on a broker, to this topic below the root."""

    data: bytes = field(repr=False)
    topic: str = ""


@dataclass(frozen=True, slots=True)
class SetTopics:
    """On a broker: subscribe to these topics below the root, and to no others."""

    topics: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Admitted:
    """The server has admitted this visitor, or lets it wait for approval."""

    visitor: int
    name: str


@dataclass(frozen=True, slots=True)
class KeepSecret:
    """Store a resume secret, and then call `stored`."""

    secret: Secret
    lifetime_s: int


@dataclass(frozen=True, slots=True)
class StandingChanged:
    """The current rights of this visitor."""

    standing: Standing


@dataclass(frozen=True, slots=True)
class Updated:
    """A new state of the swarm."""

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
    """The session is over; `reason` is the server's, or None: the client left, or the server stopped answering."""

    reason: EndReason | None


ClientEvent = Transmit | SetTopics | Admitted | KeepSecret | StandingChanged | Updated | Replied | WasRefused | Ended
