"""The pilot that auditors replay: it arrives, keeps off walls, gives up; and the same commands uncompiled."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from audited import PLAN, SENSORS, Recording, errand, everybody
from commands import uncompiled
from phalanx.kernel import PURE
from phalanx.mission import Kind, Order, Profile, Walker
from phalanx.robot.controllers.mission.course import NO_STOP, Course, Goal, steer
from phalanx.robot.controllers.mission.pilot import Drive, Leg, drive
from phalanx.robot.controllers.mission.readings import CLEAR, Reading
from phalanx.robot.controllers.mission.surroundings import SIDE, Sectors, Seen, packed, sight, unpacked
from phalanx.world.building.odometry import OdometryNoise
from phalanx.world.missions.body import Building, MissionBody
from worlds import BOTH

LIDAR = SENSORS.lidar
SECTORS = Sectors(LIDAR.angle_min_rad, 12 * LIDAR.angle_increment_rad, SENSORS.sectors)
OPEN = Reading((0.0, 0.0, 0.0), 0.0, b"", np.full(SENSORS.sectors, CLEAR, np.uint8))
TIMEOUT_S = 60.0


def driven(order: Order, start, seconds: float):
    """A body that carries out an order in the office, odometry being true: (pose, leg, last command) at each step."""
    body = MissionBody(1, Building(PLAN), SENSORS, start, OdometryNoise(0.0, 0.0), (0, 1))
    leg = Leg()
    for k in range(round(4 * seconds)):
        body.advance(0.25 * k)
        reading, _ = body.sense(1000 + 250 * k)
        leg, command = drive(leg, order, 0, body.wheels.pose, SENSORS.parse(reading), SECTORS, 0.25 * k, TIMEOUT_S)
        body._speed_mps, body._turn_radps = command.speed_mps, command.turn_radps
        yield body.wheels.pose, leg, command
        if command.blocked:
            return


def test_it_goes_where_it_is_known_to_go_and_touches_nothing():
    order = Order(Kind.GO, 1, (3.0, 1.5), None, (7.0, 10.0))
    poses = [pose for pose, *_ in driven(order, PLAN.start, 30.0)]
    assert min(math.dist(pose[:2], (7.0, 10.0)) for pose in poses) < 0.3
    assert min(PLAN.clearance_m(x, y) for x, y, _ in poses) > 0.2


def test_it_follows_a_direction_through_a_door():
    order = Order(Kind.GO, 1, (3.0, 12.0), 0.0)
    poses = [pose for pose, *_ in driven(order, (3.0, 12.0, 0.0), 25.0)]
    assert max(x for x, _, _ in poses) > 10.0, "through the lobby's door at 9, 12"
    assert min(PLAN.clearance_m(x, y) for x, y, _ in poses) > 0.2


def test_a_place_behind_a_wall_is_given_up():
    order = Order(Kind.GO, 1, (3.0, 12.0), None, (3.0, 16.0))
    *_, (pose, leg, command) = driven(order, (3.0, 12.0, 1.57), 60.0)
    assert command.blocked
    assert leg.key == (-1, -1, 0)
    assert leg.trail, "by which it finds back"
    assert pose[1] < 13.5


@pytest.mark.parametrize("kind", [kind for kind in Kind if kind not in (Kind.GO, Kind.BACK)])
def test_any_other_order_is_to_stand(kind):
    assert drive(Leg((0, 1, 2)), Order(kind), 0, PLAN.start, OPEN, SECTORS, 1.0, TIMEOUT_S) == (Leg(), Drive())


def test_nothing_in_range_is_not_in_sight():
    """A place eight metres off, and sectors that end at five: first to where the order begins."""
    order = Order(Kind.GO, 1, (0.0, 2.0), None, (8.0, 0.0))
    leg, command = drive(Leg(), order, 0, (0.0, 0.0, 0.0), OPEN, SECTORS, 1.0, TIMEOUT_S)
    assert not leg.passed
    assert command.turn_radps > 0
    near = Order(Kind.GO, 1, (0.0, 2.0), None, (4.0, 0.0))
    assert drive(Leg(), near, 0, (0.0, 0.0, 0.0), OPEN, SECTORS, 1.0, TIMEOUT_S)[0].passed


def test_kernels_give_the_same_compiled_and_not():
    dice = np.random.default_rng(3)
    old, base, stop = bytes(SIDE * SIDE), (0, 0), (NO_STOP, NO_STOP)
    for i in range(60):
        clear = dice.integers(0, 256, SENSORS.sectors).astype(np.uint8)
        moved, goal, beyond = (
            (0.1 * i, -0.05 * i, 0.3 * i),
            tuple(dice.uniform(-4, 4, 2)),
            tuple(dice.uniform(-6, 6, 2)),
        )
        assert sight(clear, SECTORS.cosines, SECTORS.sines, *goal, 0.25) == sight.py_func(
            clear, SECTORS.cosines, SECTORS.sines, *goal, 0.25
        )
        seen = Seen(np.frombuffer(old, np.uint8), base, i % 2, moved, clear, SECTORS.fan)
        args = seen, Goal(goal, beyond, i % 3 > 0), Course(stop, 0, 9.0), 0.1
        one, other = np.empty(SIDE * SIDE, np.uint8), np.empty(SIDE * SIDE, np.uint8)
        told = steer(*args, one)
        assert told == steer.py_func(*args, other)
        assert np.array_equal(one, other)
        old, base, stop = one.tobytes(), told[2], told[3].stop
        assert unpacked(packed(old)) == old


@pytest.mark.parametrize("profile", BOTH)
def test_a_process_in_which_nothing_is_compiled_replays_the_same_commands_and_states(profile, tmp_path):
    recording = Recording.of(profile)
    path = tmp_path / "steps.json"
    told = [
        (each.step, each.t_ms, each.reading.hex(), each.evidence.hex(), [o.payload.hex() for o in each.outputs])
        for each in recording.steps
    ]
    path.write_text(json.dumps({"profile": int(profile), "steps": told, "end": recording.steps[-1].state.hex()}))
    script = f"from mission.test_mission_pilot import replay; replay({str(path)!r})"
    assert uncompiled(script) == ["same", str(len(told))]


def replay(path: str) -> None:
    """The child: the whole walk from boot, uncompiled."""
    assert PURE, "compiled"
    told = json.loads(Path(path).read_text())
    one = errand(Profile(told["profile"]))
    controller = everybody(one, 2).controllers_of(2, Walker(one.mission, one.key))(1)
    for step, t_ms, reading, evidence, outputs in told["steps"]:
        done = controller.on_evidence(step, t_ms, bytes.fromhex(reading), bytes.fromhex(evidence))
        assert [output.payload.hex() for output in done] == outputs, step
    assert controller.encode().hex() == told["end"]
    print("same", len(told["steps"]))
