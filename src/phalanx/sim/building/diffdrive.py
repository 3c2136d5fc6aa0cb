"""A robot on two wheels in a building: speeds in, the pose a moment later out; walls stop it, faults bend its way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from phalanx.arrays import F64x2
from phalanx.config.parameter import check_limits, within
from phalanx.kernel import kernel
from phalanx.mission.landmarks import FloorPlan
from phalanx.mission.landmarks.floorplan import clearance
from phalanx.sim.drive import turned_kernel

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


class Body(NamedTuple):
    """A robot's body as kernels take it: its configuration, and the shares of its wheels."""

    radius_m: float
    axle_m: float
    wheel_max_mps: float
    left: float
    right: float


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

    @property
    def body(self) -> Body:
        """What kernels take of it."""
        config = self.config
        sizes = float(config.radius_m), float(config.axle_m), float(config.wheel_max_mps)
        return Body(*sizes, float(self.left), float(self.right))

    def wheels(self, speed_mps: float, turn_radps: float) -> tuple[float, float]:
        """(left, right) wheel speeds for a speed and a turn; both slowed alike where one would be too fast."""
        return wheels_of(float(speed_mps), float(turn_radps), self.body)

    def step(self, left_mps: float, right_mps: float, dt_s: float) -> tuple[float, float]:
        """Drives for a moment; a wall in the way stops it there, still turning.

        Returns: (way, turn) by which the wheels turned: what odometry measures, whether or not the robot moved so.
        """
        speeds = float(left_mps), float(right_mps)
        self.pose, motion = stepped(self.pose, speeds, float(dt_s), self.body, self._plan.walls)
        return motion


@kernel
def wheels_of(speed_mps: float, turn_radps: float, body: Body) -> tuple[float, float]:
    """As `DiffDrive.wheels`."""
    half = 0.5 * body.axle_m * turn_radps
    left, right = speed_mps - half, speed_mps + half
    too_fast = max(abs(left), abs(right)) / body.wheel_max_mps
    return (left / too_fast, right / too_fast) if too_fast > 1.0 else (left, right)


@kernel
def stepped(
    pose: Pose, speeds_mps: tuple[float, float], dt_s: float, body: Body, walls: F64x2
) -> tuple[Pose, tuple[float, float]]:
    """(pose, motion of the wheels) as `DiffDrive.step` has them."""
    top = body.wheel_max_mps
    left, right = max(-top, min(top, speeds_mps[0])), max(-top, min(top, speeds_mps[1]))
    # Headings are counted the other way round, to the left.
    motion = turned_kernel(left, right, -body.axle_m, dt_s)
    way, turn = turned_kernel(left * body.left, right * body.right, -body.axle_m, dt_s)
    after = along_arc(pose, way, turn)
    room = clearance(walls, after[0], after[1])
    if room < body.radius_m and room < clearance(walls, pose[0], pose[1]):
        after = (pose[0], pose[1], after[2])
    return after, motion
