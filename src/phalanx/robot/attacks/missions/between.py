"""An attack on a mission: somebody between the operator, or the world, and a robot that is honest itself.

An attack overrides what it lies about: what is delivered, the building, a scan, the wheels, messages. The rest goes
through as it is. It is told what the adversary has and wants (`MissionPlan`), and nothing that only the robot knows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from phalanx.mission import Mission
from phalanx.mission.landmarks import FloorPlan, LaserScan
from phalanx.robot.attacks.attack import Scene

Pose = tuple[float, float, float]
Look = Callable[[Pose], LaserScan]


@dataclass(frozen=True, slots=True)
class Sent:
    """A mission on its way to a robot."""

    plain: Mission  # what a robot without the shield gets
    file: bytes  # what one with it gets; the paper's or ours
    key: bytes  # the start key's bytes, which travel apart
    said: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class MissionPlan:
    """What the adversary has and wants."""

    start_s: float  # from when on it lies, seconds from the robot's start
    chance: np.random.Generator
    yesterday: Sent  # what the operator sent to this robot a day ago, recorded
    others: Sent  # what the operator sent to another robot today, recorded
    wanted: Mission  # what the adversary would have the robot do
    options: Mapping[str, float | str] = field(default_factory=dict)


class Between:
    """One way to attack a mission.

    Class attributes:
        ordered: whether the operator wants anything done at all while it goes on.
        released: whether the controller sends its messages.
        again: whether the robot has started what it gets before.
        clock_s: by so much the robot's clock is wrong.
        starts_s: when it begins to lie, unless it is told otherwise.
    """

    scene: ClassVar[Scene] = "errand"
    ordered: ClassVar[bool] = True
    released: ClassVar[bool] = True
    again: ClassVar[bool] = False
    clock_s: ClassVar[float] = 0.0
    starts_s: ClassVar[float] = 0.0

    def __init__(self, plan: MissionPlan) -> None:
        self.plan = plan
        self.now_s = 0.0

    @property
    def lies(self) -> bool:
        """Whether it lies at this moment."""
        return self.now_s >= self.plan.start_s

    def deliver(self, sent: Sent) -> Sent:
        """Return what arrives of what the operator sent."""
        return sent

    def building(self, plan: FloorPlan) -> FloorPlan:
        """Return the building that the robot is in."""
        return plan

    def scan(self, pose: Pose, look: Look) -> LaserScan:
        """Return the scan of the lidar."""
        return look(pose)

    def wheels(self) -> tuple[float, float]:
        """Return the share of each wheel's turn, left and right, that moves the robot."""
        return 1.0, 1.0

    def messages(self, messages: tuple[bytes, ...]) -> tuple[bytes, ...]:
        """Return what the robot hears of what was sent in this moment."""
        return messages
