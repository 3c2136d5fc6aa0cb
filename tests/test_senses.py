"""Lidars and bumpers of controllers of one's own: what they say of a world, audited, in a simulation and as processes."""

from __future__ import annotations

import json
import math
import struct
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.cli.main import run_command
from phalanx.config import BtiConfig
from phalanx.config.flock import Box, Disc, FlockConfig
from phalanx.errors import UsageError
from phalanx.robot import Command, Controller, Reading, Senses
from phalanx.scenarios.own import find_class
from phalanx.world import AttackSpec, Scenario, simulate
from phalanx.world.audited.around import Around

DISC, BOX = Disc(x_m=5.0, y_m=0.0, radius_m=1.0), Box(left_m=-1.0, bottom_m=3.0, right_m=1.0, top_m=4.0)
CAREFUL = """
from dataclasses import dataclass
from phalanx.robot import Command, Controller, Senses

@dataclass(frozen=True)
class Memory:
    stopped: bool = False

class Careful(Controller):
    \"\"\"East until its lidar sees something within 4 m there, or it touches something; then it brakes.\"\"\"

    senses = Senses(beams=8, range_m=20.0, bumpers=4)
    memory = Memory()

    def on_reading(self, step, t_ms, reading):
        if self.senses.ranges_m(reading)[0] < 4.0 or any(self.senses.touches(reading)):
            self.memory = Memory(stopped=True)
        push = -reading.vx_mps if self.memory.stopped else 0.5 * (2.0 - reading.vx_mps)
        return [Command(max(-5.0, min(5.0, push)), 0.0)]
"""


def around(places, senses, obstacles=(DISC, BOX)):
    discs = [(each.x_m, each.y_m, each.radius_m) for each in obstacles if isinstance(each, Disc)]
    boxes = [(each.left_m, each.bottom_m, each.right_m, each.top_m) for each in obstacles if isinstance(each, Box)]
    world = SimpleNamespace(
        pos=np.array(places, float),
        fleet=SimpleNamespace(robot=places),
        discs=np.array(discs, float).reshape(-1, 3),
        boxes=np.array(boxes, float).reshape(-1, 4),
    )
    return Around(world, senses, 1.0)


def ranges(this, at=(0.0, 0.0), beams=8):
    return np.frombuffer(this.look(1, 0.0, at, lies=False), "<f4")[:beams]


def test_beams_go_round_from_the_east_to_discs_boxes_and_other_robots():
    this = around([(0.0, 0.0), (0.0, -3.0)], Senses(beams=8, range_m=4.5))
    east, north_east, north, *_, south, _ = seen = ranges(this)
    assert (east, north, south) == (4.0, 3.0, 2.5)
    assert math.isinf(north_east)
    assert np.isinf(seen).sum() == 5
    assert math.isinf(ranges(this, (-1.0, 0.0))[0]), "5 m, and it sees 4.5"
    assert ranges(this, (0.0, 3.5))[0] == 0.0, "inside the box"


@given(st.tuples(*[st.floats(-8, 8)] * 2), st.integers(0, 7))
def test_what_a_beam_says_is_the_first_thing_on_it_and_nothing_before(at, beam):
    this = around([at, (3.0, -3.0)], Senses(beams=8, range_m=50.0))
    told = float(ranges(this, at)[beam])
    angle = beam * math.tau / 8

    def is_in(metres):
        x, y = at[0] + metres * math.cos(angle), at[1] + metres * math.sin(angle)
        in_box = BOX.left_m < x < BOX.right_m and BOX.bottom_m < y < BOX.top_m
        return in_box or math.dist((x, y), (5, 0)) < 1.0 or math.dist((x, y), (3, -3)) < 0.5

    free = [metres for metres in np.arange(0, min(told, 30.0), 0.05) if metres < told - 1e-3]
    assert not any(map(is_in, free))
    if math.isfinite(told):
        touches = BOX.left_m <= at[0] <= BOX.right_m and BOX.bottom_m <= at[1] <= BOX.top_m
        begins = any(is_in(told + more) for more in (1e-4, 1e-3, 1e-2)) or not is_in(told - 1e-2)
        assert begins or (told == 0.0 and touches)


def test_bumpers_say_where_something_touches():
    this = around([(0.0, 0.0), (0.0, -0.9)], Senses(bumpers=4))
    assert this.look(1, 0.0, (0.0, 0.0), lies=False) == bytes([0, 0, 0, 1])
    assert this.look(1, 0.0, (3.6, 0.0), lies=False) == bytes([1, 0, 0, 0])
    assert this.look(1, 0.0, (0.0, 2.6), lies=True) == bytes([0, 1, 0, 0])
    assert around([(0.0, 0.0)], Senses(bumpers=4), ()).look(1, 0.0, (0.0, 0.0), lies=False) == bytes(4)


def test_what_no_robot_senses_is_said():
    with pytest.raises(UsageError, match="beams is 361"):
        Senses(beams=361)


@pytest.mark.parametrize(
    "beside, is_readable",
    [
        (struct.pack("<2f", 0.0, math.inf) + b"\0\1", True),
        (struct.pack("<2f", 0.0, math.nan) + b"\0\1", False),
        (struct.pack("<2f", -1.0, 0.0) + b"\0\1", False),
        (struct.pack("<2f", 0.0, 0.0) + b"\0\2", False),
        (struct.pack("<2f", 0.0, 0.0) + b"\0", False),
        (struct.pack("<2f", 0.0, 0.0) + b"\0\0\0", False),
    ],
)
def test_what_no_sensor_says_reaches_no_controller(beside, is_readable):
    class Sees(Controller):
        senses = Senses(beams=2, bumpers=2)

        def on_reading(self, step, t_ms, reading):
            assert self.senses.ranges_m(reading) == (0.0, math.inf)
            assert self.senses.touches(reading) == (False, True)
            return [Command(1.0, 0.0)]

    raw = Reading(1.0, 2.0, 0.0, 0.0, id=1, t=7).encode() + beside
    (act,) = Sees(1).on_input(0, 7, raw)
    assert Command.decode(act.payload).ax_mps2 == is_readable, "else it coasts"


@pytest.fixture
def careful(tmp_path):
    (tmp_path / "careful.py").write_text(CAREFUL)
    return f"{tmp_path / 'careful.py'}:Careful"


def test_robots_that_see_stop_before_a_wall_and_pass_their_audits(careful):
    wall = Box(left_m=30.0, bottom_m=-50.0, right_m=31.0, top_m=200.0)
    scenario = Scenario(
        robots=4,
        duration_s=20.0,
        obstacles=(wall,),
        flock=FlockConfig(c1_beta=1.0, c2_beta=1.0),  # or no scenario has obstacles
        bti=BtiConfig(f_max=1),
        attacks=(AttackSpec(name="hijack", robot=4, at_s=5.0),),
    )
    result = simulate(scenario, controller=find_class(careful, Controller))
    (summary,) = result.summaries
    assert summary["correct_in_safe_mode"] == []
    assert summary["compromised"][0]["safe_mode_s"] is not None
    refused = result.verdicts[result.verdicts["refusal"] > 0]
    assert set(refused["auditee"].tolist()) <= {4}
    assert len(result.verdicts) > len(refused) + 10
    at_x_m = result.positions_m[0, -1, :3, 0]
    assert 24.0 < at_x_m.max() < 30.0, at_x_m


@pytest.mark.long
def test_a_controller_that_sees_can_be_checked(careful):
    assert run_command(["sim", "check", careful]) == 0


@pytest.mark.waits
@pytest.mark.long
@pytest.mark.timeout(300)
def test_robots_that_see_are_processes_too(careful, tmp_path):
    mission = tmp_path / "mission.yaml"
    mission.write_text(
        """robots: 4
grid_step_m: 10
obstacles: [{left_m: 17, bottom_m: -50, right_m: 18, top_m: 50}]
flock: {c1_beta: 1, c2_beta: 1}
bti: {f_max: 1, t_audit_ms: 1000, t_val_ms: 2500, t_control_ms: 600, steps_per_state: 1, delta_ms: 290, skew_ms: 200}
"""
    )
    kept = tmp_path / "kept"
    words = (sys.executable, "-m", "phalanx", "--log-level", "error", "robot", "arena", str(mission), "--duration", "9")
    more = ("--controller", careful, "--keep", str(kept), "--json")
    ended = subprocess.run((*words, *more), capture_output=True, text=True, timeout=200, check=False)
    assert ended.returncode == 0, ended.stderr
    summary = json.loads(ended.stdout)
    assert summary["correct_in_safe_mode"] == []
    assert not any(told["refused"] for told in summary["processes"])
    assert summary["contacts"] == 0
    assert run_command(["robot", "verify", str(kept / "robot-2.log"), "--controller", careful]) == 0
