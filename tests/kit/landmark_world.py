"""Small worlds for the tests of landmarks: walls, and what a lidar sees of them."""

from __future__ import annotations

import math

import numpy as np

from phalanx.config.lidar import ExtractionConfig, LidarConfig
from phalanx.mission.landmarks import extract
from phalanx.mission.landmarks.lidar import Lidar

NOBODY = np.zeros((0, 3))
# 6 x 4 m, a doorway of 1.4 m in the wall x = 6, something far behind it.
ROOM = [
    (0, 0, 6, 0),
    (6, 0, 6, 1.2),
    (6, 2.6, 6, 4),
    (6, 4, 0, 4),
    (0, 4, 0, 0),
    (12, -5, 12, 9),
]


def look(walls, pose, noise=0.0, people=NOBODY, seed=1, config=None, drop_out=0.0, **lidar):
    lidar_config = LidarConfig(noise_m=noise, drop_out=drop_out, **lidar)
    scan = Lidar(np.array(walls, float), lidar_config).sweep(pose, np.random.default_rng(seed), people)
    return extract(scan, config or ExtractionConfig())


def seen(walls, pose, kind, **more):
    """The landmarks of a type that a robot sees."""
    return [landmark for landmark in look(walls, pose, **more).landmarks(*pose) if landmark.type == kind]


def away(landmark, x, y):
    return math.hypot(landmark.x_m - x, landmark.y_m - y)
