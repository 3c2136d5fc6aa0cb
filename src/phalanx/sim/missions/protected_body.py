"""The body of a mission robot that is audited: wheels in a building, and the sensors whose readings are chained."""

from __future__ import annotations

import numpy as np

from phalanx.mission.landmarks import FloorPlan
from phalanx.robot.controllers.mission.readings import Sensors
from phalanx.sim.building.diffdrive import DiffDrive
from phalanx.sim.building.lidar import Lidar
from phalanx.sim.building.odometry import Odometry, OdometryNoise, Pose
from phalanx.wire.table import DRIVE, KIND_ACTION, KIND_DRIVE

STEP_S = 0.05  # walls are looked at so often
MILLI = 1000


class MissionBody:
    """One robot's wheels, odometry and lidar, and what it has been told to do.

    Args:
        rob_id: 1..65535.
        plan: the building.
        sensors: how it sees.
        start: x, y and heading, map frame.
        noise: of its odometry.
        seed: with the id, of all that is drawn.
    """

    def __init__(
        self, rob_id: int, plan: FloorPlan, sensors: Sensors, start: Pose, noise: OdometryNoise, seed: int
    ) -> None:
        self.rob_id, self.sensors = rob_id, sensors
        self.wheels = DiffDrive(plan, start)
        self.actions: list[bytes] = []
        # In its own frame, and never corrected: what it has been told about its place is the controller's affair.
        self._odometry = Odometry((0.0, 0.0, 0.0), noise, np.random.default_rng([seed, rob_id, 1]))
        self._random = np.random.default_rng([seed, rob_id, 0])
        self._lidar = Lidar(plan.walls, sensors.lidar)
        self._left_mps = self._right_mps = 0.0
        self._now_s = 0.0

    def advance(self, now_s: float) -> None:
        """The body is where its last command has brought it by now."""
        while self._now_s < now_s:
            dt_s = min(STEP_S, now_s - self._now_s)
            self._odometry.step(*self.wheels.step(self._left_mps, self._right_mps, dt_s))
            self._now_s = now_s if dt_s < STEP_S else self._now_s + dt_s

    def sense(self, t_ms: int) -> tuple[bytes, bytes]:
        """(what the s-node chains, the scan whose hash is in it).

        Args:
            t_ms: of the s-node's clock.
        """
        raw = self.sensors.raw_of(self._lidar.sweep(self.wheels.pose, self._random))
        odometry = self._odometry
        return self.sensors.make(self.rob_id, t_ms, odometry.pose, odometry.travelled_m, raw), raw

    def obey(self, command: bytes) -> None:
        """The actuators do what a command says; what is no command of theirs does nothing."""
        if len(command) == DRIVE.size and command[0] == KIND_DRIVE:
            *_, speed, turn = DRIVE.form.unpack(command)
            self._left_mps, self._right_mps = self.wheels.wheels(speed / MILLI, turn / MILLI)
        elif command[:1] == bytes([KIND_ACTION]):
            self.actions.append(command)

    def halt(self) -> None:
        """It stands where it is, for good. Source: RoboRebound §3.1 (Safe Mode)."""
        self._left_mps = self._right_mps = 0.0
