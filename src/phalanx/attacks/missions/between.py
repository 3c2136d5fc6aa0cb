"""Attacks on a mission from outside: between the operator, or the world, and an honest robot.

An attack overrides the methods for what it falsifies: delivery, building, scans, wheels or messages. Everything else
passes unchanged. It knows the adversary's means and goals (`MissionPlan`), and nothing that only the robot knows.
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

    plain: Mission  # for a robot without the shield
    file: bytes  # for a robot with the shield, in profile `paper` or `sealed`
    key: bytes  # the start key, which is sent separately
    said: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class MissionPlan:
    """The adversary's means and goals."""

    start_s: float  # beginning of the attack, seconds after the robot's start
    chance: np.random.Generator
    yesterday: Sent  # what the operator sent to this robot a day ago, recorded
    others: Sent  # what the operator sent to another robot today, recorded
    wanted: Mission  # that the adversary wants the robot to carry out
    options: Mapping[str, float | str] = field(default_factory=dict)


class Between:
    """Base of attacks on a mission: passes everything unchanged.

    Class attributes:
        ordered: whether the operator has ordered a mission at that time.
        released: whether the controller sends its messages.
        again: whether the robot has started the delivered mission before.
        clock_s: error of the robot's clock, s.
        starts_s: default beginning of the attack, s.
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
        """Return whether the attack is active now."""
        return self.now_s >= self.plan.start_s

    def deliver(self, sent: Sent) -> Sent:
        """Return the mission that arrives at the robot."""
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
        """Return the messages that the robot receives of those sent now."""
        return messages


class SpoofScan(Between):
    """Show the lidar another room, where a door is visible at another place than the expected one."""

    THERE_M: ClassVar[tuple[float, float]] = (5.0, 0.5)

    def scan(self, pose: Pose, look: Look) -> LaserScan:
        if not self.lies:
            return look(pose)
        return look((pose[0] + self.THERE_M[0], pose[1] + self.THERE_M[1], pose[2]))


class DragScan(Between):
    """Shift the whole building slowly in the scans, as odometry would drift."""

    DRAG_MPS: ClassVar[float] = 0.05

    def scan(self, pose: Pose, look: Look) -> LaserScan:
        aside_m = self.DRAG_MPS * max(0.0, self.now_s - self.plan.start_s)
        return look((pose[0], pose[1] + aside_m, pose[2]))


class FreezeScan(Between):
    """Freeze the lidar at its last scan, a fault."""

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
    """Move a code to another place, in the robot's way."""

    AHEAD_M: ClassVar[float] = 5.0
    SIDE_M: ClassVar[float] = 0.0

    def building(self, plan: FloorPlan) -> FloorPlan:
        return replace(plan, codes=tuple(aside(code, self.AHEAD_M, self.SIDE_M) for code in plan.codes))


class CloneCode(MoveCode):
    """Put a copy of a code in the robot's way, and leave the code in place."""

    def building(self, plan: FloorPlan) -> FloorPlan:
        return replace(plan, codes=(*plan.codes, *super().building(plan).codes))


class NudgeCode(MoveCode):
    """Move a code by less than the search radius: it decodes, and shifts the robot's position fix."""

    AHEAD_M = 0.0
    SIDE_M = 0.4


def aside(code: WallCode, ahead_m: float, side_m: float) -> WallCode:
    """Return the code moved so far off its wall and along it, m, with the same orientation."""
    cosine, sine = math.cos(code.facing_rad), math.sin(code.facing_rad)
    return replace(
        code,
        x_m=code.x_m + ahead_m * cosine - side_m * sine,
        y_m=code.y_m + ahead_m * sine + side_m * cosine,
    )


class StaleMessage(Between):
    """Replay yesterday's release message today, when nothing was released."""

    released = False

    def messages(self, messages: tuple[bytes, ...]) -> tuple[bytes, ...]:
        return (*messages, *self.plan.yesterday.said) if self.lies else messages


class DrownMessage(Between):
    """Send so many messages that the robot drops the valid one before it needs it."""

    def messages(self, messages: tuple[bytes, ...]) -> tuple[bytes, ...]:
        return (*messages, self.plan.chance.bytes(32)) if self.lies else messages


class DeadWheel(Between):
    """Let one wheel spin freely: odometry reports a straight line, and the robot drives in circles."""

    SHARES: ClassVar[tuple[float, float]] = (0.0, 1.0)  # of each wheel's turn, left and right, that moves the robot

    def wheels(self) -> tuple[float, float]:
        return self.SHARES if self.lies else (1.0, 1.0)


class Slip(DeadWheel):
    """Let both wheels slip: the robot goes half as far as odometry reports."""

    SHARES = (0.5, 0.5)
