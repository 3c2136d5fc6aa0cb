"""Robots on wheels that do a protocol's work while nobody drives them, and are taken over by phones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phalanx.config import WheelsConfig
from phalanx.errors import Unknown
from phalanx.robot import Point
from phalanx.robot.controllers.bundled import wheels
from phalanx.robot.controllers.peer_bodies import TAKEN_MS
from phalanx.wire.record import MalformedRecord
from phalanx.world.swarms.protected import DEMO, ProtectedSwarm
from phalanx.world.swarms.work import LATELY_S, ON_WHEELS, Work

STEP_S = 0.1
LEAST = {"exploration": 90.0, "patrol": 50.0, "tracking": 30.0}  # after 20 s


def working(robots=8, protocol="patrol", seed=0, **more) -> ProtectedSwarm:
    return ProtectedSwarm(robots, seed, lambda: 0.0, protocol=protocol, **more)


def live(swarm: ProtectedSwarm, seconds: float) -> list:
    """What audits were refused meanwhile."""
    refused = []
    for _ in range(round(seconds / STEP_S)):
        swarm.step(STEP_S)
        refused += [audit for audit in swarm.new_audits() if audit.refusal]
    return refused


def places(swarm: ProtectedSwarm) -> list[Point]:
    return [robot.at for robot in swarm.robots()]


@pytest.mark.parametrize("protocol", ON_WHEELS)
def test_they_work_by_themselves_under_audit_and_show_where_they_go(protocol):
    swarm = working(protocol=protocol)
    at_work = set()
    for _ in range(20):
        assert live(swarm, 1.0) == []
        at_work |= {robot.address for robot in swarm.robots() if robot.route}
    assert len(at_work) >= 6
    assert not swarm.world.safe.any()
    assert all(len(shield.vouchers) >= shield.needed for shield in swarm.shields())
    done = swarm.done()
    assert done.name == protocol
    assert done.score is None if protocol == "perimeter" else done.score > LEAST[protocol]
    assert bool(swarm.things()) == (protocol in ("perimeter", "tracking"))


def test_who_waits_for_people_has_done_nothing():
    swarm = ProtectedSwarm(8, 0, lambda: 0.0)
    assert swarm.done() is None
    assert not swarm.things()


def test_what_has_come_of_it_counts_from_the_first_intruder_that_had_its_time():
    swarm = working(12, "perimeter")
    live(swarm, 6.0)
    assert (swarm.done().score, round(swarm.done().lately_s)) == (None, 6)
    stage = swarm._work.stage
    stage.now_s = swarm._now_s = 200.0
    assert (swarm.done().score, round(swarm.done().lately_s)) == (0.0, round(LATELY_S))


def test_a_visitor_takes_one_over_and_it_goes_back_to_work():
    swarm = working()
    live(swarm, 5.0)
    address = swarm.robots()[0].address
    for _ in range(20):
        swarm.drive(address, 30, -30)  # turns on the spot
        live(swarm, 0.2)
    assert swarm.world.acc[0].tolist() == [0.3, -0.3]
    assert not swarm.robots()[0].route
    live(swarm, 1.0)
    here = places(swarm)[0]
    live(swarm, TAKEN_MS / 1000 - 1.5)
    assert places(swarm)[0] == here, "it waits for the next word"
    assert live(swarm, 3.0) == []
    assert places(swarm)[0] != here
    assert swarm.robots()[0].route


def test_a_visitor_s_route_is_driven_to_its_end_and_shown_meanwhile():
    swarm = working()
    live(swarm, 3.0)
    address, x_mm = swarm.robots()[0].address, places(swarm)[0].x_mm
    goal = Point(1900.0 if x_mm < 1000 else 100.0, 1900.0)
    swarm.follow(address, [goal], 60.0)
    live(swarm, 0.5)
    assert swarm.robots()[0].route[-1] == goal
    nearest = math.inf
    for _ in range(25):
        assert live(swarm, 1.0) == []
        nearest = min(nearest, math.dist((goal.x_mm, goal.y_mm), (places(swarm)[0].x_mm, places(swarm)[0].y_mm)))
    assert nearest < 150
    assert swarm.robots()[0].route[-1] != goal


def test_the_operator_holds_all_and_lets_them_go_on():
    swarm = working()
    live(swarm, 5.0)
    swarm.hold()
    live(swarm, 1.0)
    here = places(swarm)
    assert live(swarm, 8.0) == []
    assert places(swarm) == here
    assert not any(robot.route for robot in swarm.robots())
    swarm.release()
    live(swarm, 3.0)
    assert all(math.dist((a.x_mm, a.y_mm), (b.x_mm, b.y_mm)) > 10 for a, b in zip(places(swarm), here))


@pytest.mark.parametrize(
    "protocol, attack",
    [("patrol", "claim-visits"), ("patrol", "hijack"), ("perimeter", "open-breach"), ("tracking", "point-elsewhere")],
)
def test_who_begins_to_lie_in_the_middle_of_it_is_stopped_and_nobody_else(protocol, attack):
    swarm = working(12, protocol)
    assert attack in [choice.name for choice in swarm.attacks()]
    live(swarm, 6.0)
    swarm.compromise(swarm.robots()[3].address, attack)
    refused = live(swarm, DEMO.stop_bound_ms(output_missing=True) / 1000)
    assert refused
    assert np.flatnonzero(swarm.world.safe).tolist() == [3]
    assert swarm.shields()[3].attack == attack


def test_a_protocol_s_lies_are_none_of_those_who_do_something_else():
    with pytest.raises(Unknown, match="claim-visits"):
        waiting = ProtectedSwarm(8, 0, lambda: 0.0)
        waiting.compromise(waiting.robots()[0].address, "claim-visits")
    assert "claim-area" in [choice.name for choice in working(protocol="exploration").attacks()]


@pytest.mark.parametrize(
    "protocol, robots, told",
    [
        ("warehouse", 8, "wheeled robots cannot do 'warehouse'"),
        ("dance", 8, "wheeled robots cannot do 'dance'"),
        ("patrol", 41, "41 robots for patrol"),
        ("perimeter", 13, "13 robots for perimeter"),
    ],
)
def test_what_wheels_cannot_do_is_refused(protocol, robots, told, phalanx):
    code, _, err = phalanx("up", "--scenario", protocol, "--robots", str(robots))
    assert code == 2
    assert err.splitlines()[-2] == f"phalanx: error: {told}"


@pytest.mark.parametrize("words", [("--mission", "office"), ("--defence", "none"), ("--swarm", "dotbot://127.0.0.1:1")])
def test_who_has_other_work_has_no_scenario(words, phalanx):
    code, _, err = phalanx("up", "--scenario", "patrol", *words)
    assert code == 2
    assert "patrol" in err or "--scenario" in err


class TestMemory:
    def controller(self):
        params = wheels.CONTROLLER.params(WheelsConfig(state_every=15))
        work = Work("patrol", DEMO, params, np.array([(0.3, 0.3), (1.0, 1.0), (0.7, 1.3)]), 0)
        return work, work.make_controller(2)

    def test_a_checkpoint_is_all_that_it_remembers_and_there_is_room_for_it(self):
        swarm = working()
        live(swarm, 8.0)
        for i, robot in swarm._nodes.items():
            kept = robot.controller.encode()
            assert kept == swarm.world.fleet.state[i, : len(kept)].tobytes()
            again = swarm._work.make_controller(i + 1)
            again.decode(kept)
            assert again.encode() == kept
            assert again.others == robot.controller.others, "who replays from there has the same numbers"
            assert len(kept) + 4 * 32 <= swarm._work.bti.state_bytes

    @pytest.mark.parametrize("cut", [0, 1, 100, 157, 158, 170, -1])
    def test_a_part_of_one_is_none(self, cut):
        _, one = self.controller()
        with pytest.raises(MalformedRecord):
            self.controller()[1].decode(one.encode()[:cut])
        with pytest.raises(MalformedRecord):
            self.controller()[1].decode(one.encode() + b"\0")

    @pytest.mark.parametrize("reading", [b"", bytes(23), b"\xff" * 23])
    def test_a_reading_that_makes_no_sense_stops_the_wheels_and_says_nothing(self, reading):
        _, one = self.controller()
        (act,) = one.on_input(13, 20_000, reading)
        assert act.payload[wheels.BODY] == act.payload[wheels.BODY + 1] == 0
