"""The parts of a robots' protocol, which its file in protocols/ declares: there is no other list of them.

These are the uses beside flocking that RoboRebound names (§2.1, §2.3). They run in plain Python, and auditors replay
them like a researcher's own controller. Each has its part of the world: what sensors see there, and what counts.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from phalanx.config.flock import Box

if TYPE_CHECKING:  # whoever asks for names loads nothing else
    from phalanx.arrays import Params

    from .python_controller import Controller

Point = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Task that a mission gives to all its robots, in the words of a scenario."""

    starts_m: tuple[Point, ...]  # N, of robots 1 to N
    step_m: float  # between two robots of the grid; what a protocol measures is so much of it
    boxes: tuple[Box, ...]  # what nobody drives through
    seed: int  # of what the world does
    control_ms: int  # a control step
    state_every: int  # control steps from one broadcast to the next
    doubt_ms: int  # who lied is silent so long after, at the latest
    origin_m: Point = (0.0, 0.0)  # where the first place is
    wheels: Params | None = None  # of robots on wheels, who obey orders too: what `wheels` are given; else point masses
    posts_m: tuple[Point, ...] = ()  # where each waits; () for where it starts
    keeps_apart: bool = False  # readings end with who is nearby (keep_apart.py): robots on wheels then avoid each other

    @property
    def waits_m(self) -> tuple[Point, ...]:
        """N, where each robot waits for something to do."""
        return self.posts_m or self.starts_m


class Stage(ABC):
    """World of a protocol beside its robots, and its score so far.

    Class attributes:
        counts: what `score` counts, and its unit.
        lost: what it is to others when there is less of it, for people.
        bites_from: from so much less on, an attack bites.
        shared: whether it is one for all, not each robot's own work: then a compromised robot's share is lost too.
        seen_bytes: of what `look` returns.
    """

    counts: ClassVar[str]
    lost: ClassVar[str]
    bites_from: ClassVar[float]
    shared: ClassVar[bool] = True
    seen_bytes: ClassVar[int] = 0

    def __init__(self, task: Task) -> None:
        self.task = task
        self.now_s = self.since_s = 0.0  # when it was looked at last, and from when on it counts

    @abstractmethod
    def look(self, rob_id: int, t_s: float, place_m: Point, *, lies: bool) -> bytes:
        """Return what a robot's sensors see there, behind its own motion; one that `lies` does nothing for others."""

    def lost_beside(self, honest: Stage, liars: Collection[int]) -> float:
        """So much less than in the same run where these were honest."""
        return honest.score(() if self.shared else liars) - self.score(liars)

    def marks(self) -> list[Point]:
        """Places that a picture shows, m: what it is all about."""
        return []

    def things(self, t_s: float) -> dict[int, Point]:  # noqa: ARG002 - most have none
        """By number, where each thing is now that moves by itself, m."""
        return {}

    def forget(self, before_s: float) -> None:
        """Reset the score, and drop history that would grow: some stages run for days."""
        self.since_s = before_s

    @abstractmethod
    def score(self, left_out: Collection[int]) -> float:
        """Return the score without these robots; more is better."""

    def score_so_far(self, left_out: Collection[int]) -> float | None:
        """The same; None while there was nothing to count."""
        return self.score(left_out)


@dataclass(frozen=True, slots=True)
class Protocol:
    """One protocol: what robots run, and what there is for them to do."""

    controller: Callable[[int, Task], Controller]  # for a robot's id
    stage: type[Stage]

    def maker(self, task: Task) -> Callable[[int], Controller]:
        """Return the function that makes a robot's controller from its id."""
        return lambda rob_id: self.controller(rob_id, task)


def squared_m(one: Point, other: Point) -> float:
    """Return the square of the way from one to the other, m²."""
    return (one[0] - other[0]) * (one[0] - other[0]) + (one[1] - other[1]) * (one[1] - other[1])


def protocols() -> list[str]:
    """Names of the protocols: those of their files."""
    return sorted(file.stem for file in Path(__file__).parent.glob("protocols/[a-z]*.py"))


def find_protocol(name: str) -> Protocol | None:
    """The protocol of that name, if that is one."""
    if name not in protocols():
        return None
    found: Protocol = import_module(f"{__package__}.protocols.{name}").PROTOCOL
    return found
