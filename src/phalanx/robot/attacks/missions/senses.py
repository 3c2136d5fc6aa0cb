"""What is done to the lidar: scans of another place, a building that drifts away, a scan that stands still."""

from __future__ import annotations

from typing import Any, ClassVar

from phalanx.mission.landmarks import LaserScan

from .between import Between, Look, Pose


class SpoofScan(Between):
    """Scans recorded one room on: a door is in sight there too, but elsewhere than the one that is due."""

    THERE_M: ClassVar[tuple[float, float]] = (5.0, 0.5)

    def scan(self, pose: Pose, look: Look) -> LaserScan:
        """As if the robot were there."""
        if not self.lies:
            return look(pose)
        return look((pose[0] + self.THERE_M[0], pose[1] + self.THERE_M[1], pose[2]))


class DragScan(Between):
    """The whole building, true in itself, slides away: a little with every metre, as odometry would drift."""

    DRAG_MPS: ClassVar[float] = 0.05

    def scan(self, pose: Pose, look: Look) -> LaserScan:
        """As if the robot were aside."""
        aside_m = self.DRAG_MPS * max(0.0, self.now_s - self.plan.start_s)
        return look((pose[0], pose[1] + aside_m, pose[2]))


class FreezeScan(Between):
    """A fault: the lidar repeats its last scan for ever."""

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
