"""Scans: what comes from a sensor is never refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phalanx.errors import UsageError
from phalanx.mission.landmarks import LaserScan


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
