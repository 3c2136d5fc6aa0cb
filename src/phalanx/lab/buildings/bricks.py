"""Compose a generated building on a rectangular site: boxes, thin walls and rotated boxes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from random import Random
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

# Two objects leave a passage for a robot 0.35 m wide, at least WAY_M, or stand at most TOGETHER_M apart.
WAY_M = 0.8
TOGETHER_M = 0.1
# Depth of the free space on both sides of a door.
DOOR_M = 0.9
_TRIES = 12


class Box(NamedTuple):
    """Axis-aligned rectangle, in metres from the site's lower left corner."""

    x0: float
    y0: float
    x1: float
    y1: float

    def away_m(self, other: Box) -> float:
        """Return the distance between two boxes, 0 if they touch."""
        dx = max(0.0, self.x0 - other.x1, other.x0 - self.x1)
        dy = max(0.0, self.y0 - other.y1, other.y0 - self.y1)
        return math.hypot(dx, dy)

    def grown(self, by_m: float) -> Box:
        """Return the box enlarged by this margin on all sides."""
        return Box(self.x0 - by_m, self.y0 - by_m, self.x1 + by_m, self.y1 + by_m)


class Door(NamedTuple):
    """Gap in a wall: position of its centre along the wall, and width, in metres."""

    at_m: float
    width_m: float


@dataclass(slots=True)
class Site:
    """Building under construction."""

    width_m: float
    height_m: float
    random: Random
    thick_m: float = 0.0  # thickness of the walls; 0 draws them as lines
    rooms: list[Box] = field(default_factory=list)  # free floor for furniture and start poses
    solids: list[Box] = field(default_factory=list)  # walls
    sheets: list[Box] = field(default_factory=list)  # walls of zero thickness
    things: list[Box] = field(default_factory=list)  # furniture and pillars
    askew: list[tuple[Box, NDArray[np.float64]]] = field(default_factory=list)  # rotated: bounding box, (4, 2) corners
    carved: list[Box] = field(default_factory=list)  # if not empty, everything else is solid
    clear: list[Box] = field(default_factory=list)  # must stay free: both sides of doors

    def between(self, least: float, most: float) -> float:
        """Return a random length, rounded to the millimetre."""
        return round(self.random.uniform(least, most), 3)

    def chance(self, share: float) -> bool:
        """Return True with this probability."""
        return self.random.random() < share

    # --- walls --------------------------------------------------------------------------------------------------------

    def wall(self, a: tuple[float, float], b: tuple[float, float], *doors: Door) -> None:
        """Add a wall from a to b, to the right or upwards, with doors in ascending order."""
        horizontal = a[1] == b[1]
        along, across = (0, 1) if horizontal else (1, 0)
        half = self.thick_m / 2

        def box(first: float, last: float, depth: float) -> Box:
            low, high = a[across] - depth, a[across] + depth
            return Box(first, low, last, high) if horizontal else Box(low, first, high, last)

        gaps = [(round(door.at_m - door.width_m / 2, 3), round(door.at_m + door.width_m / 2, 3)) for door in doors]
        ends = [a[along] - half, *(end for gap in gaps for end in gap), b[along] + half]
        for first, last in zip(ends[::2], ends[1::2], strict=True):
            if last - first > 1e-3:
                (self.solids if half else self.sheets).append(box(first, last, half))
        self.clear += [box(first, last, half + DOOR_M) for first, last in gaps]

    def door(self, first_m: float, last_m: float, least_m: float = 0.8, most_m: float = 2.0) -> Door:
        """Return a random door in a wall between two coordinates along the wall."""
        room = last_m - first_m - 0.6 - self.thick_m
        width = self.between(least_m, max(least_m, min(most_m, room)))
        reach = max(0.0, (room - width) / 2)
        return Door(self.between((first_m + last_m) / 2 - reach, (first_m + last_m) / 2 + reach), width)

    # --- objects ------------------------------------------------------------------------------------------------------

    def put(self, thing: Box, room: Box) -> bool:
        """Place a box in a room if robots can pass on all sides; it may touch at most one wall per axis."""
        left, right = thing.x0 - room.x0, room.x1 - thing.x1
        low, high = thing.y0 - room.y0, room.y1 - thing.y1
        for one, other in ((left, right), (low, high)):
            if min(one, other) < -1e-6 or max(one, other) < WAY_M or TOGETHER_M < min(one, other) < WAY_M:
                return False
        if not self._is_free(thing, WAY_M):
            return False
        self.things.append(thing)
        return True

    def _is_free(self, thing: Box, way_m: float) -> bool:
        if any(thing.away_m(clear) <= 0 for clear in self.clear):
            return False
        others = (*self.things, *(around for around, _ in self.askew))
        return all(thing.away_m(other) >= way_m for other in others)

    def put_rotated(self, room: Box) -> bool:
        """Place a random rotated box in a room; return whether there was space for it."""
        long, wide = self.between(0.3, 1.4), self.between(0.25, 0.7)
        r = math.hypot(long, wide) / 2
        if min(room.x1 - room.x0, room.y1 - room.y0) < 2 * (r + WAY_M):
            return False
        for _ in range(_TRIES):
            x, y = self._place(room.grown(-r - WAY_M))
            around = Box(x - r, y - r, x + r, y + r)
            if self._is_free(around, WAY_M) and all(around.away_m(wall) >= WAY_M for wall in self._standing):
                turn = self.random.uniform(-math.pi, math.pi)
                ways = np.array([[long, wide], [-long, wide], [-long, -wide], [long, -wide]]) / 2
                cosine, sine = math.cos(turn), math.sin(turn)
                self.askew.append((around, ways @ np.array([[cosine, sine], [-sine, cosine]]) + (x, y)))
                return True
        return False

    @property
    def _standing(self) -> tuple[Box, ...]:
        return (*self.solids, *self.sheets)

    def furnish(self, room: Box, count: int) -> None:
        """Place up to `count` tables, shelves, beds and chairs, most against a wall, some with a small gap to it."""
        sizes = ((0.8, 1.6), (0.35, 1.2), (0.4, 1.9), (0.95, 2.0), (1.6, 2.05), (0.45, 0.45), (0.6, 0.6))
        for _ in range(count):
            deep, long = self.random.choice(sizes)
            side = self.random.randrange(5)
            if side % 2:
                deep, long = long, deep
            # Extent along the x axis is `long`, along the y axis `deep`.
            slack = (room.x1 - room.x0 - long, room.y1 - room.y0 - deep)
            if min(slack) < WAY_M:
                continue
            for _ in range(_TRIES):
                x, y = (round(self.random.uniform(0, each), 3) for each in slack)
                gap = self.between(0.02, TOGETHER_M) if self.chance(0.3) else 0.0
                if side < 4:  # 4: free-standing
                    x, y = ((x, gap), (gap, y), (x, slack[1] - gap), (slack[0] - gap, y))[side]
                if self.put(Box(room.x0 + x, room.y0 + y, room.x0 + x + long, room.y0 + y + deep), room):
                    break

    def _place(self, box: Box) -> tuple[float, float]:
        return self.between(box.x0, box.x1), self.between(box.y0, box.y1)

    def start(self) -> tuple[float, float, float]:
        """Return a random free position and heading."""
        stands = (*self._standing, *self.things, *(around for around, _ in self.askew))
        for _ in range(1000):
            x, y = self._place(self.random.choice(self.rooms).grown(-0.45))
            here = Box(x, y, x, y)
            if all(here.away_m(each) >= 0.45 for each in stands):
                return x, y, self.between(-3.1, 3.1)
        raise AssertionError("every room has free floor between its objects")

    # --- outlines -----------------------------------------------------------------------------------------------------

    def walls(self) -> NDArray[np.float64]:
        """Return (n, 4) ends of all segments that block a robot: outlines of solids, thin walls, rotated boxes."""
        edges = [*self._edges(), *(tuple(sheet) for sheet in self.sheets)]
        corners = [np.hstack([points, np.roll(points, -1, axis=0)]) for _, points in self.askew]
        return np.vstack([np.array(edges).reshape(-1, 4), *corners])

    def _edges(self) -> Iterator[tuple[float, float, float, float]]:
        """Yield the borders between solid and free area as straight segments of full length."""
        around = Box(0.0, 0.0, self.width_m, self.height_m)
        boxes = [around, *self.solids, *self.things, *self.carved]
        xs = sorted({round(min(max(x, 0.0), self.width_m), 4) for box in boxes for x in (box.x0, box.x1)})
        ys = sorted({round(min(max(y, 0.0), self.height_m), 4) for box in boxes for y in (box.y0, box.y1)})
        solid = np.ones((len(xs) + 1, len(ys) + 1), np.bool_)

        def fill(box: Box, value: bool) -> None:
            i, k = np.searchsorted(xs, (box.x0 + 2e-4, box.x1 - 2e-4))
            j, m = np.searchsorted(ys, (box.y0 + 2e-4, box.y1 - 2e-4))
            solid[max(i, 1) : min(k, len(xs) - 1) + 1, max(j, 1) : min(m, len(ys) - 1) + 1] = value

        for box in self.carved or [around]:
            fill(box, False)
        for box in (*self.solids, *self.things):
            fill(box, True)
        step = solid.astype(np.int8)
        for i, row in enumerate(np.diff(step, axis=0)):
            for j, k in _runs(row[1:-1]):
                yield xs[i], ys[j], xs[i], ys[k]
        for j, column in enumerate(np.diff(step, axis=1).T):
            for i, k in _runs(column[1:-1]):
                yield xs[i], ys[j], xs[k], ys[j]


def _runs(steps: NDArray[np.int8]) -> Iterator[tuple[int, int]]:
    """Yield begin and end of each run of equal nonzero steps."""
    starts = [0, *(np.flatnonzero(np.diff(steps)) + 1).tolist(), len(steps)]
    for (first, last), (step, _) in zip(pairwise(starts), groupby(steps.tolist()), strict=True):
        if step:
            yield first, last
