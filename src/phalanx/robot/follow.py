"""The waypoint controller: wheel speeds that drive a robot to a point.

It can be replayed bit for bit (RoboRebound §3.7): only + - * / and sqrt on floats, and the result is whole percents.
"""

from __future__ import annotations

import math

import numpy as np

from phalanx.arrays import F64x1, I64x1
from phalanx.kernel import kernel
from phalanx.wire.fields import whole

FULL_PCT = 100.0
TURN_PCT = 45.0
SLOW_WITHIN_MM = 150.0
SLOWEST = 0.25


@kernel
def percent(value: int) -> int:
    """Return `value` clamped to -100..100."""
    return min(max(value, whole(-FULL_PCT)), whole(FULL_PCT))


@kernel
def steer(ahead_mm: float, right_mm: float, distance_mm: float) -> tuple[int, int]:
    """Return the speeds of the left and right wheel towards a goal, -100..100 percent; zero within 1e-6 mm of it."""
    if distance_mm < 1e-6:
        return whole(0), whole(0)
    slow = min(max(distance_mm / SLOW_WITHIN_MM, SLOWEST), 1.0)
    # Drive forwards in proportion to how far ahead the goal lies. If it is behind, turn on the spot, to the right if it
    # is exactly behind.
    if ahead_mm > 0.0:
        speed, turn = FULL_PCT * (ahead_mm / distance_mm) * slow, TURN_PCT * (right_mm / distance_mm)
    else:
        speed, turn = 0.0, (-TURN_PCT if right_mm < 0.0 else TURN_PCT)
    return percent(_nearest(speed + turn)), percent(_nearest(speed - turn))


@kernel
def _nearest(value: float) -> int:
    return whole(value + (0.5 if value >= 0.0 else -0.5))


@kernel
def wheels_towards(ahead_mm: F64x1, right_mm: F64x1) -> tuple[I64x1, I64x1]:
    """Apply `steer` to N robots with a goal each; all arrays are (N,)."""
    left, right = np.zeros(len(ahead_mm), np.int64), np.zeros(len(ahead_mm), np.int64)
    for i in range(len(ahead_mm)):
        ahead, aside = ahead_mm[i], right_mm[i]
        left[i], right[i] = steer(ahead, aside, math.sqrt(ahead * ahead + aside * aside))
    return left, right
