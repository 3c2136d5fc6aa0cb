"""What the two sides of the link say to the program around them, and what they ask of the broker.

Source: Qrkey §III-D, Table I; docs/spec/link.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from phalanx.errors import PeerError

from .pin import Epoch
from .topics import CommandTopic


@dataclass(frozen=True, slots=True)
class Publish:
    """Ask: publish these bytes."""

    topic: str
    payload: bytes = field(repr=False)


@dataclass(frozen=True, slots=True)
class Subscribe:
    """Ask: subscribe to this filter."""

    topic: str


@dataclass(frozen=True, slots=True)
class Unsubscribe:
    """Ask: unsubscribe from this filter."""

    topic: str


Ask = Publish | Subscribe | Unsubscribe


@dataclass(frozen=True, slots=True)
class Command:
    """A visitor's command for one robot. The payload is authentic JSON, and not checked further."""

    topic: CommandTopic
    payload: Any = field(repr=False)
    waited_s: float = field(default=0.0, compare=False)  # unread, on this side
    by: str | None = field(default=None, compare=False)  # nickname of its visitor, which a session proves
    is_stop: bool = False  # it stops the robot, whatever the payload says

    @property
    def address(self) -> str:
        """Robot it is for."""
        return self.topic.address

    @property
    def name(self) -> str:
        """What to do, such as `move_raw`."""
        return self.topic.name


@dataclass(frozen=True, slots=True)
class Request:
    """A visitor's request. `words` is the whole payload; it came in `size` bytes.

    Over a session there is no `client_id`: its visitor is known.
    """

    number: int
    client_id: str
    words: dict[str, Any] = field(repr=False)
    size: int = 0


@dataclass(frozen=True, slots=True)
class SharedAnswer:
    """Data with which all are answered who ask at about one time, and which does not change any more.

    What is sealed for them has the time of the first: it is good for as long as clocks may differ, 30 s.
    """

    data: Any = field(repr=False)
    # By number. Only the server's side writes here.
    plaintexts: dict[int, bytes] = field(default_factory=dict, repr=False, compare=False)


@dataclass(frozen=True, slots=True)
class Knock:
    """An authentic request under the last epoch: a phone that slept through a rotation. Source: docs/adr/0004."""

    asks: tuple[Ask, ...] = field(repr=False)


@dataclass(frozen=True, slots=True)
class Notification:
    """What the server tells everybody."""

    payload: Any = field(repr=False)
    timestamp_s: float


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to a request of ours."""

    number: int
    data: Any = field(repr=False)


@dataclass(frozen=True, slots=True)
class Moved:
    """A pin message was followed: the client now lives in `epoch`."""

    epoch: Epoch
    asks: tuple[Ask, ...] = field(repr=False)


@dataclass(frozen=True, slots=True)
class Rejected:
    """Bytes that were refused, and counted under `reason`."""

    error: PeerError

    @property
    def reason(self) -> str:
        """Word under which it is counted."""
        return self.error.reason
