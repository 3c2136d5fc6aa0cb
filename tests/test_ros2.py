"""Robots of ROS 2 behind guards: real nodes, real DDS on loopback, daemons with trusted processes."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from phalanx.daemon.state import read_state
from phalanx.lab.arena.places import free_ports
from phalanx.net.keyring import Keys
from phalanx.net.mission_key import encode_mission_key_file
from phalanx.wire.table import BOARD

pytestmark = [pytest.mark.long, pytest.mark.timeout(300)]
ROOT = Path(__file__).parent.parent
WORLD = (sys.executable, str(ROOT / "examples" / "ros2_world.py"))
# A machine that does other things too makes readings late: those who may, go before the others.
GUARD = ("chrt", "--rr", "1", sys.executable, "-m", "phalanx", "--log-level", "error", "robot", "ros2")
APART_M, CONTACT_M, ENVELOPE_M, AHEAD_M, BRAKE_S = 8.0, 0.6, 1.0, 0.2, 1.0
HIJACKED_S = 5
T_VAL_S, P_CHECK_S, SCHEDULING_S = 2.5, 0.1, 1.0
MISSION = """robots: {robots}
formation: line
grid_step_m: 8
controller: guard
goal_m: [0, 6]
guard: {{speed_mps: 1.0, accel_mps2: 1.0, apart_m: 1.0, forget_ms: 3000}}
bti: {{f_max: 1, t_audit_ms: 1000, t_val_ms: 2500, t_control_ms: 250, steps_per_state: 1, delta_ms: 120, skew_ms: 200}}
attacks: {attacks}
"""


@pytest.fixture
def environment(tmp_path):
    # Domains of other tests, on this or another machine, are none of ours.
    return os.environ | {
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(tmp_path / "ros"),
    }


def laid_out(folder, robots, attacks="[]"):
    """A file for each robot, with all that it names."""
    keys, ports = Keys.new("test"), free_ports(robots)
    (folder / "mission.yaml").write_text(MISSION.format(robots=robots, attacks=attacks))
    for robot in range(1, robots + 1):
        board = BOARD.encode(id=robot, master=keys.provision(robot, "2026-01-01"))
        (folder / f"board-{robot}.bin").write_bytes(board)
        here, *peers = (f"127.0.0.1:{port}" for port in ports[robot - 1 :] + ports[: robot - 1])
        said = {
            "robot": robot,
            "mission": "mission.yaml",
            "key": "key.json",
            "board": f"board-{robot}.bin",
            "trusted": f"process:trusted-{robot}.flash",
            "driver": "ros2",
            "radio": {"here": here, "peers": peers or ["127.0.0.1:9"]},
        }
        (folder / f"robot-{robot}.yaml").write_text(json.dumps(said))
    (folder / "key.json").write_bytes(encode_mission_key_file(*keys.issue(), {}))


@contextlib.contextmanager
def living(environment, *commands):
    """These run; they are told to end, and have."""
    with contextlib.ExitStack() as stack:
        for words in commands:
            process = stack.enter_context(subprocess.Popen(words, env=environment))
            stack.callback(process.send_signal, signal.SIGTERM)
        yield


def guards(folder, robots):
    for robot in range(1, robots + 1):
        said = f"odom_in_map:=[{APART_M * (robot - 1)}, 0.0, {1.5707963}]"
        yield (*GUARD, str(folder / f"robot-{robot}.yaml"), "--namespace", f"r{robot}", "--", "--ros-args", "-p", said)


def world(environment, robots, duration_s):
    words = (*WORLD, "bases", "--robots", str(robots), "--duration", str(duration_s))
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=150, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_of_four_robots_one_is_taken_over_and_stopped_and_the_others_reach_their_goals(tmp_path, environment):
    laid_out(tmp_path, 4, f"[{{name: hijack, robot: 3, at_s: {HIJACKED_S}}}]")
    with living(environment, *guards(tmp_path, 4), (*WORLD, "planners")):
        seen = world(environment, 4, 22)
    states = {robot: read_state(tmp_path / f"robot-{robot}.json") for robot in range(1, 5)}
    assert [state["safe_mode"] for state in states.values()] == [False, False, True, False]
    refusals = {(each["auditee"], each["reason"]) for state in states.values() for each in state["refused"]}
    assert refusals == {(3, "output wrong")}
    moved_s = seen["robots"]["3"]["moved_s"]
    assert HIJACKED_S < moved_s < HIJACKED_S + T_VAL_S + P_CHECK_S + SCHEDULING_S + BRAKE_S
    # It left its way, and was on it to another.
    assert abs(seen["robots"]["3"]["at_m"][0] - 2 * APART_M) > CONTACT_M
    assert seen["nearest_m"] > CONTACT_M
    assert all(seen["robots"][robot]["reached_s"] for robot in "124")


def test_a_planner_that_is_taken_over_touches_nobody_past_its_guard(tmp_path, environment):
    laid_out(tmp_path, 4)
    with living(environment, *guards(tmp_path, 4), (*WORLD, "planners", "--hijacked", "3")):
        seen = world(environment, 4, 22)
    assert not any(read_state(tmp_path / f"robot-{robot}.json")["safe_mode"] for robot in range(1, 5))
    assert seen["robots"]["3"]["moved_s"] > 0
    assert seen["nearest_m"] > ENVELOPE_M - 2 * AHEAD_M
    assert seen["robots"]["1"]["reached_s"]


def the_page(folder):
    """The files of its first example, as they are written there; nobody is there to type a passphrase."""
    page = (ROOT / "docs" / "guides" / "ros2.md").read_text()
    blocks = re.findall(
        r"^`(mission.yaml|lay_out.sh|bases.py|start.sh)`.*?^```[a-z]+\n(.*?)^```$", page, re.MULTILINE | re.DOTALL
    )
    assert [name for name, _ in blocks] == ["mission.yaml", "lay_out.sh", "bases.py", "start.sh"]
    for name, text in blocks:
        quiet = re.sub(r"^( *phalanx keys .*)$", r"\1 --passphrase-file words", text, flags=re.MULTILINE)
        (folder / name).write_text(quiet if name == "lay_out.sh" else text)
    (folder / "words").write_text("some words that nobody guesses\n")
    (folder / "phalanx").write_text(f'#!/bin/sh\nexec {sys.executable} -m phalanx "$@"\n')
    (folder / "phalanx").chmod(0o755)


@contextlib.contextmanager
def group(environment, folder, *words):
    """A process and all that it starts, which Ctrl-C ends."""
    process = subprocess.Popen(
        words, env=environment, cwd=folder, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        yield process
    finally:
        os.killpg(process.pid, signal.SIGINT)
        process.communicate(timeout=20)


def comes_to(bases, metres):
    """Waits until all three bases are so far ahead."""
    for line in bases.stdout:
        if all(float(each) >= metres for each in re.findall(r"r\d (\S+) m", line)):
            return
    raise AssertionError("it ended")


def test_the_pages_first_example_runs_and_robots_stand_without_odometry(tmp_path, environment):
    the_page(tmp_path)
    environment |= {"PATH": f"{tmp_path}:{environment['PATH']}"}
    subprocess.run(("sh", "lay_out.sh"), env=environment, cwd=tmp_path, check=True)
    with group(environment, tmp_path, "sh", "start.sh"):
        with group(environment, tmp_path, sys.executable, "bases.py") as bases:
            comes_to(bases, 1.0)
        time.sleep(3)
        for robot in (1, 2, 3):
            missing = read_state(tmp_path / f"robot-{robot}.json")["no_reading"]
            assert missing["why"] == f"no odometry on /r{robot}/odom"
            assert missing["for_s"] > 1
        with group(environment, tmp_path, sys.executable, "bases.py") as bases:
            comes_to(bases, 1.0)
    for robot in (1, 2, 3):
        state = read_state(tmp_path / f"robot-{robot}.json")
        assert (state["safe_mode"], state["why_ended"]) == (False, "it was told to end")


def test_without_guards_it_runs_into_another(environment):
    with living(environment, (*WORLD, "planners", "--hijacked", "3", "--topic", "cmd_vel", "--at", "1")):
        assert world(environment, 4, 14)["nearest_m"] < CONTACT_M
