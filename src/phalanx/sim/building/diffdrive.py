"""A robot on two wheels in a building: speeds in, the pose a moment later out; walls stop it, faults bend its way."""

from __future__ import annotations

from dataclasses import dataclass

from phalanx.config.parameter import check_limits, within
from phalanx.mission.landmarks import FloorPlan
from phalanx.sim.drive import turned

from .odometry import Pose, along_arc


@dataclass(frozen=True, slots=True, kw_only=True)
class DiffDriveConfig:
    """A robot's body.

    Raises: UsageError: a value is out of range.
    Source: Encoded graphs §V-A (the radius); TurtleBot 3 Burger (the rest, but faster).
    """

    radius_m: float = within(0.175, 0.001, 5)  # of the round body; the paper's robot is 0.35 m wide
    axle_m: float = within(0.16, 0.001, 10)
    wheel_max_mps: float = within(1.0, 0.001, 100)

    def __post_init__(self) -> None:
        check_limits(self)


class DiffDrive:
    """A robot that drives in a floor plan.

    Args:
        pose: x, y in metres and heading in radians, map frame.
        left, right: share of a wheel's turn that moves the robot; 1 is a sound wheel, less one that slips or is broken.
    """

    def __init__(self, plan: FloorPlan, pose: Pose, config: DiffDriveConfig | None = None) -> None:
        self.config = config or DiffDriveConfig()
        self.pose = pose
        self.left = self.right = 1.0
        self._plan = plan

    def wheels(self, speed_mps: float, turn_radps: float) -> tuple[float, float]:
        """(left, right) wheel speeds for a speed and a turn; both slowed alike where one would be too fast."""
        half = 0.5 * self.config.axle_m * turn_radps
        left, right = speed_mps - half, speed_mps + half
        too_fast = max(abs(left), abs(right)) / self.config.wheel_max_mps
        return (left / too_fast, right / too_fast) if too_fast > 1.0 else (left, right)

    def step(self, left_mps: float, right_mps: float, dt_s: float) -> tuple[float, float]:
        """Drives for a moment; a wall in the way stops it there, still turning.

        Returns: (way, turn) by which the wheels turned: what odometry measures, whether or not the robot moved so.
        """
        top = self.config.wheel_max_mps
        left, right = max(-top, min(top, left_mps)), max(-top, min(top, right_mps))
        # Headings are counted the other way round, to the left.
        way, turn = turned(left, right, -self.config.axle_m, dt_s)
        after = along_arc(self.pose, *turned(left * self.left, right * self.right, -self.config.axle_m, dt_s))
        room = self._plan.clearance_m(after[0], after[1])
        if room < self.config.radius_m and room < self._plan.clearance_m(self.pose[0], self.pose[1]):
            after = (self.pose[0], self.pose[1], after[2])
        self.pose = after
        return way, turn
