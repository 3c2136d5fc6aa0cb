"""A robot of ROS 2 on a mission: real nodes, real DDS on loopback, a building and a lidar of the example's."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from commands import called

pytestmark = [pytest.mark.long, pytest.mark.timeout(300)]
ROOT = Path(__file__).parent.parent
LIDAR = "360,720,10,0.01"
MAP = """size: [12, 6]
start_pose: [1.5, 3.0, 0.0]
walls:
- [0, 0, 12, 0]
- [12, 0, 12, 6]
- [12, 6, 0, 6]
- [0, 6, 0, 0]
- [4, 0, 4, 2.4]
- [4, 3.6, 4, 6]
- [8, 0, 8, 1.4]
- [8, 2.6, 8, 6]
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "map.yaml").write_text(MAP)
    where = str(tmp_path / "rooms.phxm")
    made = called("mission", "build", "--map", str(tmp_path / "map.yaml"), "--lidar", LIDAR, "--out", where)
    assert made.returncode == 0, made.stderr
    return tmp_path


@pytest.fixture
def building(folder):
    """What starts the robot; its environment."""
    environment = os.environ | {
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(folder / "ros"),
    }
    started: list[subprocess.Popen[str]] = []

    def begun(*more):
        script = str(ROOT / "examples" / "ros2_building.py")
        words = (sys.executable, script, str(folder / "map.yaml"), "--lidar", LIDAR, *more)
        started.append(subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True))
        return started[0], environment

    yield begun
    for each in started:
        each.kill()
        each.wait()


def walking(folder, environment):
    phalanx = (sys.executable, "-m", "phalanx", "--log-level", "warning", "mission", "ros2")
    words = (*phalanx, str(folder / "rooms.phxm"), "--start", "1.5,3,0", "--namespace", "r1", "--json")
    return subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("more", [(), ("--clockwise",)], ids=["as REP 103", "clockwise"])
def test_a_mission_is_lived_by_scan_and_odometry(folder, building, more):
    robot, environment = building("--rate", "2", *more)
    walk = walking(folder, environment)
    said, told = walk.communicate(timeout=120)
    robot.send_signal(signal.SIGTERM)
    true = json.loads(robot.communicate(timeout=10)[0])
    lived = json.loads(said)
    assert (walk.returncode, lived["completed"]) == (0, True), told
    assert len(lived["decoded"]) == lived["nodes"] >= 5
    assert lived["not_validated"] == []
    # It went through both doorways, and knows where it is.
    assert true[0] > 8
    assert math.dist(lived["pose"][:2], true[:2]) < 0.25


def test_who_hears_no_scans_stands_and_goes_on_when_there_are_some(folder, building):
    robot, environment = building()
    walk = walking(folder, environment)
    lines = [walk.stderr.readline() for _ in range(2)]
    assert all("decoded" in line for line in lines), lines
    robot.send_signal(signal.SIGSTOP)
    line = walk.stderr.readline()
    while "decoded" in line:  # what was under way
        line = walk.stderr.readline()
    assert "the robot is waiting: no messages on /r1/scan" in line
    robot.send_signal(signal.SIGCONT)
    while "decoded" not in (line := walk.stderr.readline()):
        assert line, "it goes on"
    walk.send_signal(signal.SIGINT)
    lived = json.loads(walk.communicate(timeout=20)[0])
    assert (walk.returncode, lived["completed"]) == (1, False)
    assert lived["decoded"]
