"""Simulate a 2-D lidar among walls (line segments) and people (discs), with noise, drop-outs and misses.

Each wall is tested only against the beams that point at it: with a hundred walls, a tenth of all pairs. Walls are
grouped in tiles and processed nearest first; a tile is skipped if all its beams have hit something nearer.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import F64x1, F64x2, I64x1
from phalanx.bundle import bundled
from phalanx.config.lidar import LidarConfig
from phalanx.kernel import kernel
from phalanx.mission.angles import TWO_PI, atan2, sin_cos

from .scan import LaserScan, beam_table, clip_ranges

Pose = tuple[float, float, float]
_NOBODY, _NOTHING = np.zeros((0, 3)), np.zeros(0)
TILE_M = 2.0
# A tile is hidden if it is this far behind the hits of all its beams; circles around tiles have a margin for rounding.
BEHIND_M, WIDER_M = 0.2, 1e-6
# In beams: a margin, so that rounding never lets a ray pass between two walls that touch.
_SLACK_BEAMS = 1e-6


class Beams(NamedTuple):
    """Beams of a scan, for kernels."""

    first_rad: float  # bearing of the first beam, robot frame
    step_rad: float  # angle between two beams
    cosines: F64x1  # (b,) of their bearings
    sines: F64x1  # likewise
    range_max_m: float


class Tiles(NamedTuple):
    """Walls, ordered by tile; a wall longer than a tile has a tile of its own."""

    walls: F64x2  # (n, 4) ends of segments, map frame
    ends: I64x1  # (t + 1,) tile i has the walls from ends[i] to ends[i + 1]
    circles: F64x2  # (t, 3) centre and radius


packed_beams, _packed_tiles = bundled(Beams), bundled(Tiles)


def tiles_of(walls: F64x2) -> Tiles:
    """Return (n, 4) walls in tiles, packed for kernels."""
    middles = (walls[:, :2] + walls[:, 2:]) / 2
    squares = np.column_stack([np.floor(middles / TILE_M), np.zeros(len(walls))])
    is_long = np.hypot(*(walls[:, 2:] - walls[:, :2]).T) > TILE_M
    squares[is_long, 2] = 1 + np.arange(np.count_nonzero(is_long))
    _, square, counts = np.unique(squares, axis=0, return_inverse=True, return_counts=True)
    walls = np.ascontiguousarray(walls[np.argsort(square.ravel(), kind="stable")])
    ends = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    circles = np.empty((len(counts), 3))
    for i, (first, last) in enumerate(pairwise(ends)):
        points = walls[first:last].reshape(-1, 2)
        circles[i, :2] = (points.min(0) + points.max(0)) / 2
        circles[i, 2] = np.hypot(*(points - circles[i, :2]).T).max() + WIDER_M
    return _packed_tiles(Tiles(walls, ends, circles))


@kernel
def _span(from_rad: float, to_rad: float, beams: Beams) -> tuple[int, int]:
    """Return the beams [low, high) with bearings from `from_rad` to `to_rad`."""
    low = (from_rad - beams.first_rad) / beams.step_rad - _SLACK_BEAMS
    high = (to_rad - beams.first_rad) / beams.step_rad + _SLACK_BEAMS
    count = len(beams.cosines)
    if high < 0.0 or low > count - 1:
        return 0, 0
    return (int(low) + 1 if low > 0.0 else 0), (int(high) + 1 if high < count - 1 else count)


@kernel
def _cast_wall(ax: float, ay: float, bx: float, by: float, beams: Beams, ranges: F64x1) -> None:
    """Shorten the beams that hit the wall from a to b, robot frame."""
    along_x, along_y = bx - ax, by - ay
    offset = ax * along_y - ay * along_x
    # In line with the sensor, or out of range.
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


@kernel
def _cast_disc(x: float, y: float, radius: float, beams: Beams, ranges: F64x1) -> None:
    """Shorten the beams that hit a disc, robot frame; a disc around the sensor is ignored."""
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


@kernel
def _is_hidden(x: float, y: float, radius: float, beams: Beams, ranges: F64x1) -> bool:
    """Return True if all beams towards a circle, robot frame, have hit something in front of it."""
    squared = x * x + y * y - radius * radius
    if squared <= 0.0:
        return False
    middle, half = atan2(y, x), atan2(radius, math.sqrt(squared))
    near = math.sqrt(x * x + y * y) - radius - BEHIND_M
    for lap in (-TWO_PI, 0.0, TWO_PI):
        low, high = _span(middle - half + lap, middle + half + lap, beams)
        for k in range(low, high):
            if ranges[k] >= near:
                return False
    return True


@kernel
def _nearest_first(x: float, y: float, circles: F64x2, range_max_m: float) -> I64x1:
    """Return the indices of the circles in range, ordered by their distance in whole metres."""
    metres, counts = np.empty(len(circles), np.int64), np.zeros(int(range_max_m) + 3, np.int64)
    for i in range(len(circles)):
        dx, dy = circles[i, 0] - x, circles[i, 1] - y
        away = max(0.0, math.sqrt(dx * dx + dy * dy) - circles[i, 2])
        metres[i] = int(away) if away <= range_max_m else -1
        if metres[i] >= 0:
            counts[metres[i] + 1] += 1
    for i in range(1, len(counts)):
        counts[i] += counts[i - 1]
    order = np.empty(counts[-1], np.int64)
    for i in range(len(circles)):
        if metres[i] >= 0:
            order[counts[metres[i]]] = i
            counts[metres[i]] += 1
    return order


@kernel
def cast(pose: tuple[float, float, float], tiles: Tiles, discs: F64x2, beams: Beams, ranges: F64x1) -> None:
    """Write to `ranges` the distance to the first hit of each beam, +inf beyond the maximum range.

    `pose` is x, y, heading of the sensor and discs are (m, 3) centres and radii, in the map frame; tiles and beams are
    packed.
    """
    x, y, heading = pose
    ranges[:] = np.inf
    sine, cosine = sin_cos(heading)
    walls, ends, circles = tiles.walls, tiles.ends, tiles.circles
    for tile in _nearest_first(x, y, circles, beams.range_max_m):
        dx, dy = circles[tile, 0] - x, circles[tile, 1] - y
        ax, ay = cosine * dx + sine * dy, cosine * dy - sine * dx
        first, last = ends[tile], ends[tile + 1]
        if last - first > 1 and _is_hidden(ax, ay, circles[tile, 2], beams, ranges):
            continue
        for i in range(first, last):
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


@kernel
def _sensed(
    pose: Pose,
    tiles: Tiles,
    people: F64x2,
    beams: Beams,
    draws: tuple[F64x1, F64x1],
    wrong: tuple[float, float, float],
    ranges: F64x1,
) -> None:
    """Write to `ranges` a simulated measurement, with noise and dropped beams if there are random numbers for them.

    `draws` are (standard normal, uniform in [0, 1)) numbers; `wrong` is (noise in metres, share of dropped beams,
    minimum range).
    """
    (normals, chances), (noise_m, drop_out, least_m) = draws, wrong
    cast(pose, tiles, people, beams, ranges)
    for k in range(len(normals)):
        ranges[k] += noise_m * normals[k]
    for k in range(len(chances)):
        if chances[k] < drop_out:
            ranges[k] = np.nan
    clip_ranges(ranges, least_m, beams.range_max_m)


class Lidar:
    """A simulated lidar among `walls`, (n, 4) ends of segments in the map frame; any number of robots can share it."""

    def __init__(self, walls: NDArray[np.float64], config: LidarConfig | None = None) -> None:
        self.config = config or LidarConfig()
        self._tiles = tiles_of(np.asarray(walls, np.float64).reshape(-1, 4))
        first, step = self.config.angle_min_rad, self.config.angle_increment_rad
        self._wrong = float(self.config.noise_m), float(self.config.drop_out), float(self.config.range_min_m)
        table = beam_table(first, step, self.config.beams)
        self._beams = packed_beams(Beams(first, step, *table, float(self.config.range_max_m)))

    def true_ranges(self, pose: Pose, people: NDArray[np.float64] = _NOBODY) -> NDArray[np.float64]:
        """Return (beams,) distances without noise; +inf is a miss."""
        ranges = np.empty(self.config.beams)
        cast((float(pose[0]), float(pose[1]), float(pose[2])), self._tiles, people, self._beams, ranges)
        return ranges

    def sweep(self, pose: Pose, random: np.random.Generator, people: NDArray[np.float64] = _NOBODY) -> LaserScan:
        """Return a scan at pose x, y, heading, map frame; people are (m, 3) centres and radii, metres."""
        config = self.config
        x, y, heading = pose
        ranges = np.empty(config.beams)
        normals = random.standard_normal(config.beams) if config.noise_m else _NOTHING
        chances = random.random(config.beams) if config.drop_out else _NOTHING
        at, wrong = (float(x), float(y), float(heading)), self._wrong
        _sensed(at, self._tiles, people, self._beams, (normals, chances), wrong, ranges)
        return LaserScan.of(ranges, config)
