"""Simulated body of a robot on a mission: wheels in a building, and sensors."""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import F64x2
from phalanx.config.lidar import LidarConfig
from phalanx.kernel import kernel
from phalanx.mission.file.canonical import parse_action
from phalanx.mission.landmarks import FloorPlan
from phalanx.mission.landmarks.codes import SeenCode
from phalanx.mission.landmarks.lidar import Lidar
from phalanx.mission.refused import MalformedMission
from phalanx.robot.controllers.mission.evidence import Eye, code_entry, reading_entry
from phalanx.robot.controllers.mission.readings import Sensors
from phalanx.wire.table import ACTION, DRIVE, KIND_ACTION, KIND_DRIVE
from phalanx.world.building.camera import Camera
from phalanx.world.building.odometry import (
    Body,
    DiffDrive,
    Odometry,
    OdometryNoise,
    Pose,
    driven_step,
    odometry_after,
    wheels_of,
)
from phalanx.world.building.walkers import Walkers

STEP_S = 0.05  # time step for collisions with walls
PEOPLE_STEP_S = 0.1
SHOWN_S = 10.0  # time for which other robots can see an action
MILLI = 1000


class Building:
    """Building that robots share: walls, codes, people who walk about, and sensor models."""

    def __init__(self, plan: FloorPlan, lidar: LidarConfig | None = None, crowd: Walkers | None = None) -> None:
        self.plan = plan
        self.lidar = Lidar(plan.walls, lidar)
        self.camera = Camera(plan) if plan.codes else None
        # (m, 3) centres and radius of walking people, metres.
        self.people: NDArray[np.float64] = np.zeros((0, 3))
        self._crowd = crowd
        self._steps = 0

    @property
    def eye(self) -> Eye | None:
        """Return the robots' camera model if there are codes to read."""
        return self.camera.eye if self.camera else None

    def advance_people(self, now_s: float) -> None:
        """Advance the walking people to this time."""
        while self._crowd is not None and self._steps * PEOPLE_STEP_S <= now_s:
            self._crowd.step(PEOPLE_STEP_S)
            self.people = self._crowd.discs
            self._steps += 1


class Moment(NamedTuple):
    """Time span of a drive with constant commands."""

    begin_s: float
    end_s: float
    speed_mps: float
    turn_radps: float
    once: bool  # end after one step


@kernel
def _drive(
    at: Pose,
    counts: tuple[Pose, float],
    moment: Moment,
    factors: tuple[float, float],
    body: Body,
    walls: F64x2,
) -> tuple[Pose, tuple[Pose, float], float]:
    """Drive for a time span; return the true pose, the odometry (pose, distance), and the time reached."""
    now_s = moment.begin_s
    moves = moment.speed_mps != 0.0 or moment.turn_radps != 0.0
    while now_s < moment.end_s:
        dt_s = min(STEP_S, moment.end_s - now_s)
        if moves:
            speeds = wheels_of(moment.speed_mps, moment.turn_radps, body)
            at, motion = driven_step(at, speeds, dt_s, body, walls)
            counts = odometry_after(counts[0], counts[1], motion, factors)
        now_s = moment.end_s if dt_s < STEP_S else now_s + dt_s
        if moment.once:
            break
    return at, counts, now_s


class MissionBody:
    """One robot's wheels, odometry, lidar and camera, and its current command.

    Args:
        rob_id: 1..65535, part of its readings.
        start: x, y and heading, map frame.
        picture_every: number of readings per picture of the camera.
    """

    def __init__(
        self,
        rob_id: int,
        building: Building,
        sensors: Sensors,
        start: Pose,
        noise: OdometryNoise,
        seed: tuple[int, ...],
        picture_every: int = 5,
    ) -> None:
        self.rob_id, self.building, self.sensors = rob_id, building, sensors
        self.picture_every = picture_every
        self.wheels = DiffDrive(building.plan, start)
        self.actions: list[bytes] = []
        self._did: dict[str, float] = {}  # by action: time of the last one
        # In its own frame, and never corrected: corrections are up to the controller.
        self.odometry = Odometry((0.0, 0.0, 0.0), noise, np.random.default_rng([*seed, 1]))
        self._random, self._chance = np.random.default_rng([*seed, 0]), np.random.default_rng([*seed, 2])
        self._speed_mps = self._turn_radps = 0.0
        self._now_s = 0.0
        self._readings = 0

    def advance(self, now_s: float) -> None:
        """Move the body to this time under its last command; a bumper stops it before it runs into a person."""
        wheels, odometry, speed_mps = self.wheels, self.odometry, self._speed_mps
        stepwise = odometry.draws or len(self.building.people) > 0
        moves = bool(speed_mps or self._turn_radps)
        while self._now_s < now_s:
            if moves and stepwise:
                odometry.draw()
                way_m = self._speed_mps * min(STEP_S, now_s - self._now_s)
                speed_mps = 0.0 if self._runs_into_somebody(way_m) else self._speed_mps
            moment = Moment(self._now_s, now_s, speed_mps, self._turn_radps, moves and stepwise)
            at, counts = wheels.pose, (odometry.pose, odometry.travelled_m)
            driven = _drive(at, counts, moment, odometry.factors, wheels.body, self.building.plan.walls)
            wheels.pose, (odometry.pose, odometry.travelled_m), self._now_s = driven

    def _runs_into_somebody(self, way_m: float) -> bool:
        """Return whether it touches a person after `way_m`, and came nearer to that person."""
        x, y, heading = self.wheels.pose
        after = x + way_m * math.cos(heading), y + way_m * math.sin(heading)
        for *person, radius in self.building.people.tolist():
            away = math.dist(after, person)
            if away < radius + self.wheels.config.radius_m and away < math.dist((x, y), person):
                return True
        return False

    def sense(self, t_ms: int, watched: Iterable[str] = ()) -> tuple[bytes, bytes]:
        """Return the reading that the s-node logs, and the raw data whose hash it contains: scan, then other sensors.

        Args:
            watched: actions of other robots that its camera sees.
        """
        building, odometry = self.building, self.odometry
        self._readings += 1
        scan = building.lidar.sweep(self.wheels.pose, self._random, building.people)
        entries = [reading_entry(reading.encode()) for reading in (*watched, *self._near())]
        raw = self.sensors.raw_of(scan, [*entries, *map(code_entry, self._read())])
        return self.sensors.make(self.rob_id, t_ms, odometry.pose, odometry.travelled_m, raw), raw

    def _near(self) -> list[str]:
        """Return the readings of sources in range, nearest first."""
        plan, at = self.building.plan, self.wheels.pose[:2]
        found = []
        for source in plan.sources:
            place, chance = (source.x_m, source.y_m), float(self._chance.standard_normal())
            away = math.dist(at, place)
            if source.is_read(away, chance) and not (source.stopped_by_walls and not plan.sees(at, place)):
                found.append((away, source.reading))
        return [reading for _, reading in sorted(found)]

    def does(self) -> list[str]:
        """Return the names of the actions that other robots can see at present."""
        return [name for name, when_s in self._did.items() if self._now_s - when_s <= SHOWN_S]

    def _read(self) -> tuple[SeenCode, ...]:
        """Return the codes read by the camera, if it takes a picture with this reading."""
        camera, people = self.building.camera, self.building.people
        if camera is None or self._readings % self.picture_every:
            return ()
        return camera.look(self.wheels.pose, self._random, people, self._turn_radps)

    def execute_command(self, command: bytes) -> None:
        """Execute a command; ignore bytes that are not a valid one."""
        if len(command) == DRIVE.size and command[0] == KIND_DRIVE:
            *_, speed, turn = DRIVE.form.unpack(command)
            self._speed_mps, self._turn_radps = speed / MILLI, turn / MILLI
        elif command[:1] == bytes([KIND_ACTION]):
            self.actions.append(command)
            with suppress(MalformedMission):  # malformed, from a compromised robot: nothing to see
                self._did[parse_action(command[ACTION.size :]).name] = self._now_s

    def halt(self) -> None:
        """Stop for good. Source: RoboRebound §3.1 (Safe Mode)."""
        self._speed_mps = self._turn_radps = 0.0
