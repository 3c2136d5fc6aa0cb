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
        """Return every robot that is there now."""

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
class RouteLimited(Swarm, Protocol):
    """A swarm whose robots keep shorter routes than most."""

    @property
    def longest_route(self) -> int:
        """Most points that a robot is told to follow."""


@runtime_checkable
class SteppedSwarm(Swarm, Protocol):
    """A swarm whose world stands still unless it is told that time passes."""

    def step(self, dt_s: float) -> None:
        """Let so many seconds pass."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shield:
    """One robot's shield at one moment."""

    address: str
    needed: int  # f_max + 1, fresh tokens that keep it alive
    full_s: float  # T_val, how long a token counts
    vouchers: tuple[tuple[str, float], ...]  # addresses, each with the seconds for which it still counts, longest first
    safe_mode: bool  # it has been stopped
    attack: str  # name of the one it runs, as the operator chose it; "" for an honest robot. Visitors are not told


@dataclass(frozen=True, slots=True, kw_only=True)
class Audit:
    """An audit that has ended, and between whom, by address."""

    auditor: str
    auditee: str
    refusal: str  # why no token was issued, in words; "" if one was


@dataclass(frozen=True, slots=True)
class AttackChoice:
    """An attack that an operator can have a robot run: its name, and what it does."""

    name: str
    does: str


@runtime_checkable
class AuditedSwarm(RouteLimited, Protocol):
    """A swarm whose robots audit each other; their orders are logged, and sent by radio."""

    def shields(self) -> Sequence[Shield]:
        """Return one for every robot."""

    def new_audits(self) -> Sequence[Audit]:
        """Return those that ended since the last call, oldest first."""

    def attacks(self) -> Sequence[AttackChoice]:
        """Return what a robot can be made to do."""

    def compromise(self, address: str, attack: str) -> None:
        """Have the robot lie from now on.

        Raises: Unknown: no such robot, or no such attack; or it is compromised or stopped already.
        """


@runtime_checkable
class Revivable(AuditedSwarm, Protocol):
    """A simulated swarm, in which a stopped robot can begin anew with its honest controller."""

    def revive(self, address: str) -> None:
        """Have it begin anew in a moment.

        Raises: Unknown: no such robot, or it is not stopped.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """The results of a swarm's work lately."""

    name: str  # of the work
    score: float | None  # None while there was nothing to count
    counts: str  # what the score counts, and its unit: "% watched"
    lately_s: float  # so far back it counts


@runtime_checkable
class WorkingSwarm(Swarm, Protocol):
    """A swarm that may have work of its own, which it does while nobody drives it."""

    def done(self) -> Done | None:
        """Return its results; called about once a second, None where robots wait for people."""

    def things(self) -> Sequence[Point]:
        """Return the places of the things that the work is about, those in the area."""
