"""A real robot's process, and what replays its evidence, run where the simulator cannot be imported."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import boards
from robot_folder import write_robot

pytestmark = [pytest.mark.waits]
# Of a Python that notes and refuses each import of what simulates.
WITHOUT = """
import sys
from pathlib import Path

class Refuses:
    def find_spec(self, name, path=None, target=None):
        if name.startswith(("phalanx.world", "phalanx.lab")):
            with Path("refused").open("a") as file:
                file.write(f"{name}\\n")
            raise ImportError(name)

sys.meta_path.insert(0, Refuses())
"""
PHALANX = f"{WITHOUT}from phalanx.cli import main\nmain()"
ONE_BY_ONE = f"""{WITHOUT}from phalanx.cli.main import run_command
for words in sys.argv[1:]:
    assert run_command(words.split()) == 0, words
    print("-----", flush=True)
"""
MISSION = """robots: 4
grid_step_m: 16
d_m: 10
goal_m: [100, 60]
bti: {f_max: 1, t_audit_ms: 1000, t_val_ms: 2500, t_control_ms: 600, steps_per_state: 1, delta_ms: 290, skew_ms: 200}
"""
ENTRIES_BYTES = 200  # some readings and commands
OWN = """
from phalanx.daemon.driver import Driver
from phalanx.robot import Act, Controller, Planner
from phalanx.wire.table import ACCELERATION

class Still(Driver):
    def sense(self):
        return {"x_m": 1.0, "y_m": 2.0, "vx_mps": 0.0, "vy_mps": 0.0}

class North(Planner):
    def advise(self, t_s, position_m, velocity_mps):
        return 0.0, 1.0

class Ahead(Controller):
    def on_recv(self, t_ms, frame):
        pass

    def on_input(self, step, t_ms, reading):
        return [Act(ACCELERATION.encode(id=self.rob_id, t=t_ms, ax_mps2=1.0, ay_mps2=0.0))]

    def encode(self):
        return b""

    def decode(self, encoding):
        pass
"""


def started(folder: Path, *words: str) -> subprocess.Popen[str]:
    command = (sys.executable, "-c", PHALANX, "--log-level", "error", *words)
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def ended(process: subprocess.Popen[str]) -> str:
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return out


def wait_for(process: subprocess.Popen[str], is_there: Callable[[], bool]) -> None:
    until_s = time.monotonic() + 60
    while not is_there():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < until_s
        time.sleep(0.05)


def logged_bytes(log: Path) -> int:
    return len(log.read_bytes().partition(b"\n")[2]) if log.exists() else 0


@pytest.mark.parametrize(
    ("mission", "robot", "to_verify"),
    [
        ("", {}, ()),
        ("controller: guard", {"planner": "own.py:North"}, ()),
        ("", {"controller": "own.py:Ahead"}, ("--controller", "own.py:Ahead")),
        ("controller: tracking", {}, ()),
    ],
    ids=["flock", "guard", "own controller", "protocol"],
)
def test_no_module_of_the_simulator_is_imported(tmp_path, mission, robot, to_verify):
    boards.built("node")  # before a robot waits for it to answer
    write_robot(tmp_path, 2, MISSION + mission, driver="python:own.py:Still", **robot)
    (tmp_path / "own.py").write_text(OWN)
    living = started(tmp_path, "robot", "run", "robot.yaml")
    try:
        wait_for(living, lambda: logged_bytes(tmp_path / "robot-2.log") >= ENTRIES_BYTES)
        living.send_signal(signal.SIGTERM)
        ended(living)
    finally:
        living.kill()
    verify = " ".join(("robot verify log.mcap", *to_verify))
    words = ("robot status robot.yaml", "robot log robot.yaml --out log.mcap", verify)
    looked = subprocess.Popen((sys.executable, "-c", ONE_BY_ONE, *words), cwd=tmp_path, stdout=-1, stderr=-1, text=True)
    status, _, verdict, _ = ended(looked).split("-----\n")
    assert "robot" in status
    assert "honest" in verdict
    assert not (tmp_path / "refused").exists(), (tmp_path / "refused").read_text()


def test_nor_does_a_planner_as_a_process(tmp_path):
    (tmp_path / "mission.yaml").write_text(f"{MISSION}controller: guard\n")
    (tmp_path / "own.py").write_text(OWN)
    advising = started(tmp_path, "robot", "advise", "mission.yaml", "own.py:North", "unix:advice")
    try:
        wait_for(advising, (tmp_path / "advice").exists)
        advising.send_signal(signal.SIGTERM)
        ended(advising)
    finally:
        advising.kill()
    assert not (tmp_path / "refused").exists()


def test_the_arena_is_what_needs_it(tmp_path):
    arena = started(tmp_path, "robot", "arena", "--robots", "4", "--duration", "1")
    arena.communicate(timeout=120)
    assert arena.returncode != 0
    assert "phalanx.lab" in (tmp_path / "refused").read_text()
