"""The state of a swarm that lives an encoded mission: how far each robot is, and what has been decoded."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from phalanx.mission import Built, Mission
from phalanx.mission.landmarks import FloorPlan

from .swarm import Point, Swarm

# What a robot has learnt that its odometry leaves out: of the way and of turns in thousandths, and to the left for each
# metre in hundredths of a degree. Source: Encoded graphs §VI-F.
Drift = tuple[int, int, int]


def drift_of(way: float, turn: float, curve_radpm: float) -> Drift:
    """Return a belief's drift in these units, from its shares and radians per metre."""
    return round(1000 * way), round(1000 * turn), round(100 * math.degrees(curve_radpm))


@dataclass(frozen=True, slots=True, kw_only=True)
class Walk:
    """The progress of one robot."""

    address: str
    name: str
    phase: str  # waiting, seeking, returning, held or done
    decoded: int  # nodes, of its part of the mission
    of: int
    why: str  # it fell back or stopped, or ""
    drift: Drift = (0, 0, 0)


@dataclass(frozen=True, slots=True)
class DecodedPlace:
    """A landmark that some robot has decoded: where it is in the area, and its type, "" for another place."""

    at: Point
    type: str


@dataclass(frozen=True, slots=True)
class Progress:
    """The mission that runs."""

    id: str  # 16 bytes as hexadecimal digits, of its first part
    name: str  # for people
    nodes: int  # of all parts
    left: int  # those that nobody has decoded
    completed: int  # robots that are done


@dataclass(frozen=True, slots=True)
class Decoded:
    """A robot decoded a node for the first time."""

    robot: int  # their numbers
    node: int
    name: str  # what the author called the node; "" in the paper profile
    place_m: tuple[float, float] | None  # where it is, map frame
    type: str  # of the landmark that was recognised; "" for nodes of other things


@dataclass(frozen=True, slots=True)
class NotValidated:
    """A robot fell back, stopped, or did not believe a match."""

    robot: int
    why: str


@dataclass(frozen=True, slots=True)
class Completed:
    """A robot's mission is done."""

    robot: int


News = Decoded | NotValidated | Completed


@runtime_checkable
class OnMission(Swarm, Protocol):
    """A swarm whose robots live missions in a building."""

    @property
    def plan(self) -> FloorPlan:
        """The building."""

    def walls_mm(self) -> list[list[int]]:
        """Return x, y of both ends of each wall, in the area."""

    def check(self, plain: Mission) -> None:
        """Check that these robots can live such a mission, before it is compiled, which takes its time.

        Raises: UsageError: they lack a sensor that it wants.
        """

    def prepare(self, plain: Mission, built: Sequence[Built]) -> Callable[[], None]:
        """Return a function that has all robots begin a mission, of which each part is built, in their order.

        It raises PeerError if one must not.
        Raises: UsageError: as `check`, or robots cannot be put where a part begins.
        """

    def progress(self) -> Progress | None:
        """Return the mission that runs, or ran last."""

    def plain(self) -> Mission | None:
        """Return the source of the mission that `progress` returns; None without, or if only its files are known."""

    def walks(self) -> Sequence[Walk]:
        """Return one for every robot."""

    def lit(self) -> Sequence[DecodedPlace]:
        """Return what was decoded and has a place, in that order."""

    def news(self) -> Sequence[tuple[str, News]]:
        """Return (address, news of that robot) since the last call, oldest first."""
