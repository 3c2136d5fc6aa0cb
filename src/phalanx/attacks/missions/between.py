"""An attack on a mission: somebody between the operator, or the world, and a robot that is honest itself.

An attack overrides what it lies about: what is delivered, the building, a scan, the wheels, messages. The rest goes
through as it is. It is told what the adversary has and wants (`MissionPlan`), and nothing that only the robot knows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from phalanx.mission import Mission
from phalanx.mission.landmarks import FloorPlan, LaserScan, WallCode
from phalanx.robot.adversary.attack import Scene

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
    """The adversary's means and goals."""

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
        """Return whether it lies at this moment."""
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


class SpoofScan(Between):
    """Scans recorded one room on: a door is in sight there too, but elsewhere than the one that is due."""

    THERE_M: ClassVar[tuple[float, float]] = (5.0, 0.5)

    def scan(self, pose: Pose, look: Look) -> LaserScan:
        if not self.lies:
            return look(pose)
        return look((pose[0] + self.THERE_M[0], pose[1] + self.THERE_M[1], pose[2]))


class DragScan(Between):
    """The whole building, true in itself, slides away: a little with every metre, as odometry would drift."""

    DRAG_MPS: ClassVar[float] = 0.05

    def scan(self, pose: Pose, look: Look) -> LaserScan:
        aside_m = self.DRAG_MPS * max(0.0, self.now_s - self.plan.start_s)
        return look((pose[0], pose[1] + aside_m, pose[2]))


class FreezeScan(Between):
    """A fault: the lidar repeats its last scan for ever."""

    starts_s = 4.0

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._stuck: LaserScan | None = None

    def scan(self, pose: Pose, look: Look) -> LaserScan:
        if not self.lies:
            return look(pose)
        self._stuck = self._stuck or look(pose)
        return self._stuck


class MoveCode(Between):
    """A code is taken down and hung up elsewhere, in the robot's way."""

    AHEAD_M: ClassVar[float] = 5.0
    SIDE_M: ClassVar[float] = 0.0

    def building(self, plan: FloorPlan) -> FloorPlan:
        return replace(plan, codes=tuple(aside(code, self.AHEAD_M, self.SIDE_M) for code in plan.codes))


class CloneCode(MoveCode):
    """A copy of a code hangs in the robot's way, and the code where it belongs."""

    def building(self, plan: FloorPlan) -> FloorPlan:
        return replace(plan, codes=(*plan.codes, *super().building(plan).codes))


class NudgeCode(MoveCode):
    """A code is moved by less than a robot searches: it decodes, and the fix is as wrong as the code."""

    AHEAD_M = 0.0
    SIDE_M = 0.4


def aside(code: WallCode, ahead_m: float, side_m: float) -> WallCode:
    """Return the code, hung so far off its wall and so far along it, and read from the same direction."""
    cosine, sine = math.cos(code.facing_rad), math.sin(code.facing_rad)
    return replace(
        code,
        x_m=code.x_m + ahead_m * cosine - side_m * sine,
        y_m=code.y_m + ahead_m * sine + side_m * cosine,
    )


class StaleMessage(Between):
    """The release of yesterday, sent today, when the goods are not released."""

    released = False

    def messages(self, messages: tuple[bytes, ...]) -> tuple[bytes, ...]:
        return (*messages, *self.plan.yesterday.said) if self.lies else messages


class DrownMessage(Between):
    """So many messages that the robot has forgotten the true one when it needs it."""

    def messages(self, messages: tuple[bytes, ...]) -> tuple[bytes, ...]:
        return (*messages, self.plan.chance.bytes(32)) if self.lies else messages


class DeadWheel(Between):
    """One wheel turns in the air: odometry says straight on, and the robot goes round in circles."""

    SHARES: ClassVar[tuple[float, float]] = (0.0, 1.0)  # of each wheel's turn, left and right, that moves the robot

    def wheels(self) -> tuple[float, float]:
        return self.SHARES if self.lies else (1.0, 1.0)


class Slip(DeadWheel):
    """Both wheels slip: the robot goes half as far as it believes."""

    SHARES = (0.5, 0.5)
