"""A way that is blocked: the robot comes back the way it went, and goes round another way."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np

from phalanx.cli.mission.files import read_plain
from phalanx.mission import BuildOptions, Profile, build
from phalanx.mission.landmarks import FloorPlan, LaserScan
from phalanx.mission.walk.outcome import Kind, Order
from phalanx.sim.building.floorplan import load_floorplan
from phalanx.sim.missions.pilot import Pilot
from phalanx.sim.missions.robot import Report
from phalanx.sim.missions.run import MissionRun, Part, run_mission

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


def test_between_two_places_that_are_known_it_does_not_try_the_same_blocked_ways_for_ever() -> None:
    report = sent_to("R8", shut(D5))
    assert report.done
    assert report.false_fixes == 0


def _scan(ranges: float) -> LaserScan:
    return LaserScan(np.full(1080, ranges), -0.75 * math.pi, 1.5 * math.pi / 1080)


def test_back_it_goes_straight_to_a_place_in_sight_and_else_the_way_it_came() -> None:
    home = (0.0, 0.0)
    there = (4.0, 4.0, -0.75 * math.pi)  # looking home, over a corner that it went round

    def back_from_there(ranges: float) -> float:
        pilot = Pilot()
        way = [(0.5 * i, 0.0, 0.0) for i in range(8)] + [(4.0, 0.5 * i, math.pi / 2) for i in range(9)]
        for i, pose in enumerate(way):
            pilot.step(Order(Kind.GO, 1, home, 0.0), pose, _scan(ranges), 0.1 * i)
        return pilot.step(Order(Kind.BACK, 0, home, toward_m=home), there, _scan(ranges), 2.0)[1]

    assert abs(back_from_there(math.inf)) < 0.1
    # The way it came leads down, 45 degrees to the left of home.
    assert back_from_there(1.0) > 0.7
