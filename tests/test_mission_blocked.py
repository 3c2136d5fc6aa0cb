"""A way that is blocked: the robot comes back the way it went, and goes round another way."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import pytest

from phalanx.cli.mission.files import read_plain
from phalanx.mission import BuildOptions, Profile, build
from phalanx.mission.landmarks import FloorPlan
from phalanx.mission.walk.state import Kind, Order
from phalanx.robot.controllers.mission.pilot import TRAIL_MAX, Leg, drive
from phalanx.robot.controllers.mission.readings import CLEAR, CLEAR_STEP_M, Reading, Sensors
from phalanx.robot.controllers.mission.surroundings import Sectors
from phalanx.world.building.floorplan import load_floorplan
from phalanx.world.missions.report import Report
from phalanx.world.missions.run import run_mission
from phalanx.world.missions.setup import MissionRun, Part

OFFICE = load_floorplan("office_40x40")
# Ends of the two walls beside each door.
D5, D6 = (9.5, 13.5, 11.7, 13.5), (18.8, 13.5, 21.2, 13.5)


def shut(*doors: tuple[float, float, float, float]) -> FloorPlan:
    return replace(OFFICE, walls=np.vstack([OFFICE.walls, np.array(doors)]))


def sent_to(goal: str, plan: FloorPlan, profile: Profile = Profile.PAPER, seed: int = 0) -> Report:
    """What became of a robot that makes for a landmark of the office and has not been told of any shut door."""
    plain = read_plain("office")
    errand = replace(plain, nodes=tuple(replace(node, final=node.name == goal) for node in plain.nodes))
    (built,) = build(errand, BuildOptions(profile=profile), random.Random(0).randbytes)
    assert OFFICE.start is not None
    part = Part(built.mission, built.key, OFFICE.start)
    (report,) = run_mission(MissionRun(plan=plan, parts=(part,), seed=seed, duration_s=900))
    return report


def test_who_followed_a_wall_away_from_a_shut_door_finds_back_and_goes_round() -> None:
    report = sent_to("D18", shut(D6))
    assert {"timed out", "blocked"} & {reason for _, reason in report.not_validated}, "it was not there yet"
    assert report.done
    assert report.false_fixes == 0


@pytest.mark.long
def test_between_two_places_that_are_known_it_does_not_try_the_same_blocked_ways_for_ever() -> None:
    report = sent_to("R8", shut(D5))
    assert report.done
    assert report.false_fixes == 0


SENSORS = Sensors()
LIDAR = SENSORS.lidar
SECTORS = Sectors(LIDAR.angle_min_rad, SENSORS.beams_per_sector * LIDAR.angle_increment_rad, SENSORS.sectors)


TIMEOUT_S = 2000.0


def _room(pose: tuple[float, float, float], range_m: float) -> Reading:
    return Reading(pose, 0.0, b"", np.full(SENSORS.sectors, min(range_m / CLEAR_STEP_M, CLEAR), np.uint8))


def test_back_it_goes_straight_to_a_place_in_sight_and_else_the_way_it_came() -> None:
    home = (0.0, 0.0)
    there = (3.0, 3.0, -0.75 * math.pi)  # looking home, over a corner that it went round

    def back_from_there(room_m: float) -> float:
        leg = Leg()
        way = [(0.5 * i, 0.0, 0.0) for i in range(6)] + [(3.0, 0.5 * i, math.pi / 2) for i in range(7)]
        for i, pose in enumerate(way):
            leg, _ = drive(leg, Order(Kind.GO, 1, home, 0.0), 0, pose, _room(pose, room_m), SECTORS, 0.1 * i, TIMEOUT_S)
        order = Order(Kind.BACK, 0, home, toward_m=home)
        return drive(leg, order, 0, there, _room(there, room_m), SECTORS, 2.0, TIMEOUT_S)[1].turn_radps

    assert abs(back_from_there(math.inf)) < 0.1
    # The way it came leads down, 45 degrees to the left of home.
    assert back_from_there(1.5) > 0.5


def test_a_way_is_remembered_in_few_places_however_long_it_is_and_anew_from_where_it_begins() -> None:
    leg = Leg()
    for i in range(500):
        pose, order = (0.6 * i, 0.0, 0.0), Order(Kind.GO, 1, (0.0, 0.0), 0.0)
        leg, _ = drive(leg, order, 0, pose, _room(pose, 9.0), SECTORS, 0.1 * i, TIMEOUT_S)
    assert TRAIL_MAX // 2 <= len(leg.trail) <= TRAIL_MAX
    assert leg.trail[0] == (60, 0)
    pose, order = (299.5, 0.0, 0.0), Order(Kind.GO, 2, (300.0, 0.0), 0.0)
    leg, _ = drive(leg, order, 1, pose, _room(pose, 9.0), SECTORS, 60.0, TIMEOUT_S)
    assert leg.trail == ((29950, 0),)
