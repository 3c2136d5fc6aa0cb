"""What a robot believes is judged by what is true: where it is, and what can be seen from there."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from phalanx.config.lidar import LidarConfig
from phalanx.mission import Experience, Landmark
from phalanx.mission.file.canonical import parse_shape
from phalanx.mission.landmarks import FloorPlan, floorplan_of_yaml
from phalanx.mission.landmarks.lidar import Lidar
from phalanx.mission.observable import Cell, Offset
from phalanx.mission.walk.claims import Claim
from phalanx.mission.walk.opening import Opened
from phalanx.world.missions.truth import Truth, pose_error

# Two rooms; in the wall between them, without thickness, a door from y = 2 to 3.5.
PLAN = floorplan_of_yaml(
    b"{name: two, size: [8, 6], start_pose: [1, 1, 0], walls: [[0, 0, 8, 0], [8, 0, 8, 6], [8, 6, 0, 6],"
    b" [0, 6, 0, 0], [5, 0, 5, 2], [5, 3.5, 5, 6]]}"
)
DOOR = Landmark("doorway", 5.0, 2.75, math.pi / 2)
CORNER = Landmark("concave_left", 5.0, 2.0, math.pi)
ROOM = Landmark("room", 6.5, 4.0, area_m2=7.0)
HERE = (2.0, 2.75, 0.0)
CELL_M = 0.1


@pytest.mark.parametrize(
    ("estimate", "said"),
    [
        ((2.0, 2.75, 0.0), ""),
        ((2.3, 3.1, 0.0), ""),
        ((2.4, 3.1, 0.0), "metres"),
        ((math.nan, 2.75, 0.0), "metres"),
        ((2.0, 2.75, math.radians(5.9)), ""),
        ((2.0, 2.75, math.radians(-6.1)), "degrees"),
        ((2.0, 2.75, math.tau), ""),
    ],
)
def test_a_fix_that_leaves_a_robot_far_off_is_false(estimate: tuple[float, float, float], said: str) -> None:
    assert pose_error(HERE, estimate, None) == said


@pytest.mark.parametrize(
    ("estimate", "said"),
    [
        ((2.29, 2.75, 0.0), ""),
        ((2.31, 2.75, 0.0), "sigmas"),
        ((2.0, 2.79, 0.0), "sigmas"),
        ((2.0, 2.75, 0.05), ""),
        ((2.0, 2.75, 0.07), "sigmas"),
        ((2.6, 2.75, 0.0), "metres"),
    ],
)
def test_a_robot_that_is_surer_than_it_may_be_is_wrong_even_when_it_is_near(
    estimate: tuple[float, float, float], said: str
) -> None:
    # 10 cm along the x axis, 1 cm across it, 0.02 rad.
    assert pose_error(HERE, estimate, (0.01, 0.0, 0.0, 0.0001, 0.0, 0.0004)) == said


def test_how_sure_a_robot_is_counts_along_its_error_however_the_axes_lie() -> None:
    # 10 cm along the diagonal, 1 cm across it.
    spread = (0.00505, 0.00495, 0.0, 0.00505, 0.0, 1.0)
    assert pose_error(HERE, (2.2, 2.95, 0.0), spread) == ""
    assert pose_error(HERE, (2.2, 2.55, 0.0), spread) == "sigmas"


def opened(thing: Landmark | None, place: tuple[float, float] | None = None) -> Opened:
    claim = Claim(1, 0, parse_shape(1), Offset(), Cell(0, 0), b"")
    return Opened(1, 0, "", place, thing, None, (), (), b"", claim)


def seen_from(pose: tuple[float, float, float], *things: Landmark) -> Experience:
    return Experience(1.0, *pose, landmarks=things)


def judged(thing: Landmark, true: tuple[float, float, float] = HERE, plan: FloorPlan = PLAN) -> str:
    return Truth(plan, LidarConfig()).decoding_error(true, opened(thing), seen_from(true, thing), CELL_M)


@pytest.mark.parametrize(
    ("thing", "true", "said"),
    [
        (DOOR, HERE, ""),
        (DOOR, (2.0, 2.75, 3.0), "hidden"),  # behind its back
        (DOOR, (4.9, 0.5, 1.5), ""),  # on the same side, at a flat angle
        (CORNER, HERE, ""),
        (CORNER, (7.0, 5.0, -2.5), ""),  # the wall's end is seen from both sides
        (Landmark("corner_convex", 8.0, 0.0, 2.4), HERE, "hidden"),
        (ROOM, HERE, ""),
        (ROOM, (4.5, 0.5, 1.0), "hidden"),
        (ROOM, (7.0, 4.3, 0.5), ""),  # from its middle: three corners are in view, and the middle is not
        (DOOR, (4.0, 2.75, 3.0), ""),  # with its back to it, between the jambs
        (replace(CORNER, x_m=8.0, y_m=0.98), (2.0, 3.0, -0.3), ""),  # past the wall's end by a hair
        (replace(CORNER, x_m=8.0, y_m=0.9), (2.0, 3.0, -0.3), "hidden"),
    ],
)
def test_a_landmark_behind_a_wall_or_behind_the_robot_is_not_in_sight(
    thing: Landmark, true: tuple[float, float, float], said: str
) -> None:
    assert judged(thing, true) == said


def test_nothing_beyond_the_range_of_the_lidar_is_in_sight() -> None:
    truth = Truth(PLAN, LidarConfig(range_max_m=2.5))
    assert truth.decoding_error(HERE, opened(DOOR), None, CELL_M) == "hidden"
    assert truth.decoding_error((3.0, 2.75, 0.0), opened(DOOR), None, CELL_M) == ""


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (DOOR, ""),
        (replace(DOOR, x_m=5.2, y_m=2.9), ""),
        (replace(DOOR, orientation_rad=-math.pi / 2), ""),  # it has no front
        (replace(DOOR, orientation_rad=1.1), "another"),
        (replace(DOOR, y_m=3.2), "another"),
        (replace(CORNER, x_m=5.0, y_m=2.75), "another"),
    ],
)
def test_what_was_seen_must_lie_where_the_landmark_truly_is(other: Landmark, said: str) -> None:
    truth = Truth(PLAN, LidarConfig())
    assert truth.decoding_error(HERE, opened(DOOR), seen_from(HERE, other), CELL_M) == said


def test_where_a_thing_was_seen_counts_from_where_the_robot_is_and_not_from_where_it_believes_to_be() -> None:
    # It believes to be 0.6 m further left: what it sees of the door it puts there, and the match corrects it.
    truth, believed = Truth(PLAN, LidarConfig()), (2.0, 3.35, 0.0)
    assert truth.decoding_error(HERE, opened(DOOR), seen_from(believed, replace(DOOR, y_m=3.35)), CELL_M) == ""
    assert truth.decoding_error(HERE, opened(DOOR), seen_from(believed, DOOR), CELL_M) == "another"


@pytest.mark.parametrize(("place", "said"), [((2.5, 2.25), ""), ((2.0, 3.31), "elsewhere"), (None, "")])
def test_a_node_that_is_a_place_is_true_where_the_robot_is(place: tuple[float, float] | None, said: str) -> None:
    assert Truth(PLAN, LidarConfig()).decoding_error(HERE, opened(None, place), None, CELL_M) == said


def test_people_hide_nothing_from_the_truth() -> None:
    # A wall of them before the door: a lidar would not see it, and it is in sight all the same.
    crowd = np.array([[3.0, 2.0 + 0.3 * i, 0.25] for i in range(6)])
    ranges = Lidar(PLAN.walls).true_ranges(HERE, crowd)
    assert ranges[len(ranges) // 2] < 1.0
    assert judged(DOOR) == ""
