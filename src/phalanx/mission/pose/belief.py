"""A robot's belief: its pose, what is wrong with its odometry, and how sure it is of both.

Wheels that are too large, a track that is too narrow and a pull to one side are the same all day: the filter learns
them from corrections, and what it has learnt is the drift that Encoded graphs §VI-F speaks of.
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

from .spread import Sight, Sighting, corrected, not_surer

Pose = tuple[float, float, float]
# x, y, heading; then per metre of way, per radian of turn, and radians per metre: what odometry leaves out.
X, Y, HEADING, WAY, TURN, CURVE = range(6)
COUNT = 6
NUMBERS = COUNT + COUNT * (COUNT + 1) // 2
# Of the first radian of turns beside a wall so much may not have happened, and of more with the root: turns to and
# fro slip both ways.
SLIP = 0.05
UPPER = tuple((i, j) for i in range(COUNT) for j in range(i, COUNT))


class Wheels(NamedTuple):
    """How wrong odometry may be: standard deviations."""

    way: float  # share of the way that is always left out, or too much
    turn: float  # likewise of turns
    curve: float  # radians that it turns for each metre, unseen
    way_noise: float  # metres in the first metre, and with the root of the way
    turn_noise: float  # radians in the first radian, likewise
    curve_noise: float  # radians in the first metre, likewise


@kernel
def moved(
    mean: F64x1, spread: F64x2, way_m: float, turn_rad: float, touches: bool, wheels: Wheels
) -> tuple[F64x1, F64x2]:
    """(mean, spread) after odometry says: so far, forwards or backwards, and turned by so much.

    Args:
        touches: the robot is so near to something that its wheels may turn where it cannot.
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
    if touches:  # a way that a wall takes is lost wholly, and always to the same side
        sure[X, X] = (math.sqrt(sure[X, X]) + far) * (math.sqrt(sure[X, X]) + far)
        sure[Y, Y] = (math.sqrt(sure[Y, Y]) + far) * (math.sqrt(sure[Y, Y]) + far)
        sure[HEADING, HEADING] += SLIP * SLIP * about
    return after, sure


@kernel
def _driven(
    mean: F64x1, spread: F64x2, before: Pose, after: Pose, touches: bool, wheels: Wheels
) -> tuple[F64x1, F64x2]:
    turn = wrap(after[2] - before[2])
    sine, cosine = sin_cos(before[2] + 0.5 * turn)
    way = cosine * (after[0] - before[0]) + sine * (after[1] - before[1])
    return moved(mean, spread, way, turn, touches, wheels)


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Pose and drift as a filter knows them; nothing that holds one changes it."""

    mean: F64x1  # (6,)
    spread: F64x2  # (6, 6) covariance

    @property
    def pose(self) -> tuple[float, float, float]:
        """x, y in metres and heading in radians, map frame."""
        x, y, heading = self.mean[:3].tolist()
        return x, y, heading

    @property
    def doubt(self) -> tuple[float, float, float, float, float, float]:
        """Covariance of the pose: its upper triangle, row by row; what `Experience` takes."""
        (xx, xy, xt), (_, yy, yt), (_, _, tt) = self.spread[:3, :3].tolist()
        return xx, xy, xt, yy, yt, tt

    @property
    def drift(self) -> tuple[float, float, float]:
        """Return odometry drift: scale of distance, of turns, and rad per metre. Source: Encoded graphs §VI-F."""
        way, turn, curve = self.mean[3:].tolist()
        return way, turn, curve

    @property
    def numbers(self) -> tuple[float, ...]:
        """The mean, and the upper triangle of the covariance, row by row: 27 of them, as in a checkpoint."""
        return *self.mean.tolist(), *(float(self.spread[i, j]) for i, j in UPPER)

    def moved(self, way_m: float, turn_rad: float, wheels: Wheels, *, touches: bool = False) -> Belief:
        """After odometry says so; `touches` as above."""
        return Belief(*moved(self.mean, self.spread, float(way_m), float(turn_rad), touches, wheels))

    def driven(self, before: Pose, after: Pose, wheels: Wheels, *, touches: bool = False) -> Belief:
        """After odometry, in a frame of its own, came from one pose to another; `touches` as above."""
        return Belief(*_driven(self.mean, self.spread, before, after, touches, wheels))

    def corrected(self, sightings: tuple[Sighting, ...], sight: Sight, floor: tuple[float, float]) -> Belief:
        """After landmarks were recognised, one after the other: each as the pose after those before puts it.

        Args:
            floor: m and rad that a pose is never surer than.
        """
        mean, spread = self.mean, self.spread
        for sighting in sightings:
            mean, spread = corrected(mean, spread, sighting, sight)
            spread = not_surer(spread, *floor)
        return Belief(mean, spread)


def of_numbers(numbers: Sequence[float]) -> Belief | None:
    """The belief that has these numbers; None if they are no mean and covariance of a robot's."""
    if len(numbers) != NUMBERS or not all(math.isfinite(value) for value in numbers):
        return None
    mean, spread = np.array(numbers[:COUNT]), np.zeros((COUNT, COUNT))
    for (i, j), value in zip(UPPER, numbers[COUNT:], strict=True):
        spread[i, j] = spread[j, i] = value
    own = np.diag(spread)
    # Rounding may leave a little too much beside the diagonal.
    return Belief(mean, spread) if np.all(own > 0) and np.all(spread**2 <= 1.0001 * np.outer(own, own)) else None
