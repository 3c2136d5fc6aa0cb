"""Differential drive in a building: wheel speeds to poses; and the robot's odometry.

Odometry multiplies the true motion by a factor that is wrong in one of three ways. The paper gives two standard
deviations without saying what they scale; each figure states the model that it uses (docs/adr/0019).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from phalanx.arrays import F64x2
from phalanx.config.parameter import check_limits, within
from phalanx.errors import UsageError, did_you_mean
from phalanx.kernel import kernel
from phalanx.mission.angles import wrap
from phalanx.mission.landmarks import FloorPlan
from phalanx.mission.landmarks.floorplan import clearance
from phalanx.world.drive import turned_kernel

Pose = tuple[float, float, float]


class NoiseModel(StrEnum):
    """Model of the odometry factors' error."""

    STAGE = "stage"  # drawn once, uniform in 1 ± sigma / 2, like odom_error in the simulator Stage
    FIXED = "fixed"  # always 1 + sigma
    STEP = "step"  # drawn at every step from N(1, sigma)


@dataclass(frozen=True, slots=True)
class OdometryNoise:
    """Error of the odometry.

    Raises: UsageError: a sigma is negative or above 1. Source: Encoded graphs §VI-B, Fig. 8.
    """

    sigma_t: float = within(0.03, 0, 1)  # for distances; the paper uses (0.03, 0.05), among others
    sigma_r: float = within(0.05, 0, 1)  # for turns
    model: NoiseModel = NoiseModel.STAGE

    def __post_init__(self) -> None:
        check_limits(self)

    @property
    def always(self) -> tuple[float, float]:
        """Largest constant relative errors of distances and turns under this model."""
        part = {NoiseModel.STAGE: 0.5, NoiseModel.FIXED: 1.0, NoiseModel.STEP: 0.0}[self.model]
        return part * self.sigma_t, part * self.sigma_r

    @classmethod
    def parse(cls, text: str) -> OdometryNoise:
        """Parse the form used on the command line: SIGMA_T,SIGMA_R[,stage|fixed|step].

        Raises: UsageError: the text has another form.
        """
        parts = text.split(",")
        try:
            way, turn = float(parts[0]), float(parts[1])
            model = NoiseModel(parts[2]) if len(parts) > 2 else NoiseModel.STAGE
        except (ValueError, IndexError) as error:
            near = did_you_mean("".join(parts[2:3]), NoiseModel)
            hint = f"{near}use a form like 0.03,0.05 or 0.03,0.05,fixed ({', '.join(NoiseModel)})"
            raise UsageError(f"invalid odometry noise {text!r}", hint) from error
        if len(parts) > 3:
            raise UsageError(f"invalid odometry noise {text!r}", "use a form like 0.03,0.05,stage")
        return cls(way, turn, model)


class Odometry:
    """A robot's pose estimate from its wheels alone; `factors` multiply distances and turns, 1 is exact."""

    def __init__(self, start: Pose, noise: OdometryNoise, random: np.random.Generator) -> None:
        self.pose = start
        self.travelled_m = 0.0
        self._noise = noise
        self._random = random
        self.factors = 1.0 + noise.sigma_t, 1.0 + noise.sigma_r
        if noise.model is NoiseModel.STAGE:
            self.factors = self._drawn(random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5))

    def _drawn(self, way: float, turn: float) -> tuple[float, float]:
        return 1.0 + self._noise.sigma_t * way, 1.0 + self._noise.sigma_r * turn

    @property
    def draws(self) -> bool:
        """Return whether the factors change at every step."""
        return self._noise.model is NoiseModel.STEP

    def draw(self) -> None:
        """Draw the factors of the next step, if the model changes them."""
        if self.draws:
            self.factors = self._drawn(self._random.standard_normal(), self._random.standard_normal())

    def step(self, way_m: float, turn_rad: float) -> Pose:
        """Add a true motion along an arc; return the estimated pose."""
        self.draw()
        self.pose, self.travelled_m = odometry_after(
            self.pose, self.travelled_m, (float(way_m), float(turn_rad)), self.factors
        )
        return self.pose

    def correct(self, pose: Pose) -> None:
        """Replace the estimate by a more accurate pose."""
        self.pose = pose


@kernel
def odometry_after(
    pose: Pose, travelled_m: float, motion: tuple[float, float], factors: tuple[float, float]
) -> tuple[Pose, float]:
    """Return the pose and the distance travelled by odometry after a true motion (distance, turn)."""
    way, turn = motion[0] * factors[0], motion[1] * factors[1]
    return along_arc(pose, way, turn), travelled_m + abs(way)


@kernel
def along_arc(pose: Pose, way_m: float, turn_rad: float) -> Pose:
    """Return the pose after a distance along an arc that turns by `turn_rad` in total; the heading is within ±pi."""
    x, y, heading = pose
    half = 0.5 * turn_rad
    chord = way_m * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    return x + chord * math.cos(heading + half), y + chord * math.sin(heading + half), wrap(heading + turn_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class DiffDriveConfig:
    """Dimensions and top speed of a robot.

    Raises: UsageError: a value is out of range.
    Source: Encoded graphs §V-A (the radius); TurtleBot 3 Burger (the rest, but faster).
    """

    radius_m: float = within(0.175, 0.001, 5)  # of the round body; the paper's robot is 0.35 m wide
    axle_m: float = within(0.16, 0.001, 10)
    wheel_max_mps: float = within(1.0, 0.001, 100)

    def __post_init__(self) -> None:
        check_limits(self)


class Body(NamedTuple):
    """Parameters of a robot's body for kernels: its configuration, and the grip of its wheels."""

    radius_m: float
    axle_m: float
    wheel_max_mps: float
    left: float
    right: float


class DiffDrive:
    """Differential-drive robot in a floor plan, at a pose: x, y, heading, map frame.

    `left` and `right` are the grip of each wheel: the share of its rotation that moves the robot, 1 without slip.
    """

    def __init__(self, plan: FloorPlan, pose: Pose, config: DiffDriveConfig | None = None) -> None:
        self.config = config or DiffDriveConfig()
        self.pose = pose
        self.left = self.right = 1.0
        self._plan = plan

    @property
    def body(self) -> Body:
        """Return the parameters for kernels."""
        config = self.config
        sizes = float(config.radius_m), float(config.axle_m), float(config.wheel_max_mps)
        return Body(*sizes, float(self.left), float(self.right))

    def wheels(self, speed_mps: float, turn_radps: float) -> tuple[float, float]:
        """Return (left, right) wheel speeds for a speed and a turn rate; both are scaled down if one is too fast."""
        return wheels_of(float(speed_mps), float(turn_radps), self.body)

    def step(self, left_mps: float, right_mps: float, dt_s: float) -> tuple[float, float]:
        """Drive for `dt_s`; a wall stops the robot but not its turn. Return the wheels' motion (distance, turn)."""
        speeds = float(left_mps), float(right_mps)
        self.pose, motion = driven_step(self.pose, speeds, float(dt_s), self.body, self._plan.walls)
        return motion


@kernel
def wheels_of(speed_mps: float, turn_radps: float, body: Body) -> tuple[float, float]:
    """Return wheel speeds as `DiffDrive.wheels` does."""
    half = 0.5 * body.axle_m * turn_radps
    left, right = speed_mps - half, speed_mps + half
    too_fast = max(abs(left), abs(right)) / body.wheel_max_mps
    return (left / too_fast, right / too_fast) if too_fast > 1.0 else (left, right)


@kernel
def driven_step(
    pose: Pose, speeds_mps: tuple[float, float], dt_s: float, body: Body, walls: F64x2
) -> tuple[Pose, tuple[float, float]]:
    """Return the pose and the wheels' motion as `DiffDrive.step` does."""
    top = body.wheel_max_mps
    left, right = max(-top, min(top, speeds_mps[0])), max(-top, min(top, speeds_mps[1]))
    # Headings increase to the left, turned_kernel's angles to the right.
    motion = turned_kernel(left, right, -body.axle_m, dt_s)
    way, turn = turned_kernel(left * body.left, right * body.right, -body.axle_m, dt_s)
    after = along_arc(pose, way, turn)
    room = clearance(walls, after[0], after[1])
    if room < body.radius_m and room < clearance(walls, pose[0], pose[1]):
        after = (pose[0], pose[1], after[2])
    return after, motion
