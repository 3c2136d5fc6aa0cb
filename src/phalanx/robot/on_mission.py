"""Progress of a swarm on an encoded mission: the state of each robot, and the decoded nodes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from phalanx.mission import Built, Mission
from phalanx.mission.landmarks import FloorPlan

from .swarm import Point, Swarm

# Estimated errors of a robot's odometry: scale of distance and of turns in thousandths, and drift to the left per metre
# in hundredths of a degree. Source: Encoded graphs §VI-F.
Drift = tuple[int, int, int]


def drift_of(way: float, turn: float, curve_radpm: float) -> Drift:
    """Return a `Drift` from the scale errors, as fractions, and the curvature."""
    return round(1000 * way), round(1000 * turn), round(100 * math.degrees(curve_radpm))


@dataclass(frozen=True, slots=True, kw_only=True)
class Walk:
    """Progress of one robot."""

    address: str
    name: str
    phase: str  # waiting, seeking, returning, held or done
    decoded: int  # nodes of its part of the mission that it has decoded
    of: int  # all nodes of its part
    why: str  # reason why it fell back or stopped, or ""
    drift: Drift = (0, 0, 0)


@dataclass(frozen=True, slots=True)
class DecodedPlace:
    """A place that a robot has decoded, in the area; its type is that of the landmark, "" without one."""

    at: Point
    type: str


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a swarm's mission."""

    id: str  # 16 bytes as hexadecimal digits, of its first part
    name: str  # for display
    nodes: int  # in all parts
    left: int  # nodes that no robot has decoded
    completed: int  # robots that have completed their part


@dataclass(frozen=True, slots=True)
class Decoded:
    """Event: a robot has decoded a node that was not decoded before."""

    robot: int  # its id
    node: int  # its number
    name: str  # the author's name of the node; "" in the paper profile
    place_m: tuple[float, float] | None  # its position, map frame
    type: str  # of the landmark that was recognised; "" for nodes of other things


@dataclass(frozen=True, slots=True)
class NotValidated:
    """Event: a robot fell back, stopped, or rejected a match."""

    robot: int
    why: str


@dataclass(frozen=True, slots=True)
class Completed:
    """Event: a robot has completed its mission."""

    robot: int


News = Decoded | NotValidated | Completed


@runtime_checkable
class OnMission(Swarm, Protocol):
    """A swarm whose robots carry out encoded missions in a building."""

    @property
    def plan(self) -> FloorPlan:
        """Return the floor plan of the building."""

    def walls_mm(self) -> list[list[int]]:
        """Return x, y of both ends of each wall, in the area."""

    def check(self, plain: Mission) -> None:
        """Check that these robots can carry out a mission, before the slow compilation.

        Raises: UsageError: the robots lack a sensor that the mission needs.
        """

    def prepare(self, plain: Mission, built: Sequence[Built]) -> Callable[[], None]:
        """Return a function that starts a mission on all robots, one built part each, in their order.

        The function raises PeerError if a robot must not start its part.
        Raises: UsageError: as `check`, or robots cannot be placed at the start of a part.
        """

    def progress(self) -> Progress | None:
        """Return the progress of the current or last mission; None if there was none."""

    def plain(self) -> Mission | None:
        """Return the source of the current or last mission; None if there is none, or if only its files are known."""

    def walks(self) -> Sequence[Walk]:
        """Return the progress of every robot."""

    def lit(self) -> Sequence[DecodedPlace]:
        """Return the decoded places, in the order of decoding."""

    def news(self) -> Sequence[tuple[str, News]]:
        """Return the events since the last call with the robots' addresses, oldest first."""
