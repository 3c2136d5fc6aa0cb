"""Covariance of a pose, and what follows for a landmark: uncertainty of its place, misfit of a match, correction.

If the pose is off by (dx, dy, turn), a landmark seen at offset (ox, oy) is off by (dx - oy turn, dy + ox turn). This is
linear, so the mean and covariance of three numbers are enough.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phalanx.arrays import F64x1, F64x2
from phalanx.kernel import kernel
from phalanx.mission.angles import wrap


class Sight(NamedTuple):
    """Standard deviations of an observed landmark relative to its place in the map."""

    place_m: float  # of its place, at distance 0
    per_m: float  # added for each metre of distance
    turn_rad: float  # of its orientation


class Sighting(NamedTuple):
    """A seen landmark matched to its true place; map frame."""

    seen_x_m: float  # place seen, computed from the pose before the correction
    seen_y_m: float
    x_m: float  # true place
    y_m: float
    turn_rad: float  # from the seen orientation to the true one; NaN without orientation


def pose_spread(spread: tuple[float, ...]) -> F64x2:
    """Return the (3, 3) covariance of x, y and heading from its upper triangle, row by row."""
    xx, xy, xt, yy, yt, tt = spread
    return np.array((xx, xy, xt, xy, yy, yt, xt, yt, tt), np.float64).reshape(3, 3)  # faster from a flat tuple


@kernel
def with_floor(spread: F64x2, place_m: float, turn_rad: float) -> F64x2:
    """Return the covariance with at least these standard deviations, as sightings of one landmark share its error."""
    sure = spread.copy()
    for i in range(2):
        sure[i, i] = max(sure[i, i], place_m * place_m)
    sure[2, 2] = max(sure[2, 2], turn_rad * turn_rad)
    return sure


@kernel
def place_deviations(spread: F64x2, ox: float, oy: float, sight: Sight) -> tuple[float, float, float]:
    """Return the standard deviations of the place of a landmark seen at an offset: (along x, along y, largest).

    Args:
        spread: (3, 3) covariance of x, y in metres and the heading in radians.
        ox, oy: from the robot to the landmark, map frame.
    """
    away = math.sqrt(ox * ox + oy * oy)
    own = (sight.place_m + sight.per_m * away) * (sight.place_m + sight.per_m * away)
    xt, yt, tt = spread[0, 2], spread[1, 2], spread[2, 2]
    xx = spread[0, 0] - 2.0 * oy * xt + oy * oy * tt + own
    yy = spread[1, 1] + 2.0 * ox * yt + ox * ox * tt + own
    xy = spread[0, 1] + ox * xt - oy * yt - ox * oy * tt
    half = 0.5 * (xx - yy)
    most = 0.5 * (xx + yy) + math.sqrt(half * half + xy * xy)
    return math.sqrt(xx), math.sqrt(yy), math.sqrt(most)


@kernel
def _gain(spread: F64x2, ox: float, oy: float, sight: Sight, oriented: bool) -> tuple[F64x2, F64x2, F64x2]:
    """Return (H, inverse of S, P H^T) for a landmark at an offset; the row of a missing orientation is 0."""
    h = np.zeros((3, 3))
    h[0, 0], h[1, 1], h[0, 2], h[1, 2] = 1.0, 1.0, -oy, ox
    if oriented:
        h[2, 2] = 1.0
    ph = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            ph[i, j] = spread[i, 0] * h[j, 0] + spread[i, 1] * h[j, 1] + spread[i, 2] * h[j, 2]
    s = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            s[i, j] = h[i, 0] * ph[0, j] + h[i, 1] * ph[1, j] + h[i, 2] * ph[2, j]
    away = math.sqrt(ox * ox + oy * oy)
    own = (sight.place_m + sight.per_m * away) * (sight.place_m + sight.per_m * away)
    s[0, 0] += own
    s[1, 1] += own
    s[2, 2] += sight.turn_rad * sight.turn_rad
    return h, inverse(s), ph


@kernel
def inverse(s: F64x2) -> F64x2:
    """Return the inverse of a symmetric, positive definite (3, 3) matrix."""
    a = s[1, 1] * s[2, 2] - s[1, 2] * s[1, 2]
    b = s[0, 2] * s[1, 2] - s[0, 1] * s[2, 2]
    c = s[0, 1] * s[1, 2] - s[0, 2] * s[1, 1]
    det = s[0, 0] * a + s[0, 1] * b + s[0, 2] * c
    out = np.empty((3, 3))
    out[0, 0], out[0, 1], out[0, 2] = a / det, b / det, c / det
    out[1, 0], out[1, 1] = b / det, (s[0, 0] * s[2, 2] - s[0, 2] * s[0, 2]) / det
    out[1, 2] = (s[0, 1] * s[0, 2] - s[0, 0] * s[1, 2]) / det
    out[2, 0], out[2, 1] = c / det, out[1, 2]
    out[2, 2] = (s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1]) / det
    return out


@kernel
def misfit(spread: F64x2, x_m: float, y_m: float, sighting: Sighting, sight: Sight) -> float:
    """Return the squared Mahalanobis distance of a match: 3 degrees of freedom, 2 without orientation."""
    oriented = not np.isnan(sighting.turn_rad)
    ox, oy = sighting.seen_x_m - x_m, sighting.seen_y_m - y_m
    _, s, _ = _gain(spread, ox, oy, sight, oriented)
    v0, v1 = sighting.x_m - sighting.seen_x_m, sighting.y_m - sighting.seen_y_m
    v2 = sighting.turn_rad if oriented else 0.0
    across = v0 * (s[0, 1] * v1 + s[0, 2] * v2) + v1 * s[1, 2] * v2
    square: float = s[0, 0] * v0 * v0 + s[1, 1] * v1 * v1 + s[2, 2] * v2 * v2 + 2.0 * across
    return square


@kernel
def corrected(mean: F64x1, spread: F64x2, sighting: Sighting, sight: Sight) -> tuple[F64x1, F64x2]:
    """Return (mean, covariance) after a match, of a pose or of a pose and further correlated values.

    Args:
        mean: (n,) x, y, heading and further values, n at least 3.
        spread: (n, n) covariance of `mean`.
        sighting: computed from the pose in `mean`.
    """
    n = len(mean)
    oriented = not np.isnan(sighting.turn_rad)
    ox, oy = sighting.seen_x_m - mean[0], sighting.seen_y_m - mean[1]
    h, s, _ = _gain(spread, ox, oy, sight, oriented)
    v = np.zeros(3)
    v[0], v[1] = sighting.x_m - sighting.seen_x_m, sighting.y_m - sighting.seen_y_m
    if oriented:
        v[2] = sighting.turn_rad
    ph, gain = np.zeros((n, 3)), np.zeros((n, 3))
    for i in range(n):
        for j in range(3):
            ph[i, j] = spread[i, 0] * h[j, 0] + spread[i, 1] * h[j, 1] + spread[i, 2] * h[j, 2]
    for i in range(n):
        for j in range(3):
            gain[i, j] = ph[i, 0] * s[0, j] + ph[i, 1] * s[1, j] + ph[i, 2] * s[2, j]
    after, sure = mean.copy(), spread.copy()
    for i in range(n):
        after[i] += gain[i, 0] * v[0] + gain[i, 1] * v[1] + gain[i, 2] * v[2]
        for j in range(n):
            sure[i, j] -= gain[i, 0] * ph[j, 0] + gain[i, 1] * ph[j, 1] + gain[i, 2] * ph[j, 2]
    after[2] = wrap(after[2])
    for i in range(n):
        for j in range(i):
            both = 0.5 * (sure[i, j] + sure[j, i])
            sure[i, j], sure[j, i] = both, both
    return after, sure
