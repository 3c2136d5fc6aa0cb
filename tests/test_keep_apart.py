"""Robots of the demo avoid each other in every mode: by themselves, on a route, and driven by a visitor."""

from __future__ import annotations

import itertools
import math

import pytest

from phalanx.robot import Point
from phalanx.robot.controllers.keep_apart import NEAR_BYTES, decode_near, encode_near, go_around, restrain
from phalanx.world.swarms.protected import ProtectedSwarm

STEP_S = 0.05
BODY_MM = 80.0


def least_mm(swarm: ProtectedSwarm) -> float:
    """The least distance between the middles of two robots."""
    return min(math.dist(a, b) for a, b in itertools.combinations(places(swarm), 2))


def places(swarm: ProtectedSwarm) -> list[tuple[float, float]]:
    return [(robot.at.x_mm, robot.at.y_mm) for robot in swarm.robots()]


@pytest.mark.parametrize("count, protocol", [(12, "patrol"), (20, "exploration"), (12, "perimeter"), (12, "tracking")])
def test_nobody_drives_through_another_and_all_move_at_once(count, protocol):
    swarm = ProtectedSwarm(count, 0, lambda: 0.0, protocol=protocol, keeps_apart=True)
    starts, refused = places(swarm), []
    for step in range(round(15 / STEP_S)):
        swarm.step(STEP_S)
        assert least_mm(swarm) > BODY_MM
        refused += [audit for audit in swarm.new_audits() if audit.refusal]
        if step == round(1 / STEP_S):
            assert any(math.dist(a, b) > 5 for a, b in zip(starts, places(swarm))), "movement in the first second"
    assert refused == [], "auditors replay it, byte for byte"
    assert not swarm.world.safe.any()
    assert sum(math.dist(a, b) > 20 for a, b in zip(starts, places(swarm))) > count // 2


def test_a_visitor_does_not_drive_one_into_another_and_on_a_route_it_goes_around():
    swarm = ProtectedSwarm(8, 3, lambda: 0.0, protocol="patrol", keeps_apart=True)
    addresses = [robot.address for robot in swarm.robots()]
    driven, routed = addresses[0], addresses[1]
    goals = [Point(200.0, 200.0), Point(1800.0, 1800.0), Point(200.0, 1800.0), Point(1800.0, 200.0)]
    at, seen, went_mm = 0, [places(swarm)[0]], 0.0
    for step in range(round(40 / STEP_S)):
        if step % 4 == 0:
            swarm.drive(driven, 100, 97)  # full speed, whatever is in the way
        if not swarm.robots()[1].route:
            swarm.follow(routed, goals[at % 4 :] + goals[: at % 4], 90.0)
            at += 1
        swarm.step(STEP_S)
        went_mm += math.dist(seen[-1], places(swarm)[0])
        seen.append(places(swarm)[0])
        assert least_mm(swarm) > BODY_MM
    assert went_mm > 500
    assert at >= 2, "the route was driven to its end"
    assert not swarm.world.safe.any()


def test_a_reading_has_the_nearest_and_nonsense_has_none():
    near = encode_near((1.0, 1.0), [(1.5, 1.0), (1.1, 1.0), (1.0, 0.7), (1.15, 1.15), (0.9, 0.9), (0.72, 1.0)])
    assert len(near) == NEAR_BYTES
    assert decode_near(near) == [(100, 0), (-100, -100), (150, 150), (-280, 0)]
    assert decode_near(encode_near((1.0, 1.0), [])) == []
    assert decode_near(near[1:]) == []


def test_wheels_never_push_and_always_turn():
    north = (0.0, 1.0)  # sin and cos: the nose points along +y
    assert restrain(100, 100, *north, [(0.0, 120.0)]) == (0, 0)
    assert restrain(-100, -100, *north, [(0.0, 120.0)]) == (-100, -100), "backwards it may"
    assert restrain(50, -50, *north, [(0.0, 120.0)]) == (50, -50)
    assert restrain(100, 100, *north, [(150.0, 10.0)]) == (100, 100), "what is beside the way is passed"
    slow, _ = restrain(100, 100, *north, [(0.0, 185.0)])
    assert 0 < slow < 100
    x, y = go_around((0.0, 1000.0), [(0.0, 200.0)])
    assert x < -100
    assert math.hypot(x, y) == pytest.approx(1000)
