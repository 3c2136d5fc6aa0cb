"""What is done to the building: codes that are moved, and copies of codes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from phalanx.mission.landmarks import FloorPlan, WallCode
from phalanx.robot.attacks.attack import Defence, Verdict

from .attack import MissionAttack
from .harm import FIX, WRONG


def aside(code: WallCode, ahead_m: float, side_m: float) -> WallCode:
    """The code, hung so far off its wall and so far along it, and read from the same direction."""
    cosine, sine = math.cos(code.facing_rad), math.sin(code.facing_rad)
    return replace(
        code,
        x_m=code.x_m + ahead_m * cosine - side_m * sine,
        y_m=code.y_m + ahead_m * sine + side_m * cosine,
    )


class MoveCode(MissionAttack):
    """A code is taken down and hung up elsewhere, in the robot's way."""

    name = "move-code"
    against = "walls"
    does = "hangs the code of the shelf 5 m before it"
    stopped_by = "the text is public, but hashed together with where it hangs: elsewhere it does not decode"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "bites", "paper": "stopped", "bound": "stopped"}
    harm = WRONG

    AHEAD_M: ClassVar[float] = 5.0

    def building(self, plan: FloorPlan) -> FloorPlan:
        """With the code moved."""
        return replace(plan, codes=tuple(aside(code, self.AHEAD_M, 0.0) for code in plan.codes))


class CloneCode(MoveCode):
    """A copy of a code hangs in the robot's way, and the code where it belongs."""

    name = "clone-code"
    does = "hangs a copy of the code of the shelf 5 m before it"
    stopped_by = "the copy does not decode where it hangs; the robot goes on to the code itself"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "bites", "paper": "harmless", "bound": "harmless"}

    def building(self, plan: FloorPlan) -> FloorPlan:
        """With the copies."""
        return replace(plan, codes=(*plan.codes, *super().building(plan).codes))


class NudgeCode(MissionAttack):
    """A code is moved by less than a robot searches: it decodes, and the fix is as wrong as the code."""

    name = "nudge-code"
    against = "walls"
    does = "hangs the code of the shelf 0.4 m aside"
    stopped_by = "nothing; the search limits it: what hangs farther off than it reaches does not decode"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "harmless", "paper": "limited", "bound": "limited"}
    harm = FIX
    bites_from = 0.3
    limit = 0.75  # half a metre on each axis, and a cell's corner

    SIDE_M: ClassVar[float] = 0.4

    def building(self, plan: FloorPlan) -> FloorPlan:
        """With the code aside."""
        return replace(plan, codes=tuple(aside(code, 0.0, self.SIDE_M) for code in plan.codes))
