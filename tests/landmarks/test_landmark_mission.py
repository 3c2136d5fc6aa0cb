"""The whole way: floor plan → landmarks → encoded mission; wheels, lidar, extraction → hashes that match."""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from phalanx.config.lidar import ExtractionConfig
from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.mission import BuildOptions, Experience, Kind, Phase, Profile, State, Walker, build
from phalanx.mission.authoring.survey import most_spacious_start, survey
from phalanx.mission.authoring.survey import with_start as begun_in
from phalanx.mission.landmarks import extract, landmarks_of
from phalanx.mission.landmarks.lidar import Lidar
from phalanx.mission.landmarks.scan import beam_table
from phalanx.mission.walk.fix import fixed, initial_belief, wheels_of
from phalanx.robot.controllers.mission.readings import Sensors
from phalanx.world.building.floorplan import MAPS, load_floorplan
from phalanx.world.building.odometry import DiffDrive, Odometry, OdometryNoise

OTHERS = Path(__file__).parent.parent / "data" / "maps"
# The format's, at a cost of scrypt that a test can pay.
CHEAP = CodingConfig(delta_mm=400, kdf_log2_n=1, kdf_r=1)
CONFIG = MissionConfig()
DT_S, SPEED_MPS = 0.1, 0.5
FALSE_M = 0.5
# A whole floor, and halls of shelves: most of the time of all the maps.
LARGE = dict.fromkeys(("willow-full", "nav2_warehouse", "nav2_depot"), pytest.mark.long)


def draws(size, seed=[0]):  # noqa: B006  # counts the draws
    seed[0] += 1
    return hashlib.shake_256(str(seed[0]).encode()).digest(size)


class Robot:
    """Drives as its orders say, by what it believes and what its lidar shows to be free."""

    def __init__(self, plan, seed):
        self.random = np.random.default_rng(seed)
        self.drive = DiffDrive(plan, plan.start)
        self.odometry = Odometry(plan.start, OdometryNoise(0.03, 0.05), self.random)
        self.belief = initial_belief(CONFIG, plan.start)
        self.lidar = Lidar(plan.walls)
        self.sensors = Sensors(self.lidar.config)
        self.beams = beam_table(self.lidar.config.angle_min_rad, self.lidar.config.angle_increment_rad, 1080)
        self.leg, self.arrived = None, False

    def experience(self, t_s):
        # What an auditor would get.
        scan = self.sensors.scan_of(self.sensors.raw_of(self.lidar.sweep(self.drive.pose, self.random)))
        seen = extract(scan).landmarks(*self.belief.pose)
        travelled_m = self.odometry.travelled_m
        return Experience(t_s, *self.belief.pose, travelled_m, seen, spread=self.belief.doubt)

    @property
    def error_m(self):
        return math.dist(self.belief.pose[:2], self.drive.pose[:2])

    def free(self, turn, reach):
        """How far a lane as wide as the robot is free in a direction."""
        ahead = self.x * math.cos(turn) + self.y * math.sin(turn)
        off = self.y * math.cos(turn) - self.x * math.sin(turn)
        return np.min(ahead[(np.abs(off) < 0.22) & (ahead > 0)], initial=reach)

    def around(self, wanted, away):
        """The direction nearest to the wanted one that is free for a metre."""
        ranges = np.nan_to_num(self.lidar.true_ranges(self.drive.pose), posinf=30.0)[::4]
        self.x, self.y = ranges * self.beams[0][::4], ranges * self.beams[1][::4]
        reach = min(1.0, max(0.3, away))
        turns = np.linspace(-2.3, 2.3, 47)
        costs = [abs(t - wanted) + 4.0 * (reach - self.free(t, reach)) / reach + 0.1 * abs(t) for t in turns]
        return float(turns[np.argmin(costs)])

    def follow(self, order):
        x, y, heading = self.belief.pose
        goal_x, goal_y = order.place_m
        if self.leg != (order.target, order.place_m):
            self.leg, self.arrived = (order.target, order.place_m), False
        self.arrived = self.arrived or math.hypot(goal_x - x, goal_y - y) < 0.4
        if self.arrived and not order.toward_m:
            off = (y - goal_y) * math.cos(order.direction_rad) - (x - goal_x) * math.sin(order.direction_rad)
            wanted = order.direction_rad - max(-0.8, min(0.8, off))
        else:
            goal_x, goal_y = order.toward_m or (goal_x, goal_y)
            wanted = math.atan2(goal_y - y, goal_x - x)
        error = self.around(math.remainder(wanted - heading, math.tau), math.hypot(goal_x - x, goal_y - y))
        speed = SPEED_MPS if abs(error) < 0.6 and self.free(0.0, 1.0) > 0.25 else 0.0
        motion = self.drive.step(*self.drive.wheels(speed, max(-1.5, min(1.5, error / DT_S))), DT_S)
        self.belief = self.belief.driven(self.odometry.pose, self.odometry.step(*motion), wheels_of(CONFIG))


def walk(plan, profile, seed, steps):
    (built,) = build(survey(plan, CHEAP if profile is Profile.SEALED else None), BuildOptions(profile=profile), draws)
    walker, state, robot = Walker(built.mission, built.key), State(), Robot(plan, seed)
    errors = []
    for i in range(steps):
        state, outcome = walker.step(state, robot.experience(DT_S * i))
        if outcome.fix:
            robot.belief = fixed(CONFIG, robot.belief, outcome.fix)
            errors.append(robot.error_m)
        if outcome.order.kind is Kind.DONE:
            break
        if outcome.order.kind in (Kind.GO, Kind.BACK):
            robot.follow(outcome.order)
    return state, errors


@pytest.mark.long
@pytest.mark.parametrize("profile", list(Profile))
def test_a_robot_with_a_lidar_decodes_node_after_node_and_no_fix_is_false(profile):
    """Five minutes; given fifteen, a robot with such a simple driver comes to all 37 nodes, if no wall catches it."""
    state, errors = walk(load_floorplan("office_40x40"), profile, 1, 3000)
    assert len(errors) > 50, "a robot that is as sure as one gets takes no fix"
    assert max(errors) < FALSE_M
    assert np.median(errors) < 0.05
    assert state.phase is not Phase.HELD
    assert len(state.opened) >= 10


@pytest.mark.parametrize(
    "path",
    [
        *(pytest.param(MAPS / f"{name}.yaml", marks=pytest.mark.long) for name in ("nav2_depot", "aws_small_house")),
        *(pytest.param(path, marks=LARGE.get(path.stem, ())) for path in sorted(OTHERS.glob("*.yaml"))),
    ],
    ids=lambda path: path.stem,
)
def test_every_map_of_ros_compiles_to_a_mission(path):
    plan = load_floorplan(path)
    if plan.start is None:
        plan = begun_in(plan, most_spacious_start(plan))
    if len(plan.walls) > 3000:
        # A whole floor of an institute: compiled here without its thousand corners.
        plan = replace(plan, outlines=plan.outlines[:3])
    (built,) = build(survey(plan), BuildOptions(profile=Profile.PAPER), draws)
    assert len(built.mission.nodes) > 5


def test_settings_for_real_doors_change_what_a_map_shows():
    plan = load_floorplan(OTHERS / "willow-full.yaml")
    papers, real = landmarks_of(plan), landmarks_of(plan, ExtractionConfig(door_min_m=0.7))
    count = [sum(site.type == "doorway" for site in sites) for sites in (papers, real)]
    assert count[1] > count[0]
