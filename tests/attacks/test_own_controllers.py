"""A researcher's controller in plain Python is protected like a bundled one."""

from __future__ import annotations

import importlib.util
import random
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from trials import run, scenario

from phalanx.bti.refusal import Refusal
from phalanx.robot.adversary.harm import ASTRAY
from phalanx.robot.controllers import dispatch
from phalanx.robot.controllers.compiled import compiled
from phalanx.robot.controllers.flock_law import flock_params
from phalanx.robot.controllers.python_controller import Act, Controller, Send
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.wire.table import ACCELERATION, STATE
from phalanx.world.scenarios.run import Run

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_controller.py"


def advanced(made, controller) -> Run:
    running = Run(made, controller)
    running.advance(made.duration_s)
    return running


def test_the_example_stops_its_liar_and_nobody_else():
    child = subprocess.run([sys.executable, str(EXAMPLE)], capture_output=True, text=True, timeout=120)
    assert child.returncode == 0, child.stderr
    lied, stopped = child.stdout.splitlines()
    began_s, stopped_s = (float(word) for word in re.findall(r"\d+\.\d+", lied))
    assert 10.0 <= began_s < stopped_s <= began_s + 10.101
    assert stopped == "honest robots stopped: [], for want of a quorum: []"
    assert len(EXAMPLE.read_text().splitlines()) < 60


def test_the_bundled_flock_as_a_python_controller_flies_the_same_flight():
    """Logged, audited and replayed in Python, attack included."""
    made = scenario("hardened", AttackSpec(name="hijack", at_s=8.0), end_s=22, robots=10)
    own = advanced(made, compiled(dispatch.NUMBERS["flock"], flock_params(made.flock)))
    bundled = run(made)
    np.testing.assert_array_equal(own.positions_m, bundled.positions_m)
    assert own.summary()["compromised"] == bundled.summary()["compromised"]
    assert own.summary()["correct_in_safe_mode"] == own.summary()["without_quorum"] == []
    assert {why for *_, auditee, why in own.new_verdicts() if auditee not in own.compromised} == {Refusal.NONE}


def credulous():
    """The example's controller, and the same without its look at what liars send."""
    spec = importlib.util.spec_from_file_location("own_controller", EXAMPLE)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)

    class Credulous(example.GoThere):
        def on_recv(self, t_ms, packet):
            if len(packet) == STATE.size:
                _, rob_id, _, x_m, y_m, _, _ = STATE.form.unpack(packet)
                self.memory = example.Memory(rob_id, x_m, y_m)

        def on_reading(self, step, t_ms, at):
            command, *states = super().on_reading(step, t_ms, at)
            wish = ACCELERATION.form.pack(ACCELERATION.tag, self.rob_id, t_ms, command.ax_mps2, command.ay_mps2)
            return [Act(wish), *states]

    return example.GoThere, Credulous


def test_nan_leads_astray_whoever_computes_with_it():
    """So the attack bites, where a controller does not drop such numbers."""
    liar = AttackSpec(name="nan", at_s=5.0, robot=1)
    for controller, least_m, most_m in zip(credulous(), (0.0, 1.0), (1e-9, 1e9)):
        beside, attacked = (advanced(scenario("none", *liars, end_s=20), controller) for liars in ((), (liar,)))
        harm_m = ASTRAY.of(attacked.robots[0], attacked, beside)
        assert least_m <= harm_m <= most_m


class Plain(Controller):
    """Stands still."""

    def encode(self):
        return b""

    def decode(self, encoding):
        assert not encoding

    def on_recv(self, t_ms, packet):
        pass

    def on_input(self, step, t_ms, reading):
        return [Act(ACCELERATION.encode(id=self.rob_id, t=t_ms, ax_mps2=0.0, ay_mps2=0.0))]


class Chancy(Plain):
    def on_input(self, step, t_ms, reading):
        return [Send(bytes([1]) + random.randbytes(8))] if step % 6 == 0 else []


def test_a_controller_that_uses_chance_is_refused_to_the_last_robot():
    ended = advanced(scenario("hardened", robots=6, end_s=12), Chancy)
    reasons = Counter(why for *_, why in ended.new_verdicts())
    assert set(reasons) == {Refusal.OUTPUT_WRONG}
    assert ended.in_safe_mode.all()


def test_a_controller_that_raises_on_a_log_refuses_it_and_no_more():
    made = scenario("hardened", robots=6, end_s=9)
    caught = advanced(made, Plain)
    assert {why for *_, why in caught.new_verdicts()} == {Refusal.NONE}
    for robot in caught.robots.values():
        robot.make_controller = Raising
    caught.advance(12)
    assert {why for *_, why in caught.new_verdicts()} == {Refusal.CONTROLLER_FAILED}


class Raising(Plain):
    def on_input(self, step, t_ms, reading):
        raise ZeroDivisionError
