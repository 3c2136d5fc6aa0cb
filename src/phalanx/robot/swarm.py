"""The interface of swarms, simulated or real, protected or not.

Lengths are in millimetres, x to the right and y down from the area's top left corner. Directions are in whole degrees,
0 along +y and clockwise on the screen (docs/spec/vocabulary.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable


@dataclass(frozen=True, slots=True)
class Point:
    """Point in the area, mm."""

    x_mm: float
    y_mm: float


@dataclass(frozen=True, slots=True)
class Led:
    """Colour of an LED, 0..255 each."""

    red: int
    green: int
    blue: int


class Robot(NamedTuple):
    """Snapshot of one robot."""

    address: str  # 16 upper-case hexadecimal digits
    name: str  # short, for display
    at: Point
    direction_deg: int  # whole degrees
    battery_v: float  # 0 if the robot does not report it
    led: Led
    route: tuple[Point, ...]  # the robot's position when the route was set, then its points; () without a route
    threshold_mm: float  # distance at which a point counts as reached
    heard_at_s: float  # time of its last message, seconds since 1970
    history: Sequence[Point]  # past positions, oldest first


class Swarm(Protocol):
    """Robots that can be observed and commanded.

    Every method that takes an address raises `phalanx.errors.Unknown` if there is no such robot. The gateway calls the
    methods from its event loop: they must not block. Other exceptions are logged; a failed stop is retried.

    `stop`, `hold` and `release` are called from another thread, even while another method runs or hangs, and must not
    wait for it.
    """

    @property
    def area_mm(self) -> tuple[int, int]:
        """Return width and height of the area."""

    def robots(self) -> Sequence[Robot]:
        """Return all robots that are present now."""

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:
        """Turn a robot's wheels, -100..100, until the next command, and end its route."""

    def stop(self, address: str) -> None:
        """Stop a robot and end its route, until the next command."""

    def hold(self) -> None:
        """Stop all robots, also those that appear later, and ignore commands until `release`: an emergency stop.

        The gateway calls this ten times per second until `release`, because messages to robots may be lost.
        """

    def release(self) -> None:
        """Let robots obey commands to move again; those on a mission continue it."""

    def set_led(self, address: str, led: Led) -> None:
        """Set the colour of a robot's LED."""

    def follow(self, address: str, route: Sequence[Point], threshold_mm: float) -> None:
        """Let a robot visit these points in order; an empty route stops it."""

    def clear_history(self, address: str) -> None:
        """Clear a robot's past positions."""


@runtime_checkable
class RouteLimited(Swarm, Protocol):
    """A swarm whose robots accept only short routes."""

    @property
    def longest_route(self) -> int:
        """Return the largest number of points of a route."""


@runtime_checkable
class SteppedSwarm(Swarm, Protocol):
    """A simulated swarm whose time the caller advances."""

    def step(self, dt_s: float) -> None:
        """Advance the simulation by `dt_s` seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shield:
    """Protection status of one robot: its tokens, and whether it is in Safe Mode."""

    address: str
    needed: int  # f_max + 1, fresh tokens that keep it out of Safe Mode
    full_s: float  # T_val, the lifetime of a token
    vouchers: tuple[tuple[str, float], ...]  # addresses of its tokens' auditors, and remaining seconds, longest first
    safe_mode: bool  # whether its a-node has stopped it
    attack: str  # name of the attack that the operator started on it; "" for none. Never sent to visitors


@dataclass(frozen=True, slots=True, kw_only=True)
class Audit:
    """An audit that has ended, with the addresses of auditor and auditee."""

    auditor: str
    auditee: str
    refusal: str  # why no token was issued, for display; "" if one was


@dataclass(frozen=True, slots=True)
class AttackChoice:
    """An attack that an operator can start on a robot: its name and its description."""

    name: str
    does: str


@runtime_checkable
class AuditedSwarm(RouteLimited, Protocol):
    """A swarm whose robots audit each other; they log their orders, which are sent by radio."""

    def shields(self) -> Sequence[Shield]:
        """Return the protection status of every robot."""

    def new_audits(self) -> Sequence[Audit]:
        """Return the audits that ended since the last call, oldest first."""

    def attacks(self) -> Sequence[AttackChoice]:
        """Return the attacks that `compromise` can start."""

    def compromise(self, address: str, attack: str) -> None:
        """Start an attack on a robot.

        Raises: Unknown: no such robot or attack, or the robot is already compromised or stopped.
        """


@runtime_checkable
class Revivable(AuditedSwarm, Protocol):
    """A simulated swarm in which a stopped robot can be restarted with its honest controller."""

    def revive(self, address: str) -> None:
        """Restart a stopped robot shortly.

        Raises: Unknown: no such robot, or the robot is not stopped.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """Recent results of a swarm's task."""

    name: str  # of the task
    score: float | None  # None if there was nothing to count yet
    counts: str  # unit of the score, like "% watched"
    lately_s: float  # length of the period that the score covers


@runtime_checkable
class WorkingSwarm(Swarm, Protocol):
    """A swarm whose robots may have a task, which they do while no visitor drives them."""

    def done(self) -> Done | None:
        """Return the results of the task; None without a task. Called about once per second."""

    def things(self) -> Sequence[Point]:
        """Return the positions of the task's moving objects in the area, like targets or intruders."""
