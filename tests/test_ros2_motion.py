"""What a robot behind a guard on ROS 2 computes, without ROS 2; and what is said where that is not installed."""

from __future__ import annotations

import json
import math
import sys

import pytest

from phalanx.cli.main import run_command
from phalanx.daemon.ros2 import ahead
from phalanx.daemon.ros2.ahead import Place
from phalanx.daemon.ros2.diagnostics import ERROR, OK, WARN, told_of

AHEAD_M, STEP_S = 0.3, 1e-6


@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, -2.5, math.pi])
@pytest.mark.parametrize("twist", [(1.0, 0.0), (0.0, 1.5), (-0.7, -2.0)])
def test_the_point_moves_as_the_robot_under_it_does(yaw_rad, twist):
    """Against where it is a moment later, of a robot that has driven and turned so."""
    here = Place(x_m=3.0, y_m=-2.0, yaw_rad=yaw_rad)
    then = here.of(Place(x_m=twist[0] * STEP_S, yaw_rad=twist[1] * STEP_S))
    x_m, y_m = ahead.point_of(here, AHEAD_M)
    later_x_m, later_y_m = ahead.point_of(then, AHEAD_M)
    moves = ahead.velocity_of(*twist, yaw_rad, AHEAD_M)
    assert moves == pytest.approx(((later_x_m - x_m) / STEP_S, (later_y_m - y_m) / STEP_S), abs=1e-4)
    assert ahead.twist_of(moves, yaw_rad, AHEAD_M) == pytest.approx(twist)


def test_a_place_in_a_frame_that_is_turned_itself():
    odom = Place(x_m=10.0, y_m=5.0, yaw_rad=math.pi / 2)
    base = odom.of(Place(x_m=2.0, y_m=1.0, yaw_rad=0.5))
    assert (base.x_m, base.y_m, base.yaw_rad) == pytest.approx((9.0, 7.0, math.pi / 2 + 0.5))
    assert ahead.yaw_of(0.0, 0.0, math.sin(0.6), math.cos(0.6)) == pytest.approx(1.2)


def test_diagnostics_tell_of_shield_and_verdicts():
    state = {"tokens": [{"auditor": 2, "left_s": 1.25}], "tokens_needed": 1, "safe_mode": False, "given": {4: 7}}
    refused = [{"auditee": 3, "reason": "output wrong", "times": 2}]
    shield, verdicts = told_of(state | {"refused": refused})
    assert (shield.level, shield.values) == (OK, {"robot 2": "1.2 s"})
    assert (verdicts.level, verdicts.values) == (WARN, {"robot 3: output wrong": 2, "robot 4: tokens given": 7})
    shield, verdicts = told_of(state | {"refused": [], "tokens_needed": 2})
    assert (shield.level, verdicts.level) == (WARN, OK)
    assert told_of(state | {"refused": [], "safe_mode": True})[0].level == ERROR


def test_who_has_no_ros_is_told_what_to_install(tmp_path, capsys, monkeypatch):
    radio = {"here": "127.0.0.1:4410", "peers": ["127.0.0.1:4411"]}
    path = tmp_path / "robot.yaml"
    path.write_text(json.dumps({"robot": 1, "mission": "m", "key": "k", "driver": "ros2", "radio": radio}))
    monkeypatch.setitem(sys.modules, "rclpy", None)
    assert run_command(["robot", "ros2", str(path)]) == 2
    said = capsys.readouterr().err
    assert "ROS 2 is not installed" in said
    assert "pip install 'phalanx-swarm[ros2]'" in said
