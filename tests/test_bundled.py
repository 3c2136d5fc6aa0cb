"""A bundled controller is one file: with it in its folder a scenario runs it, auditors replay it, and kernels know it."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from phalanx import kernel as kernel_module
from phalanx.config.flock import FlockConfig
from phalanx.errors import UsageError
from phalanx.robot.controllers import dispatch
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.table import WHEELS_COMMAND
from phalanx.world.audited.body import POINT_MASS, WHEELS, driven_by
from phalanx.world.scenarios.run import Run

SRC = Path(kernel_module.__file__).parent
DRIFT = '''
"""Drifts to the right, and counts how often: the least that a controller can be."""

import numpy as np

from phalanx.kernel import kernel
from phalanx.robot.controllers.declaration import Declaration
from phalanx.arrays import Params
from phalanx.wire.fields import Row, get_u32, put_f32, put_head, put_u32
from phalanx.wire.record import Field, Record
from phalanx.wire.table import ACCELERATION, ENTRY_ACMD, KIND_ACCELERATION, SENSOR, STATE

MEMORY = Record("drift_memory", (Field("steps", "u32", ""),), "how often it drifted")
STEPS = MEMORY.at("steps")
CAPACITY = MEMORY.size
LENGTH = ACCELERATION.size
AX, AY = map(ACCELERATION.at, ("ax_mps2", "ay_mps2"))


def params(config):
    return np.array([0.25])


CONTROLLER = Declaration(reads=SENSOR, commands=ACCELERATION, says=STATE, remembers=(MEMORY,), params=params)


@kernel
def capacity(_params: Params) -> int:
    return CAPACITY


@kernel
def size(_state: Row) -> int:
    return CAPACITY


@kernel
def begin(_params: Params, _rob_id: int, state: Row) -> int:
    put_u32(state, STEPS, 0)
    return CAPACITY


@kernel
def is_encoding(_params: Params, _rob_id: int, _state: Row, length: int) -> bool:
    return length == CAPACITY


@kernel
def on_recv(_params: Params, _rob_id: int, _t_ms: int, _frame: Row, _length: int, _state: Row) -> int:
    return CAPACITY


@kernel
def on_input(
    params: Params, rob_id: int, _step: int, t_ms: int, _reading: Row, _length: int, state: Row, out: Row
) -> int:
    put_u32(state, STEPS, get_u32(state, STEPS) + 1)
    at = put_head(out, 0, ENTRY_ACMD, LENGTH, KIND_ACCELERATION, rob_id, t_ms)
    put_f32(out, at + AX, params[0])
    put_f32(out, at + AY, 0.0)
    return at + LENGTH
'''
RUN = """
import json
from phalanx.config import BtiConfig
from phalanx.world.scenarios.run import Run
from phalanx.scenarios.scenario import Scenario

run = Run(Scenario(controller="drift", robots=4, duration_s=7.0, bti=BtiConfig(f_max=1)))
began = run.world.pos.copy()
run.advance(7.0)
moved = run.world.pos - began
robot = run.world.fleet.robot
print(json.dumps({
    "moved": moved.tolist(),
    "passed": int(robot["audits_passed"].sum()),
    "refused": int(robot["audits_refused"].sum()),
    "booted": int(robot["booted"].sum()),
    "safe": int(run.world.safe.sum()),
}))
"""


def python(code: str, root: Path, **more: str) -> str:
    env = {"PYTHONPATH": str(root), "PATH": os.environ["PATH"], **more}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env)
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.fixture
def copy(tmp_path):
    folder = tmp_path / "phalanx"
    shutil.copytree(SRC, folder, ignore=shutil.ignore_patterns("__pycache__", "pages"))
    return folder


def test_a_controller_in_a_file_of_its_own_runs_in_a_scenario_and_is_audited(copy, tmp_path):
    (copy / "robot" / "controllers" / "bundled" / "drift.py").write_text(DRIFT)
    # Uncompiled, which is the same bytes: it is not in the compiled kernels.
    told = json.loads(python(RUN, tmp_path, PHALANX_PURE="1"))
    assert all(x_m == pytest.approx(6.0, abs=0.7) and y_m == 0.0 for x_m, y_m in told["moved"])
    assert told["passed"] >= 4
    assert told["booted"] == told["refused"] == told["safe"] == 0


def test_a_controller_that_was_added_after_compiling_is_refused_in_a_line(copy, tmp_path):
    (copy / "robot" / "controllers" / "bundled" / "drift.py").write_text(DRIFT)
    env = {"PYTHONPATH": str(tmp_path), "PATH": os.environ["PATH"]}
    words = [sys.executable, "-m", "phalanx", "sim", "run", "flock-12", "--duration", "1"]
    run = subprocess.run(words, capture_output=True, text=True, env=env, check=False)
    assert run.returncode == 1
    error, _hint = run.stderr.splitlines()
    assert re.search(r"the compiled kernels have no phalanx\.robot\.controllers\.bundled\.drift\.\w+$", error)


def test_each_bundled_controller_has_a_number_a_body_and_kernels():
    assert set(dispatch.BUNDLED) == {"flock", "guard", "wheels"}
    assert [driven_by(each) for each in dispatch.BUNDLED.values()] == [POINT_MASS, POINT_MASS, WHEELS]
    params = dispatch.BUNDLED["flock"].params(FlockConfig(n_max=2))
    assert dispatch.capacity(dispatch.NUMBERS["flock"], params) == 18 + 2 * 26
    assert dispatch.capacity(0, params) == 0


def test_a_body_that_there_is_not_is_refused():
    with pytest.raises(UsageError, match="no body has readings sensor and commands wheels_command"):
        driven_by(replace(dispatch.BUNDLED["flock"], commands=WHEELS_COMMAND))


def test_a_controller_that_waits_for_orders_is_not_a_scenarios():
    with pytest.raises(UsageError, match="wheels waits for orders"):
        Run(Scenario(controller="wheels"))
