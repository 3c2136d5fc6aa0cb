"""What happens to the body: wheels that turn and do not move the robot as they should. Faults, or somebody's oil."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from phalanx.robot.attacks.attack import Defence, Verdict

from .attack import MissionAttack
from .harm import FALSE


class DeadWheel(MissionAttack):
    """One wheel turns in the air: odometry says straight on, and the robot goes round in circles."""

    name = "dead-wheel"
    against = "body"
    does = "a fault: one wheel turns and does not move the robot, which odometry cannot know"
    stopped_by = "landmarks do not come where odometry says that they should: nothing decodes"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "bites", "paper": "stopped", "bound": "stopped"}
    harm = FALSE

    def wheels(self) -> tuple[float, float]:
        """The left one is dead."""
        return (0.0, 1.0) if self.lies else (1.0, 1.0)


class Slip(MissionAttack):
    """Both wheels slip: the robot goes half as far as it believes."""

    name = "slip"
    against = "body"
    does = "lets both wheels slip: each moves the robot by half of what it turns"
    stopped_by = "as for `dead-wheel`; what slips by less than a tenth is drift, and corrected"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "bites", "paper": "stopped", "bound": "stopped"}
    harm = FALSE

    SHARE: ClassVar[float] = 0.5

    def wheels(self) -> tuple[float, float]:
        """Half of it."""
        return (self.SHARE, self.SHARE) if self.lies else (1.0, 1.0)
