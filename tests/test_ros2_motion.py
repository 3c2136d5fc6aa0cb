"""What a robot behind a guard on ROS 2 computes, without ROS 2; and what is said where that is not installed."""

from __future__ import annotations

import json
import math
import sys
from types import SimpleNamespace

import pytest

from phalanx.bridges.ros2 import geometry
from phalanx.bridges.ros2.diagnostics import ERROR, ODOM_IN_MAP, OK, WARN, place_in, told_of
from phalanx.bridges.ros2.geometry import Area, Place, pose_of, steered
from phalanx.bridges.ros2.sweep import Track, beams_of
from phalanx.cli.main import run_command
from phalanx.errors import UsageError
from phalanx.robot import Point

AHEAD_M, STEP_S = 0.3, 1e-6


@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, -2.5, math.pi])
@pytest.mark.parametrize("twist", [(1.0, 0.0), (0.0, 1.5), (-0.7, -2.0)])
def test_the_point_moves_as_the_robot_under_it_does(yaw_rad, twist):
    """Against where it is a moment later, of a robot that has driven and turned so."""
    here = Place(x_m=3.0, y_m=-2.0, yaw_rad=yaw_rad)
    then = here.of(Place(x_m=twist[0] * STEP_S, yaw_rad=twist[1] * STEP_S))
    x_m, y_m = geometry.point_of(here, AHEAD_M)
    later_x_m, later_y_m = geometry.point_of(then, AHEAD_M)
    moves = geometry.velocity_of(*twist, yaw_rad, AHEAD_M)
    assert moves == pytest.approx(((later_x_m - x_m) / STEP_S, (later_y_m - y_m) / STEP_S), abs=1e-4)
    assert geometry.twist_of(moves, yaw_rad, AHEAD_M) == pytest.approx(twist)


def test_a_place_in_a_frame_that_is_turned_itself():
    odom = Place(x_m=10.0, y_m=5.0, yaw_rad=math.pi / 2)
    base = odom.of(Place(x_m=2.0, y_m=1.0, yaw_rad=0.5))
    assert (base.x_m, base.y_m, base.yaw_rad) == pytest.approx((9.0, 7.0, math.pi / 2 + 0.5))
    turned = SimpleNamespace(x=0.0, y=0.0, z=math.sin(0.6), w=math.cos(0.6))
    place = geometry.place_of(SimpleNamespace(position=SimpleNamespace(x=1.0, y=2.0), orientation=turned))
    assert (place.x_m, place.y_m, place.yaw_rad) == pytest.approx((1.0, 2.0, 1.2))


def test_diagnostics_tell_of_shield_and_verdicts():
    state = {
        "tokens": [{"auditor": 2, "left_s": 1.25}],
        "tokens_needed": 1,
        "safe_mode": False,
        "no_reading": None,
        "given": [{"auditee": 4, "times": 7}],
    }
    refused = [{"auditee": 3, "reason": "output wrong", "times": 2}]
    place = Place(x_m=8.0, yaw_rad=0.1)
    shield, verdicts = told_of(state | {"refused": refused}, place)
    assert (shield.level, shield.values) == (OK, {ODOM_IN_MAP: "8.0, 0.0, 0.1", "robot 2": "1.2 s"})
    assert place_in(shield.values[ODOM_IN_MAP]) == place
    assert (verdicts.level, verdicts.values) == (WARN, {"robot 3: output wrong": 2, "robot 4: tokens given": 7})
    shield, verdicts = told_of(state | {"refused": [], "tokens_needed": 2}, place)
    assert (shield.level, verdicts.level) == (WARN, OK)
    missing = {"for_s": 1.24, "why": "no odometry on odom"}
    stands = told_of(state | {"refused": [], "no_reading": missing}, place)[0]
    assert (stands.level, stands.message) == (WARN, "no reading for 1.2 s: no odometry on odom")
    stopped = told_of(state | {"refused": [], "safe_mode": True, "why_stopped": "nobody is there"}, place)[0]
    assert (stopped.level, stopped.message) == (ERROR, "Safe Mode: nobody is there")


def test_who_has_no_ros_is_told_what_to_install(tmp_path, capsys, monkeypatch):
    radio = {"here": "127.0.0.1:4410", "peers": ["127.0.0.1:4411"]}
    path = tmp_path / "robot.yaml"
    path.write_text(json.dumps({"robot": 1, "mission": "m", "key": "k", "driver": "ros2", "radio": radio}))
    monkeypatch.setitem(sys.modules, "rclpy", None)
    assert run_command(["robot", "ros2", str(path)]) == 2
    said = capsys.readouterr().err
    assert "ROS 2 is not installed" in said
    assert "pip install '.[ros2]'" in said


class TestSweep:
    """Drivers' scans, each of the same room: what a mission's lidar there would have seen."""

    LIMITS = 0.1, 10.0
    FULL = 360

    @pytest.mark.parametrize("first_rad", [0.0, -math.pi, 0.5, -math.pi / 2])
    @pytest.mark.parametrize("clockwise", [False, True])
    @pytest.mark.parametrize("mounted_rad", [0.0, math.pi, 1.003])
    @pytest.mark.parametrize("again", [0, 1])
    def test_beams_of_a_whole_turn_are_where_they_point(self, first_rad, clockwise, mounted_rad, again):
        step = math.tau / self.FULL * (-1 if clockwise else 1)
        bearings = [first_rad + k * step for k in range(self.FULL + again)]
        beams = beams_of(len(bearings), first_rad, step, self.LIMITS, 0.01, Place(x_m=0.1, yaw_rad=mounted_rad))
        # What it measures is where the beam points, seen from the robot: a metre and up to two more.
        scan = beams.scan_of([2.0 + math.sin(bearing + mounted_rad) for bearing in bearings])
        assert (beams.lidar.beams, beams.eye.x_m) == (self.FULL, 0.1)
        assert abs(beams.eye.yaw_rad) <= abs(step) / 2 + 1e-9
        for k, measured in enumerate(scan.ranges_m):
            points = beams.eye.yaw_rad + scan.angle_min_rad + k * scan.angle_increment_rad
            assert measured == pytest.approx(2.0 + math.sin(points), abs=1e-6)

    def test_a_lidar_that_sees_ahead_alone_keeps_its_beams(self):
        step = math.radians(0.25)
        beams = beams_of(1081, -540 * step, step, self.LIMITS, 0.01, Place())
        scan = beams.scan_of([1.0 + k / 1000 for k in range(1081)])
        assert scan.ranges_m[540] == pytest.approx(1.54)
        ahead = beams.eye.yaw_rad + scan.angle_min_rad + 540 * scan.angle_increment_rad
        assert ahead == pytest.approx(0.0, abs=1e-9)

    @pytest.mark.parametrize(
        ("count", "first_rad", "step_rad", "trouble"),
        [
            (1, 0.0, 0.1, "a scan of 1 beams"),
            (360, math.nan, 0.1, "a scan of 360 beams"),
            (360, 0.0, 0.0, "a scan of 360 beams"),
            (362, 0.0, math.tau / 360, "a scan of 362 beams"),
            (90, 0.0, math.tau / 360, "45 degrees aside"),
        ],
    )
    def test_a_scan_that_is_none_is_said(self, count, first_rad, step_rad, trouble):
        with pytest.raises(UsageError, match=trouble):
            beams_of(count, first_rad, step_rad, self.LIMITS, 0.01, Place())

    def test_a_scan_with_other_beams_than_the_first_is_refused(self):
        beams = beams_of(360, 0.0, math.tau / 360, self.LIMITS, 0.01, Place())
        with pytest.raises(UsageError, match="359 beams"):
            beams.scan_of([1.0] * 359)


class TestTrack:
    def test_the_eye_goes_where_odometry_brings_it_and_turns_add_up(self):
        track = Track(Place(x_m=0.5))
        assert track.at(0.0) is None
        for k in range(9):  # on the spot, twice round
            track.add(k, Place(x_m=7.0, y_m=-3.0, yaw_rad=1.0 + k * math.pi / 2), k)
        there = track.at(8.0)
        assert (there.x_m, there.y_m, there.yaw_rad) == pytest.approx((0.0, 0.0, 4 * math.pi))
        half = track.at(0.5)
        assert half.yaw_rad == pytest.approx(math.pi / 4)
        assert track.at(99.0) == there
        assert track.travelled_m == pytest.approx(8 * 0.5 * math.sqrt(2))

    def test_what_is_no_later_than_the_last_is_left_out(self):
        track = Track(Place())
        for t_s, x_m in ((1.0, 0.0), (2.0, 1.0), (2.0, 5.0), (1.5, 9.0)):
            assert track.add(t_s, Place(x_m=x_m), 3.0)
        assert track.travelled_m == 1.0
        assert track.at(1.75).x_m == pytest.approx(0.75)

    def test_what_is_dated_ahead_makes_nothing_that_comes_later_too_late(self):
        track = Track(Place())
        assert not track.add(1e6, Place(x_m=5.0), 1.5), "before the first, too"
        for t_s, x_m, is_now in ((1.0, 0.0, True), (1e6, 5.0, False), (2.0, 1.0, True)):
            assert track.add(t_s, Place(x_m=x_m), t_s + 0.5 if is_now else 2.5) is is_now
        assert (track.newest_s, track.travelled_m) == (2.0, 1.0)


@pytest.mark.parametrize("words", ["", "1, 2", "1, 2, x", "nan, 0, 0", "1, 2, 3, 4"])
def test_what_says_no_place_is_none(words):
    assert place_in(words) is None


class TestOnPage:
    def test_a_map_servers_grid_is_the_page_and_its_corners_are_where_they_are(self):
        area = Area.of(200, 100, 0.05, Place(x_m=-3.0, y_m=-2.0))
        assert area.size_mm == (10_000, 5_000)
        assert pose_of(area, Place(x_m=-3.0, y_m=3.0))[0] == Point(0.0, 0.0)
        assert pose_of(area, Place(x_m=7.0, y_m=-2.0))[0] == Point(10_000.0, 5_000.0)
        assert area.place_of(Point(1000.0, 2000.0)) == (-2.0, 1.0)
        turned = Area.of(200, 100, 0.05, Place(yaw_rad=math.pi / 2))
        assert turned.size_mm == (5_000, 10_000)
        assert (turned.left_m, turned.top_m) == pytest.approx((-5.0, 10.0))

    @pytest.mark.parametrize("grid", [(0, 5, 1.0), (5, 5, math.nan), (5, 5, -1.0), (10**9, 5, 1.0)])
    def test_a_grid_that_is_none_leaves_the_usual_page(self, grid):
        assert Area.of(*grid, Place()) == Area()
        assert Area.of(5, 5, 1.0, Place(x_m=math.inf)) == Area()

    @pytest.mark.parametrize(("yaw_deg", "degrees"), [(0, 270), (90, 180), (180, 90), (-90, 0), (-91, 1)])
    def test_directions_are_those_of_the_vocabulary(self, yaw_deg, degrees):
        assert pose_of(Area(), Place(yaw_rad=math.radians(yaw_deg)))[1] == degrees

    def test_who_says_it_is_elsewhere_is_shown_at_the_edge(self):
        assert pose_of(Area(), Place(x_m=-1e9, y_m=1e9))[0] == Point(0.0, 0.0)

    def test_a_robot_makes_straight_for_a_place_and_slows_down_before_it(self):
        assert steered(Place(x_m=1.0, y_m=1.0), (1.0, 11.0), 0.5) == (0.0, 0.5)
        assert steered(Place(), (-0.3, 0.4), 0.5) == pytest.approx((-0.15, 0.2))
        assert steered(Place(), (0.0, 0.0), 0.5) == (0.0, 0.0)
