"""Events of the two sides of the link in mode qrkey, and their requests to the broker.

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
    """Request to the broker: publish these bytes."""

    topic: str
    payload: bytes = field(repr=False)


@dataclass(frozen=True, slots=True)
class Subscribe:
    """Request to the broker: subscribe to this filter."""

    topic: str


@dataclass(frozen=True, slots=True)
class Unsubscribe:
    """Request to the broker: unsubscribe from this filter."""

    topic: str


Ask = Publish | Subscribe | Unsubscribe


@dataclass(frozen=True, slots=True)
class Command:
    """A visitor's command for one robot. The payload is authentic JSON, not validated further."""

    topic: CommandTopic
    payload: Any = field(repr=False)
    waited_s: float = field(default=0.0, compare=False)  # time in this program's queue
    by: str | None = field(default=None, compare=False)  # nickname of the visitor, authenticated by its session
    is_stop: bool = False  # stops the robot, whatever the payload is

    @property
    def address(self) -> str:
        """Return the address of the robot."""
        return self.topic.address

    @property
    def name(self) -> str:
        """Return the name of the command, such as `move_raw`."""
        return self.topic.name


@dataclass(frozen=True, slots=True)
class Request:
    """A visitor's request. `words` is the whole payload; `size` is the length of the sealed message in bytes.

    In mode session `client_id` is empty: the session identifies the visitor.
    """

    number: int
    client_id: str
    words: dict[str, Any] = field(repr=False)
    size: int = 0


@dataclass(frozen=True, slots=True)
class SharedAnswer:
    """Immutable data that answers all requests which arrive at about the same time.

    The plaintexts have the time of the first request, so they can be used only for the tolerance of timestamps, 30 s.
    """

    data: Any = field(repr=False)
    # By request number. Only `ServerSide` writes here.
    plaintexts: dict[int, bytes] = field(default_factory=dict, repr=False, compare=False)


@dataclass(frozen=True, slots=True)
class Knock:
    """An authentic request under the last epoch: a phone that slept through a rotation. Source: docs/adr/0004."""

    asks: tuple[Ask, ...] = field(repr=False)


@dataclass(frozen=True, slots=True)
class Notification:
    """A message of the server to all clients."""

    payload: Any = field(repr=False)
    timestamp_s: float


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to one of this client's requests."""

    number: int
    data: Any = field(repr=False)


@dataclass(frozen=True, slots=True)
class Moved:
    """The client followed a pin message, and uses `epoch` from now on."""

    epoch: Epoch
    asks: tuple[Ask, ...] = field(repr=False)


@dataclass(frozen=True, slots=True)
class Rejected:
    """A message that was refused, and counted under `reason`."""

    error: PeerError

    @property
    def reason(self) -> str:
        """Return the reason under which the message is counted."""
        return self.error.reason
