"""A robot's belief: mean and covariance of its pose and of the systematic errors of its odometry.

Errors from wheels that are too large, a track that is too narrow or a pull to one side are constant. The filter
estimates them from corrections; they are the drift of Encoded graphs §VI-F.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from phalanx.arrays import F64x1, F64x2
from phalanx.kernel import kernel
from phalanx.mission.angles import sin_cos, wrap

from .spread import Sight, Sighting, corrected, with_floor

Pose = tuple[float, float, float]
# x, y, heading; then the scale error of distances, the scale error of turns, and the undetected turn in rad per metre.
X, Y, HEADING, WAY, TURN, CURVE = range(6)
COUNT = 6
NUMBERS = COUNT + COUNT * (COUNT + 1) // 2
# Standard deviation of wheel slip in the first radian of turns beside a wall; it grows with the square root of the
# turn, as slip in turns to both sides cancels in part.
SLIP = 0.05
UPPER = tuple((i, j) for i in range(COUNT) for j in range(i, COUNT))


class OdometryErrors(NamedTuple):
    """Standard deviations of odometry errors."""

    way: float  # scale error of distances
    turn: float  # scale error of turns
    curve: float  # undetected turn in radians per metre
    way_noise: float  # metres in the first metre; grows with the square root of the distance
    turn_noise: float  # radians in the first radian; grows likewise
    curve_noise: float  # radians in the first metre; grows likewise


@kernel
def moved(
    mean: F64x1, spread: F64x2, way_m: float, turn_rad: float, touches: bool, wheels: OdometryErrors
) -> tuple[F64x1, F64x2]:
    """Return (mean, covariance) after odometry has measured a distance, negative for backwards, and a turn.

    Args:
        touches: the robot may touch an obstacle, so that its wheels slip.
    """
    n = len(mean)
    way = way_m * (1.0 + mean[WAY])
    turn = turn_rad * (1.0 + mean[TURN]) + way_m * mean[CURVE]
    sine, cosine = sin_cos(mean[HEADING] + 0.5 * turn)
    after = mean.copy()
    after[X] += way * cosine
    after[Y] += way * sine
    after[HEADING] = wrap(mean[HEADING] + turn)
    f = np.eye(n)
    f[X, HEADING], f[Y, HEADING] = -way * sine, way * cosine
    f[X, WAY], f[Y, WAY] = way_m * cosine, way_m * sine
    f[X, TURN], f[Y, TURN] = -0.5 * way * sine * turn_rad, 0.5 * way * cosine * turn_rad
    f[X, CURVE], f[Y, CURVE] = -0.5 * way * sine * way_m, 0.5 * way * cosine * way_m
    f[HEADING, TURN], f[HEADING, CURVE] = turn_rad, way_m
    half = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            for k in range(n):
                half[i, j] += f[i, k] * spread[k, j]
    sure = np.zeros((n, n))
    for i in range(n):
        for j in range(i, n):
            for k in range(n):
                sure[i, j] += half[i, k] * f[j, k]
            sure[j, i] = sure[i, j]
    far, about = abs(way_m), abs(turn_rad)
    along = wheels.way_noise * wheels.way_noise * far
    sure[X, X] += along
    sure[Y, Y] += along
    sure[HEADING, HEADING] += (
        wheels.turn_noise * wheels.turn_noise * about + wheels.curve_noise * wheels.curve_noise * far
    )
    if touches:  # the whole distance may be slip, and always in the same direction
        sure[X, X] = (math.sqrt(sure[X, X]) + far) * (math.sqrt(sure[X, X]) + far)
        sure[Y, Y] = (math.sqrt(sure[Y, Y]) + far) * (math.sqrt(sure[Y, Y]) + far)
        sure[HEADING, HEADING] += SLIP * SLIP * about
    return after, sure


@kernel
def _driven(
    mean: F64x1, spread: F64x2, before: Pose, after: Pose, touches: bool, wheels: OdometryErrors
) -> tuple[F64x1, F64x2]:
    turn = wrap(after[2] - before[2])
    sine, cosine = sin_cos(before[2] + 0.5 * turn)
    way = cosine * (after[0] - before[0]) + sine * (after[1] - before[1])
    return moved(mean, spread, way, turn, touches, wheels)


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Mean and covariance of pose and drift; treat as immutable."""

    mean: F64x1  # (6,)
    spread: F64x2  # (6, 6) covariance

    @property
    def pose(self) -> tuple[float, float, float]:
        """Return x, y in metres and heading in radians, map frame."""
        x, y, heading = self.mean[:3].tolist()
        return x, y, heading

    @property
    def pose_covariance(self) -> tuple[float, float, float, float, float, float]:
        """Return the upper triangle of the pose's covariance, row by row, for `Experience`."""
        (xx, xy, xt), (_, yy, yt), (_, _, tt) = self.spread[:3, :3].tolist()
        return xx, xy, xt, yy, yt, tt

    @property
    def drift(self) -> tuple[float, float, float]:
        """Return odometry drift: scale of distance, of turns, and rad per metre. Source: Encoded graphs §VI-F."""
        way, turn, curve = self.mean[3:].tolist()
        return way, turn, curve

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return the 27 numbers of a checkpoint: the mean, and the upper triangle of the covariance, row by row."""
        return *self.mean.tolist(), *(float(self.spread[i, j]) for i, j in UPPER)

    def moved(self, way_m: float, turn_rad: float, wheels: OdometryErrors, *, touches: bool = False) -> Belief:
        """Return the belief after odometry; arguments as in the function `moved`."""
        return Belief(*moved(self.mean, self.spread, float(way_m), float(turn_rad), touches, wheels))

    def driven(self, before: Pose, after: Pose, wheels: OdometryErrors, *, touches: bool = False) -> Belief:
        """Return the belief after odometry has moved between two poses of its own frame; `touches` as in `moved`."""
        return Belief(*_driven(self.mean, self.spread, before, after, touches, wheels))

    def corrected(self, sightings: tuple[Sighting, ...], sight: Sight, floor: tuple[float, float]) -> Belief:
        """Return the belief after recognised landmarks, processed one after the other.

        Args:
            sightings: each computed from the pose after the previous ones.
            floor: smallest standard deviations of a pose, in m and rad.
        """
        mean, spread = self.mean, self.spread
        for sighting in sightings:
            mean, spread = corrected(mean, spread, sighting, sight)
            spread = with_floor(spread, *floor)
        return Belief(mean, spread)


def belief_from_numbers(numbers: Sequence[float]) -> Belief | None:
    """Return the belief with these `Belief.numbers`, or None if they are not a valid mean and covariance."""
    if len(numbers) != NUMBERS or not all(math.isfinite(value) for value in numbers):
        return None
    mean, spread = np.array(numbers[:COUNT]), np.zeros((COUNT, COUNT))
    for (i, j), value in zip(UPPER, numbers[COUNT:], strict=True):
        spread[i, j] = spread[j, i] = value
    own = np.diag(spread)
    # Tolerance for rounding errors off the diagonal.
    return Belief(mean, spread) if np.all(own > 0) and np.all(spread**2 <= 1.0001 * np.outer(own, own)) else None
