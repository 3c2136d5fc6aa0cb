"""The simulated swarm: geometry, routes, batteries, joining and leaving."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.errors import Unknown, UsageError
from phalanx.robot import Led, Point
from phalanx.robot.follow import wheels_towards
from phalanx.world import Dotbots
from phalanx.world.swarms.dotbots import BODY_MM, TOP_SPEED_MMPS

DT = 0.02


def one(seed: int = 3) -> tuple[Dotbots, str]:
    swarm = Dotbots(1, seed, lambda: 1000.0)
    return swarm, swarm.robots()[0].address


def run(swarm: Dotbots, seconds: float) -> None:
    for _ in range(round(seconds / DT)):
        swarm.step(DT)


def nose(direction_deg: float) -> tuple[float, float]:
    """Where a nose points, from docs/spec/vocabulary.md."""
    angle = math.radians(direction_deg)
    return -math.sin(angle), math.cos(angle)


def test_the_same_seed_gives_the_same_swarm_and_another_another():
    places = [[robot.at for robot in Dotbots(20, seed, lambda: 0.0).robots()] for seed in (1, 1, 2)]
    assert places[0] == places[1] != places[2]


def test_driving_goes_along_the_nose_at_the_stated_speed():
    swarm, address = one()
    before = swarm.robots()[0]
    swarm.drive(address, 50, 50)
    run(swarm, 1.0)
    after = swarm.robots()[0]
    dx, dy = after.at.x_mm - before.at.x_mm, after.at.y_mm - before.at.y_mm
    assert math.hypot(dx, dy) == pytest.approx(TOP_SPEED_MMPS / 2, rel=0.01)
    ahead = nose(before.direction_deg)
    assert (dx * ahead[0] + dy * ahead[1]) / math.hypot(dx, dy) > 0.999


def test_the_left_wheel_turns_it_clockwise_on_the_screen():
    swarm, address = one()
    before = swarm.robots()[0].direction_deg
    swarm.drive(address, 20, -20)
    run(swarm, 0.3)
    turned = (swarm.robots()[0].direction_deg - before + 180) % 360 - 180
    assert 0 < turned < 180


def test_walls_hold():
    swarm, address = one()
    swarm.drive(address, 100, 100)
    run(swarm, 20)
    at = swarm.robots()[0].at
    width, height = swarm.area_mm
    assert BODY_MM <= at.x_mm <= width - BODY_MM
    assert BODY_MM <= at.y_mm <= height - BODY_MM
    assert BODY_MM in (at.x_mm, at.y_mm, width - at.x_mm, height - at.y_mm)


points = st.builds(Point, st.floats(100, 1900), st.floats(100, 1900))


@given(st.lists(points, min_size=1, max_size=4), st.integers(0, 50))
def test_any_route_is_driven_in_order_and_ends_in_a_stop(route, seed):
    swarm, address = one(seed)
    swarm.follow(address, route, 60)
    start = swarm.robots()[0]
    assert start.route == (start.at, *route)
    reached = 0
    for _ in range(6000):
        swarm.step(DT)
        robot = swarm.robots()[0]
        if not robot.route:
            break
        while (
            reached < len(route)
            and math.dist((robot.at.x_mm, robot.at.y_mm), (route[reached].x_mm, route[reached].y_mm)) <= 66
        ):
            reached += 1
    assert not robot.route
    assert math.dist((robot.at.x_mm, robot.at.y_mm), (route[-1].x_mm, route[-1].y_mm)) <= 66
    swarm.step(DT)
    assert swarm.robots()[0].at == robot.at


def test_a_joystick_or_an_empty_route_ends_following():
    for end in (lambda s, a: s.drive(a, 0, 0), lambda s, a: s.follow(a, [], 60)):
        swarm, address = one()
        swarm.follow(address, [Point(100, 100), Point(1900, 1900)], 60)
        run(swarm, 0.5)
        end(swarm, address)
        at = swarm.robots()[0].at
        run(swarm, 1)
        assert swarm.robots()[0].at == at
        assert not swarm.robots()[0].route


def test_trails_are_recorded_and_forgotten():
    swarm, address = one()
    run(swarm, 1)
    assert not swarm.robots()[0].history
    swarm.follow(address, [Point(1000, 1000)], 60)
    run(swarm, 3)
    trail = list(swarm.robots()[0].history)
    assert len(trail) > 5
    assert all(20 <= math.dist((a.x_mm, a.y_mm), (b.x_mm, b.y_mm)) <= 40 for a, b in zip(trail, trail[1:]))
    swarm.clear_history(address)
    assert not swarm.robots()[0].history


def test_an_empty_battery_leaves_charges_and_comes_back_as_itself():
    swarm = Dotbots(3, 0, lambda: 0.0)
    first = swarm.robots()[0]
    swarm.set_led(first.address, Led(1, 2, 3))
    swarm.drive(first.address, 100, 100)
    gone_for = 0
    for _ in range(3000):
        swarm.step(1.0)
        there = {robot.address: robot for robot in swarm.robots()}
        if first.address not in there:
            gone_for += 1
        elif gone_for:
            break
    assert 55 <= gone_for <= 65
    back = there[first.address]
    assert (back.name, back.led) == (first.name, Led(1, 2, 3))
    assert back.battery_v > 2.99
    with pytest.raises(Unknown):
        swarm.drive("DECAFBADFFFFFFFF", 1, 1)


def test_robots_join_and_leave_without_disturbing_the_others():
    swarm = Dotbots(5, 0, lambda: 0.0)
    addresses = [robot.address for robot in swarm.robots()]
    swarm.set_led(addresses[4], Led(9, 9, 9))
    swarm.leave(addresses[1])
    new = swarm.join()
    assert [robot.address for robot in swarm.robots()] == [*addresses[:1], *addresses[2:], new]
    assert swarm.robots()[3].led == Led(9, 9, 9)
    swarm.drive(addresses[4], 100, 100)
    before = {robot.address: robot.at for robot in swarm.robots()}
    run(swarm, 0.5)
    moved = [robot.address for robot in swarm.robots() if robot.at != before[robot.address]]
    assert moved == [addresses[4]]


def test_names_are_unique_even_in_a_large_swarm():
    names = [robot.name for robot in Dotbots(500, 0, lambda: 0.0).robots()]
    assert len(set(names)) == 500


@pytest.mark.parametrize("count", [0, -1, 2001])
def test_a_swarm_has_a_size(count):
    with pytest.raises(UsageError):
        Dotbots(count, 0, lambda: 0.0)


@given(st.lists(st.tuples(st.floats(-3000, 3000), st.floats(-3000, 3000)), min_size=1, max_size=20))
def test_wheels_are_whole_percents_and_turn_towards_the_goal(goals):
    ahead, right = (np.array(column) for column in zip(*goals))
    left_pct, right_pct = wheels_towards(ahead, right)
    assert left_pct.dtype == right_pct.dtype == np.int64
    assert (abs(left_pct) <= 100).all()
    assert (abs(right_pct) <= 100).all()
    clearly = abs(right) > 0.1 * np.hypot(ahead, right) + 1e-3
    assert (np.sign(left_pct - right_pct)[clearly] == np.sign(right)[clearly]).all()
