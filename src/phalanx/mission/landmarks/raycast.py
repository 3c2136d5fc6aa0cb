"""What each beam of a sweep meets first: walls are line segments, people are discs.

Each wall asks only the beams that point at it: with a hundred walls around, that is a tenth of all pairs.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.kernel import counting_kernel
from phalanx.mission.angles import TWO_PI, atan2, sin_cos

Floats = NDArray[np.float64]
# Of a beam, so that rounding never lets a ray slip between two walls that touch.
_SLACK_BEAMS = 1e-6


class Beams(NamedTuple):
    """A sweep's beams, as kernels take them."""

    first_rad: float  # bearing of the first, robot frame
    step_rad: float  # from one to the next
    cosines: Floats  # (b,) of their bearings
    sines: Floats  # likewise
    range_max_m: float


@counting_kernel
def _span(from_rad: float, to_rad: float, beams: Beams) -> tuple[int, int]:
    """The beams [low, high) with bearings from..to."""
    low = (from_rad - beams.first_rad) / beams.step_rad - _SLACK_BEAMS
    high = (to_rad - beams.first_rad) / beams.step_rad + _SLACK_BEAMS
    count = len(beams.cosines)
    if high < 0.0 or low > count - 1:
        return 0, 0
    return (int(low) + 1 if low > 0.0 else 0), (int(high) + 1 if high < count - 1 else count)


@counting_kernel
def _cast_wall(ax: float, ay: float, bx: float, by: float, beams: Beams, ranges: Floats) -> None:
    """Shortens the beams that meet the wall from a to b, robot frame."""
    along_x, along_y = bx - ax, by - ay
    offset = ax * along_y - ay * along_x
    # Seen from exactly its end, or out of reach.
    if offset == 0.0 or offset * offset > beams.range_max_m * beams.range_max_m * (
        along_x * along_x + along_y * along_y
    ):
        return
    from_rad, to_rad = atan2(ay, ax), atan2(by, bx)
    if offset < 0.0:
        from_rad, to_rad = to_rad, from_rad
    if to_rad < from_rad:
        to_rad += TWO_PI
    for lap in (-TWO_PI, 0.0, TWO_PI):
        low, high = _span(from_rad + lap, to_rad + lap, beams)
        for k in range(low, high):
            distance = offset / (beams.cosines[k] * along_y - beams.sines[k] * along_x)
            ranges[k] = distance if 0.0 < distance < ranges[k] else ranges[k]


@counting_kernel
def _cast_disc(x: float, y: float, radius: float, beams: Beams, ranges: Floats) -> None:
    """Shortens the beams that meet a disc, robot frame; one around the sensor is not seen."""
    squared = x * x + y * y - radius * radius
    if squared <= 0.0 or squared > beams.range_max_m * beams.range_max_m:
        return
    middle, half = atan2(y, x), atan2(radius, math.sqrt(squared))
    for lap in (-TWO_PI, 0.0, TWO_PI):
        low, high = _span(middle - half + lap, middle + half + lap, beams)
        for k in range(low, high):
            ahead = beams.cosines[k] * x + beams.sines[k] * y
            inside = ahead * ahead - squared
            if inside > 0.0 and ahead - math.sqrt(inside) < ranges[k]:
                ranges[k] = ahead - math.sqrt(inside)


@counting_kernel
def cast(pose: tuple[float, float, float], walls: Floats, discs: Floats, beams: Beams, ranges: Floats) -> None:
    """Writes to `ranges` the distance to the first thing in each beam's way, +inf beyond the farthest.

    Args:
        pose: x, y, heading of the sensor, map frame.
        walls: (n, 4) ends of segments, map frame.
        discs: (m, 3) centre and radius, map frame.
    """
    x, y, heading = pose
    ranges[:] = np.inf
    sine, cosine = sin_cos(heading)
    for i in range(len(walls)):
        dx, dy = walls[i, 0] - x, walls[i, 1] - y
        ax, ay = cosine * dx + sine * dy, cosine * dy - sine * dx
        dx, dy = walls[i, 2] - x, walls[i, 3] - y
        bx, by = cosine * dx + sine * dy, cosine * dy - sine * dx
        _cast_wall(ax, ay, bx, by, beams, ranges)
    for i in range(len(discs)):
        dx, dy = discs[i, 0] - x, discs[i, 1] - y
        ax, ay = cosine * dx + sine * dy, cosine * dy - sine * dx
        _cast_disc(ax, ay, discs[i, 2], beams, ranges)
    for k in range(len(ranges)):
        if ranges[k] > beams.range_max_m:
            ranges[k] = np.inf
