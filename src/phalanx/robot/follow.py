"""The waypoint controller: which wheels to turn to get to a point.

Replayable (RoboRebound §3.7): only + - * / and sqrt on floats, whole percents out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FULL_PCT = 100.0
TURN_PCT = 45.0
SLOW_WITHIN_MM = 150.0
SLOWEST = 0.25


def wheels_towards(
    ahead_mm: NDArray[np.float64], right_mm: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Wheel commands of N robots towards a goal each.

    Args:
        ahead_mm: (N,), how far the goal lies in front of the robot.
        right_mm: (N,), how far it lies to the right.
    Returns: left and right, (N,) each, -100..100 percent; zero for a robot within 1e-6 mm of its goal.
    Source: none.
    """
    distance = np.sqrt(ahead_mm * ahead_mm + right_mm * right_mm)
    near = distance < 1e-6
    scale = np.where(near, 1.0, distance)
    cos, sin = ahead_mm / scale, right_mm / scale
    # Straight on as far as the goal is in front; behind, turn on the spot, to the right if it lies dead astern.
    speed = FULL_PCT * np.maximum(cos, 0.0) * np.clip(distance / SLOW_WITHIN_MM, SLOWEST, 1.0)
    turn = TURN_PCT * np.where(cos > 0.0, sin, np.where(sin < 0.0, -1.0, 1.0))
    keep = np.where(near, 0.0, 1.0)
    left = np.clip(speed + turn, -FULL_PCT, FULL_PCT) * keep
    right = np.clip(speed - turn, -FULL_PCT, FULL_PCT) * keep
    return np.rint(left).astype(np.int64), np.rint(right).astype(np.int64)
