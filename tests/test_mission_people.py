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
from phalanx.mission import BuildOptions, Profile, Walker, build
from phalanx.sim.building.floorplan import load_floorplan
from phalanx.sim.building.odometry import OdometryNoise
from phalanx.sim.building.walkers import RADIUS_M
from phalanx.sim.missions.orders import orders_of
from phalanx.sim.missions.robot import MissionRobot, World
from phalanx.sim.missions.run import MissionRun, run_mission, summary

OFFICE = load_floorplan("office_40x40")
TOUCH_M = RADIUS_M + 0.175


def run_of(name: str, people: int, **more: object) -> MissionRun:
    plain = read_plain(name)
    orders = orders_of(plain, build(plain, BuildOptions(profile=Profile.PAPER), random.Random(0).randbytes), OFFICE)
    given = {"robots": len(orders.parts), "noise": OdometryNoise(0.03, 0.05), **more}
    return MissionRun(
        plan=orders.plan, parts=orders.parts, pool=orders.pool, controller=orders.controller, people=people, **given
    )


def test_the_office_is_explored_among_people_and_nobody_is_taken_for_a_landmark() -> None:
    alone, among = (summary(run, run_mission(run)) for run in (run_of("office", 0), run_of("office", 5)))
    assert (among["completed"], among["decoded"], among["false_fixes"]) == (1, 33, 0)
    assert among["digest"] != alone["digest"]


def test_all_processes_see_the_same_people_and_the_seed_decides_who_they_are() -> None:
    run = run_of("office", 20, robots=3, duration_s=40)
    alone, shared = (summary(run, run_mission(run, workers))["digest"] for workers in (1, 2))
    assert alone == shared
    assert summary(run, run_mission(run))["digest"] == alone
    other = run_of("office", 20, robots=3, duration_s=40, seed=1)
    assert summary(other, run_mission(other))["digest"] != alone


def robot_in(world: World) -> MissionRobot:
    part = run_of("office", 0).parts[0]
    return MissionRobot(0, world, Walker(part.mission, part.key), part.start, OdometryNoise(0.0, 0.0), 0)


def test_a_robot_goes_around_who_stands_in_its_way_and_touches_nobody() -> None:
    free = robot_in(World(OFFICE))
    for _ in range(100):
        free.step()
    where = free.body.pose[:2]
    world = World(OFFICE)
    world.people = np.array([[*where, RADIUS_M]])
    robot = robot_in(world)
    nearest = math.inf
    for _ in range(400):
        robot.step()
        nearest = min(nearest, math.dist(robot.body.pose[:2], where))
    assert nearest >= TOUCH_M
    assert math.dist(robot.body.pose[:2], free.report.places[0]) > 3, "it got on"


def test_whom_a_robot_touches_stops_its_wheels_and_it_may_turn_and_go_back() -> None:
    world = World(OFFICE)
    robot = robot_in(world)
    x, y, _ = robot.body.pose
    robot.body.pose = (x, y, 0.0)
    world.people = np.array([[x + TOUCH_M + 0.12, y, RADIUS_M]])
    for _ in range(10):
        robot._drive(0.5, 0.0)
    assert robot.body.pose[0] - x == pytest.approx(0.1)
    assert robot.odometry.travelled_m == pytest.approx(0.1), "wheels that turn on would lose it"
    for _ in range(10):
        robot._drive(-0.5, 0.0)
    assert robot.body.pose[0] < x


def test_a_lidar_and_a_camera_see_people() -> None:
    world = World(run_of("delivery", 0).plan)
    pose = (17.5, 5.0, 0.0)
    assert world.camera is not None

    def seen() -> tuple[float, int]:
        draws = np.random.default_rng(0)
        ahead = world.lidar.sweep(pose, draws, world.people).ranges_m[540]
        return float(ahead), len(world.camera.read(world.camera.picture(pose, draws, world.people)))

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
