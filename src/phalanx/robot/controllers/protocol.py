"""Base classes of multi-robot protocols, each of which is declared in its file in protocols/.

They are the applications beside flocking that RoboRebound names (§2.1, §2.3). They run in plain Python, and auditors
replay them like users' controllers. Each has a stage, which simulates what its sensors see and keeps the score.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from phalanx.config.flock import Box

if TYPE_CHECKING:  # keeps listing the names fast
    from phalanx.arrays import Params

    from .python_controller import Controller

Point = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Parameters of a protocol, the same for all robots of a scenario."""

    starts_m: tuple[Point, ...]  # N start positions, of robots 1 to N
    step_m: float  # spacing of the robots' grid, the protocol's unit of length
    boxes: tuple[Box, ...]  # obstacles
    seed: int  # random seed of the stage
    control_ms: int  # control period
    state_every: int  # control steps per state broadcast
    doubt_ms: int  # longest time from a robot's lie to its Safe Mode
    origin_m: Point = (0.0, 0.0)  # position of the first place
    wheels: Params | None = None  # parameters of the controller `wheels` for robots that obey orders; else point masses
    posts_m: tuple[Point, ...] = ()  # waiting position of each robot; () for its start
    keeps_apart: bool = False  # robots on wheels avoid each other: readings end with robots nearby (keep_apart.py)

    @property
    def waits_m(self) -> tuple[Point, ...]:
        """Return the N positions at which robots wait for work."""
        return self.posts_m or self.starts_m


class Stage(ABC):
    """Simulated environment of a protocol, and its score.

    Class attributes:
        counts: unit of `score`, like "% watched".
        lost: description of a decrease of the score, for display.
        bites_from: decrease of the score from which an attack counts as "bites".
        shared: whether all robots share the work; then the share of a compromised robot counts as lost too.
        seen_bytes: number of bytes that `look` returns.
    """

    counts: ClassVar[str]
    lost: ClassVar[str]
    bites_from: ClassVar[float]
    shared: ClassVar[bool] = True
    seen_bytes: ClassVar[int] = 0

    def __init__(self, task: Task) -> None:
        self.task = task
        self.now_s = self.since_s = 0.0  # time of the last `look`, and start of the score

    @abstractmethod
    def look(self, rob_id: int, t_s: float, place_m: Point, *, lies: bool) -> bytes:
        """Return the protocol's part of a robot's reading; the work of a robot that `lies` does not count."""

    def lost_beside(self, honest: Stage, liars: Collection[int]) -> float:
        """Return the score lost, compared with the same run in which `liars` were honest."""
        return honest.score(() if self.shared else liars) - self.score(liars)

    def marks(self) -> list[Point]:
        """Return fixed positions to draw, m."""
        return []

    def things(self, t_s: float) -> dict[int, Point]:  # noqa: ARG002 - most have none
        """Return the positions of moving objects by number, m."""
        return {}

    def forget(self, before_s: float) -> None:
        """Reset the score, and drop history that would grow: some stages run for days."""
        self.since_s = before_s

    @abstractmethod
    def score(self, left_out: Collection[int]) -> float:
        """Return the score without these robots; more is better."""

    def score_so_far(self, left_out: Collection[int]) -> float | None:
        """Return the score; None if there was nothing to count yet."""
        return self.score(left_out)


@dataclass(frozen=True, slots=True)
class Protocol:
    """A protocol: the controller of its robots, and its stage."""

    controller: Callable[[int, Task], Controller]  # for a robot's id
    stage: type[Stage]

    def maker(self, task: Task) -> Callable[[int], Controller]:
        """Return a function that makes a robot's controller from its id."""
        return lambda rob_id: self.controller(rob_id, task)


def squared_m(one: Point, other: Point) -> float:
    """Return the squared distance of two points, m²."""
    return (one[0] - other[0]) * (one[0] - other[0]) + (one[1] - other[1]) * (one[1] - other[1])


def protocols() -> list[str]:
    """Return the names of the protocols, which are those of their files."""
    return sorted(file.stem for file in Path(__file__).parent.glob("protocols/[a-z]*.py"))


def find_protocol(name: str) -> Protocol | None:
    """Return the protocol of this name; None if there is none."""
    if name not in protocols():
        return None
    found: Protocol = import_module(f"{__package__}.protocols.{name}").PROTOCOL
    return found
