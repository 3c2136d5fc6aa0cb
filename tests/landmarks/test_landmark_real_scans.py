"""Scans that others took: what is seen in them stays, from one to the next."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from phalanx.config.lidar import ExtractionConfig
from phalanx.mission.landmarks import LaserScan, extract
from phalanx.mission.landmarks.corners import CONVEX, CORNER_X, CORNER_Y

SCANS = Path(__file__).parent.parent / "data" / "scans"
INDOORS = ExtractionConfig(door_min_m=0.7)


@pytest.fixture(scope="module")
def handheld():
    """278 scans of a Hokuyo carried through a room, 10 Hz."""
    data = np.load(SCANS / "hokuyo_handheld.npz")
    first, step = float(data["angle_min_rad"]), float(data["angle_increment_rad"])
    low, high = float(data["range_min_m"]), float(data["range_max_m"])
    return [extract(LaserScan(ranges, first, step, low, high), INDOORS) for ranges in data["ranges_m"]]


def corners(features, convex):
    return features.corners[features.corners[:, CONVEX] == convex][:, [CORNER_X, CORNER_Y]]


def test_every_scan_shows_walls_and_corners(handheld):
    assert min(len(features.walls) for features in handheld) >= 3
    assert np.mean([len(features.corners) >= 2 for features in handheld]) > 0.98


def test_counts_are_steady(handheld):
    for convex, least, most in ((1.0, 2.5, 0.6), (0.0, 1.8, 0.8)):
        counts = np.array([len(corners(features, convex)) for features in handheld])
        assert least < counts.mean() < 5
        assert np.diff(counts).std() < most


def test_a_corner_is_seen_again_a_tenth_of_a_second_later_where_it_was(handheld):
    """Carried by hand, the sensor moves by up to 5 cm and a few degrees between two scans."""
    kept, all_of_them = 0, 0
    for before, after in zip(handheld, handheld[1:], strict=False):
        old, new = corners(before, 1.0), corners(after, 1.0)
        for corner in old:
            all_of_them += 1
            kept += len(new) > 0 and np.hypot(*(new - corner).T).min() < 0.25
    assert all_of_them > 700
    assert kept > 0.85 * all_of_them


def test_the_alcove_of_that_room_is_no_doorway(handheld):
    """2.3 m wide and 0.45 m deep, in view in the first 130 scans."""
    assert sum(len(features.doorways) for features in handheld[:130]) == 0


def test_a_scan_with_beams_at_odd_angles_shows_the_corners_that_one_sees_in_its_plot():
    rows = np.loadtxt(SCANS / "pythonrobotics_lidar01.csv", delimiter=",")
    beams = 154
    ranges = np.full(beams, np.nan)
    ranges[np.round(rows[:, 0] / (2 * math.pi / beams)).astype(int) % beams] = rows[:, 1]
    found = corners(extract(LaserScan(ranges, 0.0, 2 * math.pi / beams, 0.05, 10.0)), 1.0)
    for x, y in ((-0.24, 1.02), (-0.46, 0.59), (-0.74, -0.25), (0.52, -0.45)):
        assert np.hypot(*(found - (x, y)).T).min() < 0.05
