"""The swarm as whoever commands it sees it: simulated, real or protected ones all stand behind this.

Lengths are millimetres, x to the right and y down from the area's top left corner; a direction is in whole degrees,
0 along +y and clockwise on the screen (docs/spec/vocabulary.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable


@dataclass(frozen=True, slots=True)
class Point:
    """A place in the area, mm."""

    x_mm: float
    y_mm: float


@dataclass(frozen=True, slots=True)
class Led:
    """A colour, 0..255 each."""

    red: int
    green: int
    blue: int


class Robot(NamedTuple):
    """One robot at one moment."""

    address: str  # 16 upper-case hexadecimal digits
    name: str  # short, for people
    at: Point
    direction_deg: int  # whole degrees
    battery_v: float  # 0 of a robot that tells none
    led: Led
    route: tuple[Point, ...]  # the points being followed, the first where it stood when told; () when it follows none
    threshold_mm: float  # how near counts as reached
    heard_at_s: float  # when it last spoke, seconds since 1970
    history: Sequence[Point]  # where it has been, oldest first


class Swarm(Protocol):
    """Robots that can be watched and told what to do.

    Every method that takes an address raises `phalanx.errors.Unknown` if no such robot is there. They are called from
    the gateway's event loop: they must not wait. What else they raise is logged; a failed stop is tried again.

    `stop`, `hold` and `release` are called from another thread, also while a method of the others runs or hangs, and
    must not wait for it.
    """

    @property
    def area_mm(self) -> tuple[int, int]:
        """Width and height of the area."""

    def robots(self) -> Sequence[Robot]:
        """Every robot that is there now."""

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:
        """Turn the wheels, -100..100, until told otherwise; ends waypoint following."""

    def stop(self, address: str) -> None:
        """Stand still, and follow nothing, until told otherwise."""

    def hold(self) -> None:
        """Every robot stands still, those too that come, whatever they are told, until `release`: an emergency stop.

        Called ten times a second for as long as it lasts: a message to a robot may be lost.
        """

    def release(self) -> None:
        """Robots may be told to move again; those on a mission go on."""

    def set_led(self, address: str, led: Led) -> None:
        """Show a colour."""

    def follow(self, address: str, route: Sequence[Point], threshold_mm: float) -> None:
        """Visit these points in order; none stops the robot."""

    def clear_history(self, address: str) -> None:
        """Forget where the robot has been."""


@runtime_checkable
class Routed(Swarm, Protocol):
    """A swarm whose robots keep shorter routes than most."""

    @property
    def longest_route(self) -> int:
        """Most points that a robot is told to follow."""


@runtime_checkable
class Stepped(Swarm, Protocol):
    """A swarm whose world stands still unless it is told that time passes."""

    def step(self, dt_s: float) -> None:
        """Let so many seconds pass."""
