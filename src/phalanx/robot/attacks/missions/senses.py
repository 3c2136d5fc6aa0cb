"""What is done to the lidar: scans of another place, a building that drifts away, a scan that stands still."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from phalanx.mission.landmarks import LaserScan
from phalanx.robot.attacks.attack import Defence, Verdict

from .attack import Look, MissionAttack, Pose
from .harm import FALSE, FIX

# Who drives by odometry alone is led astray by no landmark, and finds nothing out either.
NOT_COVERED: Mapping[Defence, Verdict] = {"none": "harmless", "paper": "not covered", "bound": "not covered"}


class SpoofScan(MissionAttack):
    """Scans recorded one room on: a door is in sight there too, but elsewhere than the one that is due."""

    name = "spoof-scan"
    against = "sensors"
    does = "shows the lidar another room, in which a door stands elsewhere"
    stopped_by = "what is seen where it should not be does not decode; without a match there is no fix and no way on"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "bites", "paper": "stopped", "bound": "stopped"}
    harm = FALSE

    THERE_M: ClassVar[tuple[float, float]] = (5.0, 0.5)

    def scan(self, pose: Pose, look: Look) -> LaserScan:
        """As if the robot were there."""
        if not self.lies:
            return look(pose)
        return look((pose[0] + self.THERE_M[0], pose[1] + self.THERE_M[1], pose[2]))


class DragScan(MissionAttack):
    """The whole building, true in itself, slides away: a little with every metre, as odometry would drift."""

    name = "drag-scan"
    against = "sensors"
    does = "shows the lidar the true building, which slides aside by 5 cm a second"
    stopped_by = (
        "nothing: who can show a robot's lidar a whole building is believed; all fixes from one node to the next may "
        "move it by no more than it can have drifted there, but from that one on they may again"
    )
    verdicts: ClassVar[Mapping[Defence, Verdict]] = NOT_COVERED
    harm = FIX
    bites_from = 0.5

    DRAG_MPS: ClassVar[float] = 0.05

    def scan(self, pose: Pose, look: Look) -> LaserScan:
        """As if the robot were aside."""
        aside_m = self.DRAG_MPS * max(0.0, self.now_s - self.plan.start_s)
        return look((pose[0], pose[1] + aside_m, pose[2]))


class FreezeScan(MissionAttack):
    """A fault: the lidar repeats its last scan for ever."""

    name = "freeze-scan"
    against = "sensors"
    does = "a fault, no attack: the lidar repeats its last scan"
    stopped_by = (
        "a landmark that stays before the robot says at each step that it has not moved: believed until all those "
        "fixes come to more than it can have drifted; nothing new decodes, and the time-out holds it"
    )
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "harmless", "paper": "limited", "bound": "limited"}
    harm = FIX
    bites_from = 0.3
    limit = 1.0  # what can have drifted: 0.25 m, and a tenth of the 7 m that it can drive until the time-out
    starts_s = 4.0

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._stuck: LaserScan | None = None

    def scan(self, pose: Pose, look: Look) -> LaserScan:
        """The first scan of those from the start on."""
        if not self.lies:
            return look(pose)
        self._stuck = self._stuck or look(pose)
        return self._stuck
