"""Drive through the office once and localise with the encoded graph: Encoded graphs Figs. 8a, 8b, 8c and 10.

The drive is recorded once: true poses, wheel motion, ranges. Each odometry noise, landmark kind and grid size is then
replayed on the same scans, as the paper does with its recording of 150 s.
"""

from __future__ import annotations

import importlib.resources
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice

import numpy as np
import yaml
from numpy.typing import NDArray

from phalanx.config.lidar import ExtractionConfig
from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.mission import BuildOptions, EncodedMission, Experience, Landmark, Mission, Profile, build, plain_mission
from phalanx.mission.authoring.findable import mark_lookalikes_in
from phalanx.mission.landmarks import FloorPlan, LaserScan, extract
from phalanx.mission.landmarks.lidar import Lidar
from phalanx.mission.walk.fix import fixed, initial_belief, odometry_errors_of
from phalanx.mission.walk.walker import State, Walker
from phalanx.papers.table import Rows, Table
from phalanx.world.building.floorplan import DEFAULT, load_floorplan
from phalanx.world.building.odometry import DiffDrive, Odometry, OdometryNoise, Pose

Motion = tuple[float, float]
TICK_S = 0.1
DURATION_S = 150.0
SPEED_MPS = 0.65
TURN_GAIN, TURN_RADPS = 2.5, 1.5
NEAR_M = 0.4
# From the main door through the west corridor, the hall, the north and east corridors into the room R2.
PATH_M = (
    (3.0, 6.0), (7.5, 11.9), (9.0, 12.0), (10.2, 12.2), (10.6, 13.5), (10.6, 16.0), (12.5, 17.0), (15.0, 17.2),
    (17.0, 21.5), (22.0, 24.5), (22.0, 26.0), (22.3, 27.7), (30.0, 27.7), (30.5, 26.0), (30.4, 23.5), (28.0, 23.2),
    (25.0, 21.0), (24.0, 16.0), (20.2, 14.8), (20.0, 13.5), (20.4, 12.0), (25.3, 11.7), (25.5, 10.0), (24.5, 5.0),
    (22.0, 3.5), (25.0, 7.5), (25.5, 10.0), (25.7, 11.7), (29.8, 12.0), (30.2, 13.5), (30.3, 16.0),
)  # fmt: skip

# A replay only localises; the mission must not time out.
PATIENT = MissionConfig(timeout_s=1e6)


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Recording of one drive."""

    poses: NDArray[np.float64]  # (T, 3) true poses, map frame
    motions: NDArray[np.float64]  # (T, 2) wheel motion since the previous sample: distance in m, turn in rad
    scans: tuple[LaserScan, ...]

    @property
    def start(self) -> Pose:
        """Return the start pose, which the robot knows."""
        x, y, heading = self.poses[0].tolist()
        return x, y, heading


def poses_along(
    plan: FloorPlan, path_m: tuple[tuple[float, float], ...], speed_mps: float
) -> Iterator[tuple[Pose, Motion]]:
    """Yield a robot's true poses along a path, and its wheel motion since the previous tick.

    The robot drives straight between the points of the path and stops at its end. The iterator never ends.
    """
    assert plan.start is not None, "the built-in floor plans have a start pose"
    body, leg, motion = DiffDrive(plan, plan.start), 0, (0.0, 0.0)
    while True:
        yield body.pose, motion
        x, y, heading = body.pose
        near = math.dist((x, y), path_m[leg]) < NEAR_M
        if near and leg + 1 < len(path_m):
            leg, near = leg + 1, False
        bearing = math.remainder(math.atan2(path_m[leg][1] - y, path_m[leg][0] - x) - heading, math.tau)
        turn = max(-TURN_RADPS, min(TURN_RADPS, TURN_GAIN * bearing))
        speed = speed_mps * max(0.0, math.cos(bearing)) ** 2
        motion = (0.0, 0.0) if near else body.step(*body.wheels(speed, turn), TICK_S)


@lru_cache(maxsize=2)
def record(seed: int = 0, duration_s: float = DURATION_S) -> Drive:
    """Return the drive along PATH_M; the seed determines the noise of the lidar.

    Source: Encoded graphs §VI-B (150 s, lidar at 10 Hz).
    """
    plan = load_floorplan(DEFAULT)
    lidar, chance = Lidar(plan.walls), np.random.default_rng([seed, 8])
    ticks = list(islice(poses_along(plan, PATH_M, SPEED_MPS), round(duration_s / TICK_S)))
    poses, motions = zip(*ticks, strict=True)
    return Drive(np.array(poses), np.array(motions), tuple(lidar.sweep(pose, chance) for pose in poses))


def office() -> Mission:
    """Return the built-in mission with the 32 landmarks of the default floor plan."""
    text = (importlib.resources.files("phalanx") / "data" / "missions" / "office.yaml").read_text()
    return mark_lookalikes_in(load_floorplan(DEFAULT), plain_mission(yaml.safe_load(text)))


@lru_cache(maxsize=16)
def encoded(kinds: tuple[str, ...] = (), delta_mm: int = 100) -> EncodedMission:
    """Encode the office in the paper profile, with landmarks of these kinds or of all; nodes may come in any order.

    Source: Encoded graphs §VI-B (0.1 m).
    """
    plain = office()
    kept = {
        node.name
        for node in plain.nodes
        if node.start
        or not kinds
        or all(thing.type in kinds for alias in node.see for thing in alias if isinstance(thing, Landmark))
    }
    chosen = replace(
        plain,
        nodes=tuple(node for node in plain.nodes if node.name in kept),
        ways=tuple(way for way in plain.ways if way.source in kept and way.target in kept),
        coding=CodingConfig(delta_mm=delta_mm),
        roam=True,
    )
    return build(chosen, BuildOptions(profile=Profile.PAPER), random.Random(0).randbytes)[0].mission  # noqa: S311


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Localisation results of one drive."""

    odometry: NDArray[np.float64]  # (T, 3) poses by odometry alone
    estimates: NDArray[np.float64]  # (T, 3) poses with fixes
    trials: NDArray[np.int64]  # (T,) hashes tried


def replay(
    drive: Drive, mission: EncodedMission, noise: OdometryNoise, seed: int, feature_range_m: float = 10.0
) -> Replay:
    """Localise the drive as a robot that knows its start pose, its wheel motion and the encoded mission.

    Any node of the mission can be decoded at any time. The seed determines the odometry noise.
    """
    walker, state = Walker(mission, config=PATIENT), State()
    alone = Odometry(drive.start, noise, np.random.default_rng([seed, 1]))
    belief = initial_belief(PATIENT, drive.start)
    extraction = ExtractionConfig(feature_range_m=feature_range_m)
    odometry, estimates, trials = [], [], []
    for i, ((distance_m, turn), scan) in enumerate(zip(drive.motions.tolist(), drive.scans, strict=True)):
        belief = belief.driven(alone.pose, alone.step(distance_m, turn), odometry_errors_of(PATIENT))
        landmarks = extract(scan, extraction).landmarks(*belief.pose)
        seen = Experience(i * TICK_S, *belief.pose, alone.travelled_m, landmarks, spread=belief.pose_covariance)
        state, outcome = walker.step(state, seen)
        if outcome.fix is not None:
            belief = fixed(PATIENT, belief, outcome.fix)
        odometry.append(alone.pose)
        estimates.append(belief.pose)
        trials.append(outcome.trials)
    return Replay(np.array(odometry), np.array(estimates), np.array(trials))


def errors_m(drive: Drive, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (T,) distances from the true to the given positions."""
    errors: NDArray[np.float64] = np.hypot(*(poses[:, :2] - drive.poses[:, :2]).T)
    return errors


def path_errors_m(table: Table, way: str) -> list[Rows]:
    """Return the (T,) distances of each case between the true path and the path `way`, both columns of the table."""

    def apart(case: str, axis: str) -> Rows:
        return table.column(case, f"{way}_{axis}_m") - table.column(case, f"true_{axis}_m")

    return [np.hypot(apart(case, "x"), apart(case, "y")) for case in table.cases]
