"""A robot on two wheels in a building: speeds in, the pose a moment later out; and its odometry.

Odometry counts the true motion times a factor that is wrong in one of three ways. The paper gives two standard
deviations and not what they are of; each figure says which model it uses (docs/adr/0019).
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
    """Source of an odometry factor."""

    STAGE = "stage"  # drawn once from ± sigma / 2, as the simulator Stage does with odom_error
    FIXED = "fixed"  # always 1 + sigma
    STEP = "step"  # drawn anew at every step from N(1, sigma)


@dataclass(frozen=True, slots=True)
class OdometryNoise:
    """How wrong odometry is.

    Raises: UsageError: a sigma is negative or above 1. Source: Encoded graphs §VI-B, Fig. 8.
    """

    sigma_t: float = within(0.03, 0, 1)  # for the way; (0.03, 0.05) is the paper's, and others
    sigma_r: float = within(0.05, 0, 1)  # for turns
    model: NoiseModel = NoiseModel.STAGE

    def __post_init__(self) -> None:
        check_limits(self)

    @property
    def always(self) -> tuple[float, float]:
        """Shares of the way and of turns that it may leave out, or count too much, all day long."""
        part = {NoiseModel.STAGE: 0.5, NoiseModel.FIXED: 1.0, NoiseModel.STEP: 0.0}[self.model]
        return part * self.sigma_t, part * self.sigma_r

    @classmethod
    def parse(cls, text: str) -> OdometryNoise:
        """The noise that a command line asks for: SIGMA_T,SIGMA_R[,stage|fixed|step].

        Raises: UsageError: it is not written so.
        """
        parts = text.split(",")
        try:
            way, turn = float(parts[0]), float(parts[1])
            model = NoiseModel(parts[2]) if len(parts) > 2 else NoiseModel.STAGE
        except (ValueError, IndexError) as error:
            near = did_you_mean("".join(parts[2:3]), NoiseModel)
            hint = f"{near}like 0.03,0.05 or 0.03,0.05,fixed ({', '.join(NoiseModel)})"
            raise UsageError(f"odometry noise {text!r}", hint) from error
        if len(parts) > 3:
            raise UsageError(f"odometry noise {text!r}", "like 0.03,0.05,stage")
        return cls(way, turn, model)


class Odometry:
    """One robot's estimate of its pose, from its wheels alone; `factors` multiply ways and turns, true ones are 1."""

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
        """Return whether its factors are others at every step."""
        return self._noise.model is NoiseModel.STEP

    def draw(self) -> None:
        """Its factors are those of the next step."""
        if self.draws:
            self.factors = self._drawn(self._random.standard_normal(), self._random.standard_normal())

    def step(self, way_m: float, turn_rad: float) -> Pose:
        """Adds a true motion along an arc; returns the estimated pose."""
        self.draw()
        told = counted(self.pose, self.travelled_m, (float(way_m), float(turn_rad)), self.factors)
        self.pose, self.travelled_m = told
        return self.pose

    def correct(self, pose: Pose) -> None:
        """Goes on from a pose that is known better."""
        self.pose = pose


@kernel
def counted(
    pose: Pose, travelled_m: float, motion: tuple[float, float], factors: tuple[float, float]
) -> tuple[Pose, float]:
    """(pose, way travelled) by odometry after a true motion: a way and a turn."""
    way, turn = motion[0] * factors[0], motion[1] * factors[1]
    return along_arc(pose, way, turn), travelled_m + abs(way)


@kernel
def along_arc(pose: Pose, way_m: float, turn_rad: float) -> Pose:
    """The pose after a way along an arc that turns by so much in all; the heading within ±pi."""
    x, y, heading = pose
    half = 0.5 * turn_rad
    chord = way_m * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    return x + chord * math.cos(heading + half), y + chord * math.sin(heading + half), wrap(heading + turn_rad)


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
    """A robot that drives in a floor plan, from a pose: x, y, heading, map frame.

    `left` and `right` are the shares of a wheel's turn that move it: 1 is a sound wheel, less one that slips.
    """

    def __init__(self, plan: FloorPlan, pose: Pose, config: DiffDriveConfig | None = None) -> None:
        self.config = config or DiffDriveConfig()
        self.pose = pose
        self.left = self.right = 1.0
        self._plan = plan

    @property
    def body(self) -> Body:
        """Return the parameters that kernels take."""
        config = self.config
        sizes = float(config.radius_m), float(config.axle_m), float(config.wheel_max_mps)
        return Body(*sizes, float(self.left), float(self.right))

    def wheels(self, speed_mps: float, turn_radps: float) -> tuple[float, float]:
        """(left, right) wheel speeds for a speed and a turn; both slowed alike where one would be too fast."""
        return wheels_of(float(speed_mps), float(turn_radps), self.body)

    def step(self, left_mps: float, right_mps: float, dt_s: float) -> tuple[float, float]:
        """Drive for a moment; a wall in the way stops it there, still turning. Return (way, turn) of the wheels."""
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
