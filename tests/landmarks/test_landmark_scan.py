"""Scans and their bytes: what comes from a sensor is never refused, what comes from a peer only with a PeerError."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.errors import BadPayload, PeerError, UsageError
from phalanx.mission.landmarks import LaserScan

RANGES = st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=2, max_size=200)


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


@given(RANGES)
def test_bytes_give_back_the_scan_to_the_millimetre(ranges):
    before = scan(ranges)
    after = LaserScan.from_bytes(before.to_bytes())
    assert np.array_equal(np.isnan(before.ranges_m), np.isnan(after.ranges_m))
    assert np.array_equal(np.isinf(before.ranges_m), np.isinf(after.ranges_m))
    seen = np.isfinite(before.ranges_m)
    assert np.all(np.abs(before.ranges_m[seen] - after.ranges_m[seen]) <= 0.0005001)
    assert after.to_bytes() == before.to_bytes()


@given(st.binary(max_size=200))
def test_garbage_is_a_peers_error(data):
    try:
        LaserScan.from_bytes(data)
    except PeerError:
        pass


@given(RANGES, st.data())
def test_altered_bytes_are_another_scan_or_a_peers_error(ranges, data):
    good = bytearray(scan(ranges).to_bytes())
    at = data.draw(st.integers(0, len(good) - 1))
    good[at] ^= 1 << data.draw(st.integers(0, 7))
    try:
        altered = LaserScan.from_bytes(bytes(good))
    except PeerError:
        return
    assert altered.to_bytes() == LaserScan.from_bytes(altered.to_bytes()).to_bytes()


def test_a_scan_that_ends_too_early_or_too_late_is_refused():
    good = scan([1.0] * 10).to_bytes()
    for wrong in (good[:-1], good + b"\0", b""):
        with pytest.raises(BadPayload):
            LaserScan.from_bytes(wrong)
