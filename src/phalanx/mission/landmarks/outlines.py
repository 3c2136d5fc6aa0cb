"""Compute outlines of walls: closed paths along the walls with free space on the left, as a robot inside sees them.

A wall without thickness is followed on both sides. Walls that cross or touch are cut there first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float]
# Walls with ends this near to each other, or to another wall, touch.
TOUCH_M = 0.005
# Smaller bends count as straight.
STRAIGHT_SINE = 0.02


@dataclass(frozen=True, eq=False)
class Outline:
    """A closed path along walls."""

    points: NDArray[np.float64]  # (k, 2) corners, metres; free space is on the left from each to the next
    seen: NDArray[np.bool_]  # (k,) True if the wall from a point to the next is visible to a robot inside the bounds

    @cached_property
    def area_m2(self) -> float:
        """Return the signed area: positive around free space, negative around an island of walls."""
        return area_of(self.points)

    @cached_property
    def _box(self) -> tuple[float, ...]:
        return (*self.points.min(0).tolist(), *self.points.max(0).tolist())

    def has_on_free_side(self, x_m: float, y_m: float) -> bool:
        """Return True if a place is inside an outline around free space, or outside an island."""
        # A path along walls without thickness encloses no area.
        if abs(self.area_m2) < TOUCH_M:
            return True
        # A bounding box rejects most islands quickly.
        x0, y0, x1, y1 = self._box
        is_near = x0 <= x_m <= x1 and y0 <= y_m <= y1
        return (is_near and _encloses(self.points, (x_m, y_m))) == (self.area_m2 > 0)


def outlines_of(
    walls: NDArray[np.float64], bounds: tuple[float, float, float, float], start: Point | None
) -> tuple[Outline, ...]:
    """Return the outlines of the space with `start`, or of all spaces, as seen from inside the bounds."""
    ways = [np.array(way) for way in _faces(_cut(walls))]
    if start is not None:
        ways = ways_around(ways, _face_of(_rings(ways), start))
    x0, y0, x1, y1 = bounds
    outlines = []
    for way in ways:
        points = _straightened(way)
        to = np.roll(points, -1, axis=0) - points
        normal = np.stack([-to[:, 1], to[:, 0]], axis=1) / np.maximum(np.hypot(to[:, 0], to[:, 1]), 1e-9)[:, None]
        beside = points + 0.5 * to + 2 * TOUCH_M * normal
        seen = (beside[:, 0] > x0) & (beside[:, 0] < x1) & (beside[:, 1] > y0) & (beside[:, 1] < y1)
        if seen.any():
            outlines.append(Outline(points, seen))
    return tuple(outlines)


def ways_around(ways: list[NDArray[np.float64]], home: NDArray[np.float64] | None) -> list[NDArray[np.float64]]:
    """Return the paths that bound one space: its outer path `home` (None for the outside) and its islands."""
    rings = _rings(ways)
    return [way for way in ways if _own_face(rings, way) is home]


def _rings(ways: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Return the paths around free space, without paths there and back along a wall, whose area is just rounding."""
    return [way for way in ways if area_of(way) > TOUCH_M * TOUCH_M]


def _cut(walls: NDArray[np.float64]) -> dict[Point, set[Point]]:
    """Return the walls as a graph: the neighbours of each point where walls end, meet or cross."""
    ends = walls.reshape(-1, 2)
    names: dict[tuple[int, int], Point] = {}

    def at(x: float, y: float) -> Point:
        # Points in adjacent cells of a TOUCH_M grid are merged, so that rounding does not separate touching walls.
        column, row = math.floor(x / TOUCH_M + 0.5), math.floor(y / TOUCH_M + 0.5)
        for dx in (0, -1, 1):
            for dy in (0, -1, 1):
                if (known := names.get((column + dx, row + dy))) is not None:
                    return known
        names[column, row] = (x, y)
        return names[column, row]

    neighbours: dict[Point, set[Point]] = {}
    for wall in walls:
        a, along = wall[:2], wall[2:] - wall[:2]
        length = math.hypot(*along)
        unit = along / length
        # Ends of other walls on this one, and crossings with other walls.
        to = ends - a
        s = to @ unit
        off = to[:, 0] * unit[1] - to[:, 1] * unit[0]
        cuts = [0.0, length, *s[(np.abs(off) <= TOUCH_M) & (s > 0) & (s < length)]]
        other = walls[:, 2:] - walls[:, :2]
        cross = unit[0] * other[:, 1] - unit[1] * other[:, 0]
        to = walls[:, :2] - a
        with np.errstate(divide="ignore", invalid="ignore"):
            on_this = (to[:, 0] * other[:, 1] - to[:, 1] * other[:, 0]) / cross
            on_other = (to[:, 0] * unit[1] - to[:, 1] * unit[0]) / cross
        crossing = (np.abs(cross) > 1e-9) & (on_this > 0) & (on_this < length) & (on_other > 0) & (on_other < 1)
        cuts += list(on_this[crossing])
        points = [at(*(a + s * unit)) for s in sorted(cuts)]
        for p, q in pairwise(points):
            if p != q:
                neighbours.setdefault(p, set()).add(q)
                neighbours.setdefault(q, set()).add(p)
    return neighbours


def _faces(neighbours: dict[Point, set[Point]]) -> list[list[Point]]:
    """Return all closed paths with free space on the left: the faces of the planar graph."""
    around = {
        p: sorted(others, key=lambda q, p=p: (math.atan2(q[1] - p[1], q[0] - p[0]), q))  # type: ignore[misc]
        for p, others in neighbours.items()
    }
    to_do = {(p, q) for p, others in neighbours.items() for q in others}
    ways = []
    for first in sorted(to_do):
        if first not in to_do:
            continue
        way, step = [], first
        while step in to_do:
            to_do.discard(step)
            p, q = step
            way.append(p)
            # Take the sharpest left turn: the next neighbour clockwise from the previous point.
            turn = around[q]
            step = (q, turn[turn.index(p) - 1])
        ways.append(way)
    return ways


def area_of(points: NDArray[np.float64]) -> float:
    """Return the area inside a closed path, positive if it runs counter-clockwise."""
    x, y = points[:, 0], points[:, 1]
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def _encloses(points: NDArray[np.float64], place: Point) -> bool:
    """Return True if a place is inside a closed path."""
    x, y = points[:, 0], points[:, 1]
    above = y > place[1]
    # Only sides that cross the height of the place count; the last one leads to the first point.
    i = np.flatnonzero(above != np.roll(above, -1))
    j = (i + 1) % len(y)
    at = x[i] + (place[1] - y[i]) / (y[j] - y[i]) * (x[j] - x[i])
    return bool(np.count_nonzero(place[0] < at) % 2)


def _face_of(rings: list[NDArray[np.float64]], place: Point) -> NDArray[np.float64] | None:
    """Return the smallest ring around a place; None if no ring encloses it."""
    return min((ring for ring in rings if _encloses(ring, place)), key=area_of, default=None)


def _own_face(rings: list[NDArray[np.float64]], way: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the ring around the space on the left of a path; the path itself if it is a ring."""
    for ring in rings:
        if ring is way:
            return ring
    a, b = way[0], way[1]
    along = b - a
    beside = 0.5 * (a + b) + 1e-4 * np.array([-along[1], along[0]]) / math.hypot(*along)
    return _face_of(rings, (float(beside[0]), float(beside[1])))


def _straightened(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points without those where the path does not turn."""
    before = points - np.roll(points, 1, axis=0)
    after = np.roll(points, -1, axis=0) - points
    sine = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    cosine = (before * after).sum(1)
    length = np.hypot(before[:, 0], before[:, 1]) * np.hypot(after[:, 0], after[:, 1])
    turns = (np.abs(sine) > STRAIGHT_SINE * length) | (cosine < 0)
    straight: NDArray[np.float64] = points[turns]
    return straight
