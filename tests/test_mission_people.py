"""People who walk about where robots live their missions: seen, gone around, and never driven through."""

from __future__ import annotations

import json
import math
import random

import numpy as np
import pytest
from click.testing import CliRunner

from phalanx.cli.commands.mission import mission as group
from phalanx.cli.mission.files import read_plain
from phalanx.errors import UsageError
from phalanx.mission import BuildOptions, Profile, build
from phalanx.mission.landmarks.codes import read_codes
from phalanx.wire.table import DRIVE, KIND_DRIVE
from phalanx.world.building.floorplan import load_floorplan
from phalanx.world.building.odometry import OdometryNoise
from phalanx.world.building.walkers import RADIUS_M
from phalanx.world.missions.body import Building
from phalanx.world.missions.orders import orders_of
from phalanx.world.missions.report import summary
from phalanx.world.missions.run import run_mission
from phalanx.world.missions.setup import MissionRun
from phalanx.world.missions.world import MissionRobot, MissionWorld

OFFICE = load_floorplan("office_40x40")
TOUCH_M = RADIUS_M + 0.175


def run_of(name: str, people: int, **more: object) -> MissionRun:
    plain = read_plain(name)
    orders = orders_of(plain, build(plain, BuildOptions(profile=Profile.PAPER), random.Random(0).randbytes), OFFICE)
    given = {"robots": len(orders.parts), "noise": OdometryNoise(0.03, 0.05), **more}
    return MissionRun(
        plan=orders.plan, parts=orders.parts, pool=orders.pool, controller=orders.controller, people=people, **given
    )


@pytest.mark.parametrize(
    ("name", "robots", "nodes"), [("inspection", 2, 9), pytest.param("office", 1, 33, marks=pytest.mark.long)]
)
def test_a_mission_is_completed_among_people_and_nobody_is_taken_for_a_landmark(
    name: str, robots: int, nodes: int
) -> None:
    run = run_of(name, 5)
    among = summary(run, run_mission(run))
    assert (among["completed"], among["decoded"], among["false_fixes"]) == (robots, nodes, 0)


def test_a_robot_among_people_lives_something_else() -> None:
    alone, beside = (run_of("office", people, duration_s=40) for people in (0, 5))
    assert summary(alone, run_mission(alone))["digest"] != summary(beside, run_mission(beside))["digest"]


def test_all_processes_see_the_same_people_and_the_seed_decides_who_they_are() -> None:
    run = run_of("office", 20, robots=3, duration_s=10)
    alone, shared = (summary(run, run_mission(run, workers))["digest"] for workers in (1, 2))
    assert alone == shared
    assert summary(run, run_mission(run))["digest"] == alone
    other = run_of("office", 20, robots=3, duration_s=10, seed=1)
    assert summary(other, run_mission(other))["digest"] != alone


def alone_in(building: Building) -> tuple[MissionWorld, MissionRobot]:
    world = MissionWorld(run_of("office", 0, noise=OdometryNoise(0.0, 0.0)), (0,), building=building)
    return world, world.robots[0]


def test_a_robot_goes_around_who_stands_in_its_way_and_touches_nobody() -> None:
    world, free = alone_in(Building(OFFICE))
    world.advance(10.0)
    where = free.body.wheels.pose[:2]
    building = Building(OFFICE)
    building.people = np.array([[*where, RADIUS_M]])
    world, robot = alone_in(building)
    nearest = math.inf
    for tick in range(400):
        world.advance(0.1 * (tick + 1))
        nearest = min(nearest, math.dist(robot.body.wheels.pose[:2], where))
    assert nearest >= TOUCH_M
    assert math.dist(robot.body.wheels.pose[:2], free.report.places[0]) > 3, "it got on"


def ahead(speed_mps: float) -> bytes:
    return DRIVE.form.pack(KIND_DRIVE, 1, 0, round(1000 * speed_mps), 0)


def test_whom_a_robot_touches_stops_its_wheels_and_it_may_turn_and_go_back() -> None:
    building = Building(OFFICE)
    _, robot = alone_in(building)
    body = robot.body
    x, y, _ = body.wheels.pose
    body.wheels.pose = (x, y, 0.0)
    building.people = np.array([[x + TOUCH_M + 0.12, y, RADIUS_M]])
    body.execute_command(ahead(0.5))
    body.advance(1.0)
    assert body.wheels.pose[0] - x == pytest.approx(0.1)
    assert body.odometry.travelled_m == pytest.approx(0.1), "wheels that turn on would lose it"
    body.execute_command(ahead(-0.5))
    body.advance(2.0)
    assert body.wheels.pose[0] < x


def test_a_lidar_and_a_camera_see_people() -> None:
    world = Building(run_of("delivery", 0).plan)
    pose = (17.5, 5.0, 0.0)
    assert world.camera is not None

    def seen() -> tuple[float, int]:
        draws = np.random.default_rng(0)
        ahead = world.lidar.sweep(pose, draws, world.people).ranges_m[540]
        return float(ahead), len(read_codes(world.camera.picture(pose, draws, world.people)))

    away, codes = seen()
    world.people = np.array([[18.5, 5.0, RADIUS_M]])
    assert (codes, away > 1.5) == (1, True)
    assert seen() == (pytest.approx(1 - RADIUS_M, abs=0.1), 0)


def test_the_command_lets_people_walk_and_refuses_nonsense() -> None:
    def run(people: int) -> tuple[str, BaseException | None]:
        words = ["run", "inspection", "--profile", "paper", "--people", str(people), "--duration", "20", "--json"]
        told = CliRunner().invoke(group, words, standalone_mode=False)
        return told.stdout and json.loads(told.stdout)["digest"], told.exception

    assert run(0)[0] != run(200)[0]
    for wrong in (-1, 10**6):
        assert isinstance(run(wrong)[1], UsageError)
