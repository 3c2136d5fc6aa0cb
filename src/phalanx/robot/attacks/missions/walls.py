"""What is done to the building: codes that are moved, and copies of codes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

from phalanx.mission.landmarks import FloorPlan, WallCode

from .between import Between


def aside(code: WallCode, ahead_m: float, side_m: float) -> WallCode:
    """The code, hung so far off its wall and so far along it, and read from the same direction."""
    cosine, sine = math.cos(code.facing_rad), math.sin(code.facing_rad)
    return replace(
        code,
        x_m=code.x_m + ahead_m * cosine - side_m * sine,
        y_m=code.y_m + ahead_m * sine + side_m * cosine,
    )


class MoveCode(Between):
    """A code is taken down and hung up elsewhere, in the robot's way."""

    AHEAD_M: ClassVar[float] = 5.0

    def building(self, plan: FloorPlan) -> FloorPlan:
        """With the code moved."""
        return replace(plan, codes=tuple(aside(code, self.AHEAD_M, 0.0) for code in plan.codes))


class CloneCode(MoveCode):
    """A copy of a code hangs in the robot's way, and the code where it belongs."""

    def building(self, plan: FloorPlan) -> FloorPlan:
        """With the copies."""
        return replace(plan, codes=(*plan.codes, *super().building(plan).codes))


class NudgeCode(Between):
    """A code is moved by less than a robot searches: it decodes, and the fix is as wrong as the code."""

    SIDE_M: ClassVar[float] = 0.4

    def building(self, plan: FloorPlan) -> FloorPlan:
        """With the code aside."""
        return replace(plan, codes=tuple(aside(code, 0.0, self.SIDE_M) for code in plan.codes))
