"""Motors after each end of a robot's process, and while its sensors say nothing: real processes and signals."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from commands import ROOT, run, start
from robot_folder import write_robot
from waiting import wait_until

pytestmark = [pytest.mark.waits, pytest.mark.timeout(120)]
BENCH = ROOT / "deploy" / "robot"
STANDS_S, WATCHDOG_S = 0.5, 0.5  # the daemon's promise, and that of BENCH's motors
PERIOD_S = 1.0  # of MISSION's readings: long, as a busy machine must not be late by δ
DRIVES, STANDS = "50 50", "0 0"
# Nobody vouches for it: it drives until T_val is over.
MISSION = f"""controller: wheels
robots: 3
grid_step_m: 0.6
area_m: [2, 2]
gateway_key: {"ab" * 32}
operator_key: {"cd" * 32}
bti: {{f_max: 1, t_control_ms: 1000, delta_ms: 490, steps_per_state: 2, t_audit_ms: 7000, t_val_ms: 18000}}
"""
# The trouble is what stands in a file, so that a test begins and ends it.
OWN = """
import threading
import time
from pathlib import Path
from phalanx.daemon.driver import Driver
from phalanx.robot import Act, Controller
from phalanx.wire.table import WHEELS_COMMAND
{imports}

HERE = Path(__file__).parent

def trouble(where):
    said = (HERE / "trouble").read_text()
    if said == f"{{where}} raises":
        raise ValueError("a loose wire")
    if said == f"{{where}} hangs":
        (HERE / "hangs").touch()
        while (HERE / "trouble").read_text() == said:
            time.sleep(0.01)
    return said

class Base({base}):
    def sense(self):
        said = trouble("sense")
        if said == "no reading":
            raise NoReading("odometry lost")
        if said == "no device":
            raise OSError(5, "no answer")
        x_mm = float("nan") if said == "nan" else 1000.0
        return {{"x_mm": x_mm, "y_mm": 1000.0, "direction_deg": 0.0}}
{moves}

class Go(Controller):
    def on_recv(self, t_ms, frame):
        pass

    def on_input(self, step, t_ms, reading):
        trouble("controller")
        return [Act(WHEELS_COMMAND.encode(id=self.rob_id, t=t_ms, left=50, right=50, red=0, green=0, blue=0))]

    def encode(self):
        return b""

    def decode(self, encoding):
        pass
"""
MOVES = """
    def drive(self, command):
        trouble("drive")
        self.show(f"{command['left']} {command['right']}")

    def stop(self):
        self.show("0 0")

    def show(self, wheels):
        new = HERE / f"wheels.{threading.get_ident()}"  # stop may come from two threads at once
        new.write_text(wheels)
        new.rename(HERE / "wheels")
"""


class Robot:
    """A robot's process, of a folder of its own."""

    def __init__(self, folder: Path, wheels: str = "wheels") -> None:
        self.path, self.folder = folder / "robot.yaml", folder
        self._wheels = folder / wheels
        nowhere = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
        self.process = start("robot", "run", str(self.path), stderr=subprocess.PIPE, **nowhere)

    @property
    def wheels(self) -> str:
        return self._wheels.read_text().strip() if self._wheels.exists() else ""

    def waits(self, wheels: str, within_s: float) -> None:
        until_s = time.monotonic() + within_s
        while self.wheels != wheels:
            assert time.monotonic() < until_s, f"wheels {self.wheels} after {within_s} s, {self.status()}"
            time.sleep(0.005)

    def has(self, trouble: str) -> None:
        (self.folder / "trouble.new").write_text(trouble)
        (self.folder / "trouble.new").rename(self.folder / "trouble")

    def hangs(self) -> None:
        """Wait until a call hangs."""
        until_s = time.monotonic() + 5
        while not (self.folder / "hangs").exists():
            assert time.monotonic() < until_s
            time.sleep(0.001)

    def status(self) -> str:
        return next(
            line for line in run("robot", "status", str(self.path)).stdout.splitlines() if line.startswith("state")
        )

    def ends(self, within_s: float) -> tuple[int, str]:
        code = self.process.wait(within_s)
        return code, self.process.stderr.read()


@contextlib.contextmanager
def driving(folder: Path, *, bench: bool = False):
    """A robot that drives."""
    own = {"trusted": "process:nodes.flash", "driver": "python:own.py:Base", "controller": "own.py:Go"}
    write_robot(folder, 1, MISSION, **own)
    imports = "from base import Bench" if bench else "from phalanx.daemon.driver import NoReading"
    (folder / "own.py").write_text(
        OWN.format(imports=imports, base="Bench" if bench else "Driver", moves="" if bench else MOVES)
    )
    for name in ("base.py", "motors.py"):
        shutil.copy(BENCH / name, folder / name)
    (folder / "trouble").write_text("none")
    robot = Robot(folder, "motors-1.txt" if bench else "wheels")
    try:
        robot.waits(DRIVES, 60)
        yield robot
    finally:
        robot.process.kill()
        robot.process.wait()


def nodes_of(robot: Robot) -> int:
    """The process of its trusted nodes."""
    children = Path(f"/proc/{robot.process.pid}/task/{robot.process.pid}/children").read_text().split()
    (pid,) = (int(each) for each in children if "node" in Path(f"/proc/{each}/cmdline").read_text())
    return pid


@pytest.mark.parametrize(
    ("number", "trouble"),
    [(number, "none") for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT)]
    + [(signal.SIGTERM, f"{where} hangs") for where in ("sense", "drive", "controller")],
)
def test_after_each_signal_motors_stand_and_the_process_ends(tmp_path, number, trouble):
    with driving(tmp_path) as robot:
        robot.has(trouble)
        if "hangs" in trouble:
            robot.hangs()
        robot.process.send_signal(number)
        robot.waits(STANDS, STANDS_S)
        code, said = robot.ends(5)
        assert "Traceback" not in said
        assert (code, robot.wheels) == (int(trouble == "controller hangs"), STANDS)


@pytest.mark.parametrize("where", ["sense", "drive", "controller"])
def test_motors_stand_before_an_exit_on_error_and_the_status_names_it(tmp_path, where):
    says = "own.py:15: ValueError: a loose wire"
    with driving(tmp_path) as robot:
        robot.has(f"{where} raises")
        robot.waits(STANDS, STANDS_S + 2 * PERIOD_S)  # it begins at the next reading
        code, said = robot.ends(10)
        assert code == 2
        assert says in said
        assert says in robot.status()
        assert robot.wheels == STANDS


def test_motors_stand_when_trusted_nodes_are_gone(tmp_path):
    with driving(tmp_path) as robot:
        os.kill(nodes_of(robot), signal.SIGKILL)
        robot.waits(STANDS, STANDS_S)
        assert robot.ends(10)[0] == 1
        assert "has closed the line" in robot.status()


def test_motors_stand_while_trusted_nodes_or_a_controller_do_not_answer(tmp_path):
    with driving(tmp_path) as robot:
        robot.has("controller hangs")
        robot.waits(STANDS, STANDS_S + 2 * PERIOD_S)  # it begins at the next reading
        robot.has("none")
        robot.waits(DRIVES, 5)
        os.kill(nodes_of(robot), signal.SIGSTOP)
        robot.waits(STANDS, STANDS_S + 2 * PERIOD_S)
        assert robot.ends(10)[0] == 1


@pytest.mark.parametrize(
    ("trouble", "why"),
    [
        ("nan", "x_mm is nan"),
        ("no reading", "odometry lost"),
        ("no device", "no answer"),
        # Half of δ is waited for what hangs, so that a busy machine is soon too late.
        pytest.param("sense hangs", "sense has not returned", marks=pytest.mark.alone),
        pytest.param("drive hangs", "drive has not returned", marks=pytest.mark.alone),
    ],
)
def test_without_a_reading_motors_stand_and_the_robot_goes_on_when_there_is_one(tmp_path, trouble, why):
    with driving(tmp_path) as robot:
        robot.has(trouble)
        robot.waits(STANDS, STANDS_S + 2 * PERIOD_S)  # the next reading, and how long it may take
        time.sleep(1.5)
        assert robot.wheels == STANDS
        # A robot writes its status each second.
        told = rf"running, but standing still: no reading for [1-9]\d*\.\d s: .*{why}"
        wait_until(lambda: re.search(told, robot.status()))
        robot.has("none")
        robot.waits(DRIVES, 5)
        robot.process.send_signal(signal.SIGTERM)
        assert robot.ends(5)[0] == 0
        verified = run("robot", "verify", f"{tmp_path / 'robot-1.log'}", "--controller", f"{tmp_path / 'own.py'}:Go")
        assert "honest" in verified.stdout, verified


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_who_is_killed_outright_has_motors_with_a_watchdog(tmp_path, number):
    with driving(tmp_path, bench=True) as robot:
        robot.process.send_signal(number)
        robot.waits(STANDS, WATCHDOG_S + 0.3)
        assert robot.wheels == STANDS
