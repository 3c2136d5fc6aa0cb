"""The pilot around what stands in the way and among those who walk there; how long it tries; where it acts."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from audited import SENSORS
from phalanx.cli.mission.files import read_plain
from phalanx.mission import BuildOptions, Kind, Order, Profile, build, plain_mission
from phalanx.mission.landmarks import FloorPlan
from phalanx.robot.controllers.mission.course import NO_STOP, Course, Goal, steer
from phalanx.robot.controllers.mission.field import TOUCHING, weights
from phalanx.robot.controllers.mission.pilot import Leg, drive
from phalanx.robot.controllers.mission.surroundings import FADE_S, FRESH, SIDE, Sectors, Seen
from phalanx.world.building.floorplan import load_floorplan
from phalanx.world.building.odometry import OdometryNoise
from phalanx.world.building.walkers import Walkers
from phalanx.world.missions.body import Building, MissionBody
from phalanx.world.missions.orders import orders_of
from phalanx.world.missions.run import run_mission
from phalanx.world.missions.setup import MissionRun

LIDAR = SENSORS.lidar
SECTORS = Sectors(LIDAR.angle_min_rad, 12 * LIDAR.angle_increment_rad, SENSORS.sectors)
RADIUS_M = 0.175
TRUE = OdometryNoise(0.0, 0.0)
Wall = tuple[float, float, float, float]


def plan_of(*walls: Wall, size: tuple[float, float] = (20.0, 10.0)) -> FloorPlan:
    """A hall with these walls in it."""
    x, y = size
    box = [(0, 0, x, 0), (x, 0, x, y), (x, y, 0, y), (0, y, 0, 0)]
    return FloorPlan("hall", np.array([*box, *walls], float), (), (0, 0, x, y))


@dataclass
class Told:
    """What became of a drive."""

    end: str = "late"
    t_s: float = 0.0
    clearance_m: float = math.inf
    wavers: int = 0  # turns from one side to the other and back, each within a step
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0)


def driven(
    plan: FloorPlan,
    order: Order,
    start,
    goal,
    seconds: float,
    *,
    hz: int = 10,
    timeout_s: float = 60.0,
    people: int = 0,
    seed: int = 0,
    within_m: float = 0.6,
    noise: OdometryNoise = TRUE,
    odometry: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Told:
    """A body that carries out an order until it is near its goal, by a pose that is true."""
    crowd = Walkers(plan, people, np.random.default_rng([seed, 7])) if people else None
    building = Building(plan, crowd=crowd)
    body = MissionBody(1, building, SENSORS, start, noise, (seed, 1))
    body.odometry.pose = odometry
    leg, told, before = Leg(), Told(), 0.0
    for k in range(round(hz * seconds)):
        told.t_s = k / hz
        building.advance_people(told.t_s)
        body.advance(told.t_s)
        told.pose = body.wheels.pose
        reading, _ = body.sense(1000 + round(1000 * told.t_s))
        leg, command = drive(leg, order, 0, told.pose, SENSORS.parse(reading), SECTORS, told.t_s, timeout_s)
        body._speed_mps, body._turn_radps = command.speed_mps, command.turn_radps
        told.wavers += command.turn_radps * before < -0.5
        before = command.turn_radps
        told.clearance_m = min(told.clearance_m, plan.clearance_m(*told.pose[:2]))
        if command.blocked or math.dist(told.pose[:2], goal) < within_m:
            told.end = "blocked" if command.blocked else "there"
            break
    return told


def to(goal, place) -> Order:
    return Order(Kind.GO, 1, place, None, goal)


def along(place) -> Order:
    return Order(Kind.GO, 1, place, 0.0)


def door(width_m: float) -> list[Wall]:
    """A wall across the hall, 0.1 m thick, and a door in its middle."""
    low, high = 5 - width_m / 2, 5 + width_m / 2
    sides: list[Wall] = [(10, 0, 10, low), (10, high, 10, 10), (10.1, 0, 10.1, low), (10.1, high, 10.1, 10)]
    return [*sides, (10, low, 10.1, low), (10, high, 10.1, high)]


def square(x: float, y: float, edge: float) -> list[Wall]:
    return [
        (x, y, x + edge, y),
        (x + edge, y, x + edge, y + edge),
        (x + edge, y + edge, x, y + edge),
        (x, y + edge, x, y),
    ]


# Who looks at the inner corner sees the only way out at one edge of the view, and when it turns there, at the other.
CLOSET: list[Wall] = [(10, 4.4, 12, 4.4), (12, 4.4, 12, 5.6), (12, 5.6, 10.6, 5.6)]
NICHE: list[Wall] = [(9, 4, 9, 6), (9, 4, 11, 4), (9, 6, 10.3, 6), (11, 4, 11, 5)]


def test_beside_a_jamb_that_its_course_would_touch_it_creeps_aside_first():
    start, goal = (9.86, 4.77), (11.0, 5.0)
    heading = math.atan2(goal[1] - start[1], goal[0] - start[0])
    told = driven(plan_of(*door(0.8)), to(goal, (5, 5)), (*start, heading), goal, 20, within_m=0.3)
    assert told.end == "there"
    assert told.clearance_m > RADIUS_M


def test_around_an_end_that_its_cells_would_let_it_touch_it_goes_by_another_cell():
    """It stood at the corner of a rack for good: on the way between two cells as near to it, it would have touched."""
    hall = plan_of(
        (14.75, 2.46, 14.75, 3.84), (14.75, 3.84, 16.06, 3.8), (15.58, 4.75, 14.76, 4.75), (14.76, 4.75, 14.71, 5.29)
    )
    start, place, goal = (14.508, 3.747, 0.951), (14.75, 3.845), (16.058, 3.804)
    told = driven(hall, to(goal, place), start, goal, 25, odometry=(11.0106, -1.7123, 0.99855))
    assert (told.end, told.clearance_m > RADIUS_M) == ("there", True)


@pytest.mark.parametrize(
    ("walls", "start", "goal"),
    [(CLOSET, (11.4, 5, 0.3), (14, 5)), (NICHE, (10, 5, 3.1), (5, 5))],
    ids=["closet", "niche"],
)
@pytest.mark.parametrize("hz", [4, 10])
def test_a_way_out_beyond_the_edge_of_the_view_is_taken(walls, start, goal, hz):
    told = driven(plan_of(*walls), to(goal, start[:2]), start, goal, 40, hz=hz)
    assert told.end == "there"
    assert told.wavers <= 2


def test_a_way_of_forty_metres_is_gone_by_who_has_the_time_and_nobody_goes_on_for_ever():
    hall = plan_of(size=(50.0, 3.0))
    start, goal = (1.0, 1.5, 0.0), (41.0, 1.5)
    assert driven(hall, along(start[:2]), start, goal, 90, timeout_s=100.0).end == "there"
    short = driven(hall, along(start[:2]), start, goal, 90)
    assert short.end == "blocked"
    assert short.t_s == pytest.approx(45.0, abs=2.0), "it has a quarter of its minute left, and is back in time"


@pytest.mark.parametrize("depth_m", [1.0, 2.0])
@pytest.mark.parametrize("order", [to((14.0, 5.0), (3.0, 5.0)), along((3.0, 5.0))], ids=["place", "line"])
def test_it_finds_out_of_a_cul_de_sac(depth_m, order):
    x = 9 - depth_m
    told = driven(plan_of((x, 3.5, 9, 3.5), (9, 3.5, 9, 6.5), (9, 6.5, x, 6.5)), order, (3, 5, 0.0), (14, 5), 60)
    assert told.end == "there"
    assert told.clearance_m > RADIUS_M + 0.03


@pytest.mark.parametrize("width_m", [0.7, 0.8, 1.0])
def test_it_passes_narrow_doors(width_m):
    hall = plan_of(*door(width_m))
    for start, hz in (((4.0, 5.0, 0.0), 10), ((9.0, 1.0, 1.57), 10), ((4.0, 3.0, 0.0), 4)):
        told = driven(hall, to((16.0, 5.0), start[:2]), start, (16, 5), 60, hz=hz, noise=OdometryNoise(0.03, 0.05))
        assert (told.end, told.clearance_m > RADIUS_M) == ("there", True), (start, told)


def test_it_goes_between_pillars():
    walls = [wall for x in (5, 8, 11, 14) for y in (1.3, 3.1, 4.8, 6.6, 8.4) for wall in square(x, y, 0.4)]
    told = driven(plan_of(*walls), along((1, 5)), (1, 5, 0.0), (18, 5), 60)
    assert (told.end, told.clearance_m > RADIUS_M + 0.03) == ("there", True)
    assert told.t_s < 40


@pytest.mark.parametrize(("width_m", "people"), [(1.2, 3), (2.0, 6)])
def test_among_people_in_a_corridor_it_waits_and_goes_on(width_m, people):
    hall = plan_of(size=(20.0, width_m))
    start = (1.0, width_m / 2, 0.0)
    for seed in range(3):
        told = driven(hall, along(start[:2]), start, (17, width_m / 2), 60, people=people, seed=seed, within_m=0.7)
        assert (told.end, told.clearance_m > RADIUS_M) == ("there", True), (seed, told)


def test_who_stands_in_the_door_is_waited_for_as_long_as_the_mission_says():
    hall = plan_of(*door(1.0))
    building = Building(hall)
    building.people = np.array([[10.05, 5.0, 0.25]])
    for timeout_s in (30.0, 90.0):
        body = MissionBody(1, building, SENSORS, (7.0, 5.0, 0.0), OdometryNoise(0.0, 0.0), (0, 1))
        leg, t_s, blocked = Leg(), 0.0, False
        while not blocked and t_s < 200:
            t_s += 0.1
            body.advance(t_s)
            reading = SENSORS.parse(body.sense(1000 + round(1000 * t_s))[0])
            leg, command = drive(
                leg, to((14.0, 5.0), (7.0, 5.0)), 0, body.wheels.pose, reading, SECTORS, t_s, timeout_s
            )
            body._speed_mps, body._turn_radps = command.speed_mps, command.turn_radps
            blocked = command.blocked
            assert math.dist(body.wheels.pose[:2], (10.05, 5.0)) > 0.25 + RADIUS_M
        assert timeout_s / 3 < t_s < timeout_s / 3 + 20


def test_what_is_out_of_view_is_remembered_for_a_while_and_what_is_in_view_is_as_it_is():
    building = Building(plan_of())
    body = MissionBody(1, building, SENSORS, (10.0, 5.0, 0.0), OdometryNoise(0.0, 0.0), (0, 1))
    leg, order, around = Leg(), to((18.0, 5.0), (10.0, 5.0)), {}
    for k in range(200):
        t_s = 0.1 * k
        building.people = np.array([[11.0, 5.0, 0.25]]) if k < 5 else np.zeros((0, 3))
        if k == 2:  # it turns about: the person is behind it, and goes away
            body.wheels.pose = (10.0, 5.0, math.pi)
            body.odometry.step(0.0, math.pi)
        reading = SENSORS.parse(body.sense(1000 + 100 * k)[0])
        leg, _ = drive(leg, order, 0, body.wheels.pose, reading, SECTORS, t_s, 60.0)
        around[k] = sum(map(bool, leg.cells))
    assert around[1] > 0
    assert around[40] == around[1]
    assert around[round(10 * FADE_S * FRESH) + 10] == 0
    body.wheels.pose = (10.0, 5.0, 0.0)
    assert len(leg.cells) == SIDE * SIDE


def test_who_waits_for_something_waits_at_the_node():
    order = Order(Kind.WAIT, 1, (14.0, 5.0))
    # Within half a cell of 0.4 m, or in `sealed` it would wait beside the place where it has to be.
    told = driven(plan_of(), order, (8.0, 5.0, 1.0), (14.0, 5.0), 30, within_m=0.2)
    assert told.end == "there"
    reading = SENSORS.parse(
        MissionBody(1, Building(plan_of()), SENSORS, told.pose, OdometryNoise(), (0, 1)).sense(1)[0]
    )
    assert drive(Leg(), order, 0, told.pose, reading, SECTORS, 90.0, 60.0)[1].speed_mps == 0.0


def acted(name: str, seed: int, people: int = 0) -> dict[str, float]:
    """How far each node at which something is done was from the robot, in truth, when it was."""
    plain = read_plain(name)
    plan = load_floorplan(plain.floor_plan)
    orders = orders_of(plain, build(plain, BuildOptions(profile=Profile.PAPER), random.Random(0).randbytes), plan)
    more = {"noise": OdometryNoise(0.03, 0.05), "keep_trace": True, "people": people, "seed": seed, "duration_s": 600.0}
    run = MissionRun(
        plan=orders.plan,
        parts=orders.parts,
        pool=orders.pool,
        controller=orders.controller,
        robots=len(orders.parts),
        **more,
    )
    away: dict[str, float] = {}
    for report in run_mission(run):
        assert report.done
        assert report.false_fixes == 0
        mine = [node for node in plain.nodes if node.part == plain.parts[report.robot]]
        poses = {t_s: pose for t_s, pose, *_ in report.trace}
        away |= {
            mine[i].name: math.dist(poses[t_s][:2], mine[i].place)
            for t_s, i in report.decoded
            if mine[i].do or mine[i].send or mine[i].final
        }
    return away


@pytest.mark.parametrize(
    ("seed", "people"), [(1, 3), *(pytest.param(seed, 0, marks=pytest.mark.long) for seed in (0, 2))]
)
@pytest.mark.parametrize(("name", "acts"), [("delivery", 2), ("inspection", 4)])
def test_what_is_done_at_a_node_is_done_there(name, acts, seed, people):
    away = acted(name, seed, people)
    assert len(away) == acts
    assert max(away.values()) < 1.1, away  # a metre by what the lidar measures


def test_a_landmark_counts_from_near_where_something_is_done_unless_its_author_says_otherwise():
    door = {"see": {"doorway": [9.0, 12.0], "facing": 90}}
    nodes = {
        "start": {"see": {"position": [3.0, 1.5]}, "start": True, "do": "greet"},
        "seen": door,
        "told": {**door, "wait": ["go"], "final": True},
        "near": {**door, "do": "greet"},
        "says": {**door, "send": ["lit"]},
        "ends": {**door, "final": True},
        "said": {**door, "final": True, "within_m": 2.5},
        "far": {**door, "final": True, "within_m": 0},
    }
    plain = plain_mission({"mission": "reach", "nodes": nodes, "ways": [{"from": "start", "to": list(nodes)[1:]}]})
    (one,) = build(plain, BuildOptions(profile=Profile.PAPER), random.Random(0).randbytes)
    assert [node.reach_dm for node in one.mission.nodes] == [0, 0, 0, 10, 10, 10, 25, 0]


def test_through_a_gap_that_its_cells_close_it_creeps():
    """In nav2_depot it stood before one for 80 s, straight, and held; here it took 44 s."""
    x, y, half = 6.09, 5.09, 0.275
    sides = [
        ((x, 0), (x, y - half), (x + 0.3, y - half), (x + 0.3, 0)),
        ((x, 10), (x, y + half), (x + 0.3, y + half), (x + 0.3, 10)),
    ]
    walls = [(*a, *b) for side in sides for a, b in pairwise(side)]
    told = driven(plan_of(*walls, size=(12, 10)), to((9.0, 5.0), (4.0, 5.0)), (4.0, 4.6, 0.2), (9.0, 5.0), 30.0)
    assert told.end == "there"
    assert told.clearance_m > RADIUS_M


@pytest.mark.parametrize(("bearing", "is_forgotten"), [(0.0, True), (1.6, False), (-2.5, False)])
def test_who_turns_on_the_spot_has_not_got_on(bearing, is_forgotten):
    """In office_30x25 a robot looked around, turned back to its way, forgot that it had looked, and so on for 12 s."""
    open_floor = np.full(SENSORS.sectors, 255, np.uint8)
    seen = Seen(np.zeros(SIDE * SIDE, np.uint8), (-24, -24), 0, (0.0, 0.0, 0.0), open_floor, SECTORS.fan)
    at = 4 * math.cos(bearing), 4 * math.sin(bearing)
    before = Course((NO_STOP, NO_STOP), 0, 4.0)
    *_, course = steer(seen, Goal(at, at, True), before, 0.1, np.empty(SIDE * SIDE, np.uint8))
    assert (course.waited_s < 4.0) == is_forgotten
    assert course.waited_s >= 3.5


@pytest.mark.parametrize("start", [(2.58, 9.34, 2.05), (2.56, 9.4, 2.3)])
def test_a_speck_that_it_would_touch_is_gone_around(start):
    """Its cells left a way past the speck, its lidar none: it stood there for a minute, and held."""
    walls = [(2.0, 8.89, 4.0, 8.89), (2.0, 7.5, 2.0, 8.89), (2.0, 9.94, 4.0, 9.94), (4.0, 8.89, 4.0, 7.5)]
    plan = plan_of(*walls, *square(2.295, 9.37, 0.025), size=(6.0, 12.0))
    assert driven(plan, to((1.2, 8.5), start[:2]), start, (1.2, 8.5), 40.0, timeout_s=120.0).end == "there"


@pytest.mark.parametrize(("start", "bent"), [((7.1, 2.2), -0.05), ((7.3, 1.6), -0.05), ((7.8, 2.5), -0.05)])
def test_around_the_end_of_a_long_shelf_it_waits_once_and_not_at_every_step(start, bent):
    """Its line leads from one corner of the shelf to the other at the far end, through the shelf."""
    shelves = [(x, 2.0, x + 1, 11.9) for x in (2.2, 5.8, 9.4)]
    faces: list[Wall] = [
        face for x, y, u, v in shelves for face in ((x, y, u, y), (u, y, u, v), (u, v, x, v), (x, v, x, y))
    ]
    order = Order(Kind.GO, 1, (6.8, 2.0), math.atan2(9.9, -1.0) + bent)
    told = driven(plan_of(*faces, size=(17.0, 15.0)), order, (*start, 1.57), (6.3, 12.4), 48.0)
    assert told.end == "there"


@pytest.mark.parametrize("aside", [0, 1, -1])
def test_along_a_face_it_gets_on_the_line_of_its_direction_and_beside_it(aside):
    """A shelf stands at a wall; from its near corner a way leads along its side to the far one, or through the shelf."""
    plan, corner = plan_of(*square(9, 0.1, 1.5)), (9.0, 1.6)
    order = Order(Kind.GO, 1, corner, -math.pi / 2, aside=aside)
    told = driven(plan, order, (9.1, 2.0, -math.pi / 2), (8.4, 0.5), 60.0)
    assert told.end == "there"


def test_who_stands_too_near_to_a_thing_may_leave_to_where_it_is_no_nearer_and_not_past_it():
    wide, middle = SIDE + 2, SIDE // 2
    cells, leave = np.zeros(SIDE * SIDE, np.uint8), np.empty(wide * wide, np.int64)
    cells[(middle + 1) * SIDE + middle + 1] = FRESH
    here, thing = (middle + 0.5, middle + 0.5), np.array([[middle + 1.5, middle + 1.5]])
    weights(cells, here, (1.0, 0.0), thing, leave)

    def costs(dx: int, dy: int) -> int:
        return leave[(middle + 1 + dy) * wide + middle + 1 + dx]

    assert costs(1, 0) == costs(0, 1) == TOUCHING
    assert costs(1, -1) < TOUCHING
    assert costs(0, -1) < TOUCHING


def test_who_stands_at_a_known_place_and_does_not_see_it_goes_on_beyond():
    """The doorway between two shelves is told from outside alone."""
    order = Order(Kind.GO, 1, (4.0, 5.0), 0.0, toward_m=(9.0, 5.0))
    told = driven(plan_of(), order, (4.0, 5.0, 0.0), (11.0, 5.0), 40.0, within_m=0.3)
    assert told.end == "there"
    told = driven(plan_of(), order, (4.0, 5.0, 0.0), (13.0, 5.0), 60.0, within_m=0.3)
    assert (told.end, round(told.pose[0])) == ("blocked", 11), "no farther, and not for ever"
