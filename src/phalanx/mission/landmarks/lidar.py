"""A 2-D lidar in a world of walls (line segments) and people (discs): sweeps with noise, drop-outs and misses.

Each wall asks only the beams that point at it: with a hundred walls around, that is a tenth of all pairs. Walls lie in
tiles, and the nearest come first: a tile that lies behind what its beams have met is not looked at.
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
# So far behind what all its beams met a tile is hidden; and a circle around it is so much wider, against rounding.
BEHIND_M, WIDER_M = 0.2, 1e-6
# Of a beam, so that rounding never lets a ray slip between two walls that touch.
_SLACK_BEAMS = 1e-6


class Beams(NamedTuple):
    """A sweep's beams, as kernels take them."""

    first_rad: float  # bearing of the first, robot frame
    step_rad: float  # from one to the next
    cosines: F64x1  # (b,) of their bearings
    sines: F64x1  # likewise
    range_max_m: float


class Tiles(NamedTuple):
    """Walls, those that lie together one after the other; one that is longer than a tile is its own."""

    walls: F64x2  # (n, 4) ends of segments, map frame
    ends: I64x1  # (t + 1,) tile i has those from ends[i] to ends[i + 1]
    circles: F64x2  # (t, 3) centre and radius


packed_beams, _packed_tiles = bundled(Beams), bundled(Tiles)


def tiles_of(walls: F64x2) -> Tiles:
    """Walls, (n, 4), in tiles, packed."""
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
    """The beams [low, high) with bearings from..to."""
    low = (from_rad - beams.first_rad) / beams.step_rad - _SLACK_BEAMS
    high = (to_rad - beams.first_rad) / beams.step_rad + _SLACK_BEAMS
    count = len(beams.cosines)
    if high < 0.0 or low > count - 1:
        return 0, 0
    return (int(low) + 1 if low > 0.0 else 0), (int(high) + 1 if high < count - 1 else count)


@kernel
def _cast_wall(ax: float, ay: float, bx: float, by: float, beams: Beams, ranges: F64x1) -> None:
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


@kernel
def _cast_disc(x: float, y: float, radius: float, beams: Beams, ranges: F64x1) -> None:
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


@kernel
def _is_hidden(x: float, y: float, radius: float, beams: Beams, ranges: F64x1) -> bool:
    """Return whether all beams that may meet something in a circle, robot frame, have met something before it."""
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
    """The circles in reach, by the whole metres that they are off."""
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
    """Write to `ranges` the distance to the first thing in each beam's way, +inf beyond the farthest.

    The sensor's pose is x, y, heading, discs are (m, 3) centres and radii, in the map frame; tiles and beams packed.
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
    """Write to `ranges` what a lidar measures: with noise, and some beams silent; each where there are draws for it.

    `draws` are normal, and uniform below 1; `wrong` is noise in metres, share of silent beams, the nearest range.
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
    """A lidar that sees `walls`, (n, 4) ends of segments in the map frame; one object serves any number of robots."""

    def __init__(self, walls: NDArray[np.float64], config: LidarConfig | None = None) -> None:
        self.config = config or LidarConfig()
        self._tiles = tiles_of(np.asarray(walls, np.float64).reshape(-1, 4))
        first, step = self.config.angle_min_rad, self.config.angle_increment_rad
        self._wrong = float(self.config.noise_m), float(self.config.drop_out), float(self.config.range_min_m)
        table = beam_table(first, step, self.config.beams)
        self._beams = packed_beams(Beams(first, step, *table, float(self.config.range_max_m)))

    def true_ranges(self, pose: Pose, people: NDArray[np.float64] = _NOBODY) -> NDArray[np.float64]:
        """(beams,) distances without noise; +inf is a miss."""
        ranges = np.empty(self.config.beams)
        cast((float(pose[0]), float(pose[1]), float(pose[2])), self._tiles, people, self._beams, ranges)
        return ranges

    def sweep(self, pose: Pose, random: np.random.Generator, people: NDArray[np.float64] = _NOBODY) -> LaserScan:
        """Return a scan from x, y, heading, map frame; people are (m, 3) centres and radii, metres."""
        config = self.config
        x, y, heading = pose
        ranges = np.empty(config.beams)
        normals = random.standard_normal(config.beams) if config.noise_m else _NOTHING
        chances = random.random(config.beams) if config.drop_out else _NOTHING
        at, wrong = (float(x), float(y), float(heading)), self._wrong
        _sensed(at, self._tiles, people, self._beams, (normals, chances), wrong, ranges)
        return LaserScan.of(ranges, config)
