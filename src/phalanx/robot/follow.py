"""The waypoint controller: which wheels to turn to get to a point.

Replayable (RoboRebound §3.7): only + - * / and sqrt on floats, whole percents out.
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
    """`value`, or the end of -100..100 that it is beyond."""
    return min(max(value, whole(-FULL_PCT)), whole(FULL_PCT))


@kernel
def steer(ahead_mm: float, right_mm: float, distance_mm: float) -> tuple[int, int]:
    """Wheels, left and right, -100..100 percent, towards a goal that lies so; zero within 1e-6 mm of it."""
    if distance_mm < 1e-6:
        return whole(0), whole(0)
    slow = min(max(distance_mm / SLOW_WITHIN_MM, SLOWEST), 1.0)
    # Straight on as far as the goal is in front; behind, turn on the spot, to the right if it lies dead astern.
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
    """`steer` for N robots with a goal each: (N,) all."""
    left, right = np.zeros(len(ahead_mm), np.int64), np.zeros(len(ahead_mm), np.int64)
    for i in range(len(ahead_mm)):
        ahead, aside = ahead_mm[i], right_mm[i]
        left[i], right[i] = steer(ahead, aside, math.sqrt(ahead * ahead + aside * aside))
    return left, right
