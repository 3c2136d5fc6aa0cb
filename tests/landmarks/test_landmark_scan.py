"""Scans: what comes from a sensor is never refused."""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np
import pytest

from phalanx.config.lidar import LidarConfig
from phalanx.errors import UsageError
from phalanx.mission.landmarks import LaserScan
from phalanx.mission.landmarks.lidar import Lidar
from phalanx.robot.controllers.mission.readings import Sensors
from phalanx.wire.table import RANGE

SENSORS = Sensors()


def scan(ranges, step=0.01):
    return LaserScan(np.array(ranges, float), -0.5, step, 0.1, 20.0)


def test_too_far_is_a_miss_and_too_near_is_nothing():
    got = scan([0.05, 0.1, 20.0, 20.1, math.inf, math.nan, -1.0]).ranges_m
    assert got[[1, 2]].tolist() == [0.1, 20.0]
    assert np.isposinf(got[[3, 4]]).all()
    assert np.isnan(got[[0, 5, 6]]).all()


def test_a_scan_cannot_be_altered_and_keeps_no_hold_of_the_callers_array():
    mine = np.array([1.0, 2.0])
    taken = scan(mine)
    mine[0] = 5.0
    assert taken.ranges_m[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        taken.ranges_m[0] = 3.0


@pytest.mark.parametrize(
    ("beams", "first", "step", "low", "high"),
    [
        (1, 0.0, 0.01, 0.1, 20.0),
        (9000, 0.0, 0.0001, 0.1, 20.0),
        (100, 0.0, 0.0, 0.1, 20.0),
        (100, 0.0, -0.01, 0.1, 20.0),
        (100, 0.0, 0.1, 0.1, 20.0),
        (100, math.nan, 0.01, 0.1, 20.0),
        (100, 0.0, 0.01, 5.0, 5.0),
        (100, 0.0, 0.01, 0.1, math.inf),
    ],
)
def test_a_scan_that_is_none_is_refused(beams, first, step, low, high):
    with pytest.raises(UsageError):
        LaserScan(np.ones(beams), first, step, low, high)


def test_what_a_lidar_of_ours_tells_is_as_valid_as_a_scan_that_is_checked() -> None:
    lidar = LidarConfig(beams=90, range_min_m=1.0, range_max_m=4.0, noise_m=0.2, drop_out=0.1)
    walls = np.array([(x, -9.0, x, 9.0) for x in (1.0, 4.0, -2.0)])  # some ranges end up beyond either limit
    scan = Lidar(walls, lidar).sweep((0.0, 0.0, 0.0), np.random.default_rng(0))
    limits = lidar.angle_min_rad, lidar.angle_increment_rad, lidar.range_min_m, lidar.range_max_m
    checked = LaserScan(scan.ranges_m, *limits)
    assert np.array_equal(scan.ranges_m, checked.ranges_m, equal_nan=True)
    assert all(getattr(scan, each.name) == getattr(checked, each.name) for each in fields(scan)[1:])
    assert not scan.ranges_m.flags.writeable
    near = SENSORS.scan_of(bytes(SENSORS.scan_bytes)).ranges_m
    assert np.isnan(near).all()
    words = np.full(SENSORS.lidar.beams, 40_000, RANGE.dtype)  # 40 m, of a lidar that reaches 30
    assert np.isposinf(SENSORS.scan_of(words.tobytes()).ranges_m).all()
