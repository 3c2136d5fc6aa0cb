"""Compose a drawn building on a rectangular site: boxes, thin walls and rotated boxes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from random import Random
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

# Between two things there is a way for a robot, 0.35 m wide, and more; or they stand together.
WAY_M = 0.8
TOGETHER_M = 0.1
# So deep is what must be free on both sides of a door.
DOOR_M = 0.9
_TRIES = 12


class Box(NamedTuple):
    """An upright rectangle: metres from the site's lower left corner."""

    x0: float
    y0: float
    x1: float
    y1: float

    def away_m(self, other: Box) -> float:
        """The distance between two boxes; 0 if they touch."""
        dx = max(0.0, self.x0 - other.x1, other.x0 - self.x1)
        dy = max(0.0, self.y0 - other.y1, other.y0 - self.y1)
        return math.hypot(dx, dy)

    def grown(self, by_m: float) -> Box:
        """With so much around it."""
        return Box(self.x0 - by_m, self.y0 - by_m, self.x1 + by_m, self.y1 + by_m)


class Door(NamedTuple):
    """A gap in a wall: where its middle is along the wall, and its width; metres."""

    at_m: float
    width_m: float


@dataclass(slots=True)
class Site:
    """A building that is being drawn."""

    width_m: float
    height_m: float
    random: Random
    thick_m: float = 0.0  # of its walls; 0 are walls without thickness
    rooms: list[Box] = field(default_factory=list)  # what can be furnished
    solids: list[Box] = field(default_factory=list)  # walls
    sheets: list[Box] = field(default_factory=list)  # walls without thickness: boxes without an inside
    things: list[Box] = field(default_factory=list)  # furniture and pillars
    askew: list[tuple[Box, NDArray[np.float64]]] = field(default_factory=list)  # what is around it, its (4, 2) corners
    carved: list[Box] = field(default_factory=list)  # if there are any, all else is solid
    clear: list[Box] = field(default_factory=list)  # what must stay free: before doors

    def between(self, least: float, most: float) -> float:
        """A random length, to the millimetre."""
        return round(self.random.uniform(least, most), 3)

    def chance(self, share: float) -> bool:
        """True in so many of all cases."""
        return self.random.random() < share

    # --- walls --------------------------------------------------------------------------------------------------------

    def wall(self, a: tuple[float, float], b: tuple[float, float], *doors: Door) -> None:
        """A wall from a to b, to the right or upwards, with doors in the order in which they come."""
        lies = a[1] == b[1]
        along, across = (0, 1) if lies else (1, 0)
        half = self.thick_m / 2

        def box(first: float, last: float, deep: float) -> Box:
            low, high = a[across] - deep, a[across] + deep
            return Box(first, low, last, high) if lies else Box(low, first, high, last)

        gaps = [(round(door.at_m - door.width_m / 2, 3), round(door.at_m + door.width_m / 2, 3)) for door in doors]
        ends = [a[along] - half, *(end for gap in gaps for end in gap), b[along] + half]
        for first, last in zip(ends[::2], ends[1::2], strict=True):
            if last - first > 1e-3:
                (self.solids if half else self.sheets).append(box(first, last, half))
        self.clear += [box(first, last, half + DOOR_M) for first, last in gaps]

    def door(self, first_m: float, last_m: float, least_m: float = 0.8, most_m: float = 2.0) -> Door:
        """A random door in a wall from here to there."""
        room = last_m - first_m - 0.6 - self.thick_m
        width = self.between(least_m, max(least_m, min(most_m, room)))
        reach = max(0.0, (room - width) / 2)
        return Door(self.between((first_m + last_m) / 2 - reach, (first_m + last_m) / 2 + reach), width)

    # --- things -------------------------------------------------------------------------------------------------------

    def put(self, thing: Box, room: Box) -> bool:
        """Put a thing into a room, if robots get past it on all sides, but for at most one wall each way."""
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
        """Return whether a box that stands askew found a place in a room."""
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
        """Up to so many tables, shelves, beds and chairs; most stand against a wall, some a little away from it."""
        sizes = ((0.8, 1.6), (0.35, 1.2), (0.4, 1.9), (0.95, 2.0), (1.6, 2.05), (0.45, 0.45), (0.6, 0.6))
        for _ in range(count):
            deep, long = self.random.choice(sizes)
            side = self.random.randrange(5)
            if side % 2:
                deep, long = long, deep
            # Lying along the x axis: `long` by `deep`.
            slack = (room.x1 - room.x0 - long, room.y1 - room.y0 - deep)
            if min(slack) < WAY_M:
                continue
            for _ in range(_TRIES):
                x, y = (round(self.random.uniform(0, each), 3) for each in slack)
                gap = self.between(0.02, TOGETHER_M) if self.chance(0.3) else 0.0
                if side < 4:  # of five the last stands free
                    x, y = ((x, gap), (gap, y), (x, slack[1] - gap), (slack[0] - gap, y))[side]
                if self.put(Box(room.x0 + x, room.y0 + y, room.x0 + x + long, room.y0 + y + deep), room):
                    break

    def _place(self, box: Box) -> tuple[float, float]:
        return self.between(box.x0, box.x1), self.between(box.y0, box.y1)

    def start(self) -> tuple[float, float, float]:
        """A free place, and a random heading."""
        stands = (*self._standing, *self.things, *(around for around, _ in self.askew))
        for _ in range(1000):
            x, y = self._place(self.random.choice(self.rooms).grown(-0.45))
            here = Box(x, y, x, y)
            if all(here.away_m(each) >= 0.45 for each in stands):
                return x, y, self.between(-3.1, 3.1)
        raise AssertionError("rooms have ways between all that stands in them")

    # --- what a robot sees of it --------------------------------------------------------------------------------------

    def walls(self) -> NDArray[np.float64]:
        """(n, 4) ends of all that stops a robot: the outside of what is solid, thin walls, things that stand askew."""
        edges = [*self._edges(), *(tuple(sheet) for sheet in self.sheets)]
        corners = [np.hstack([points, np.roll(points, -1, axis=0)]) for _, points in self.askew]
        return np.vstack([np.array(edges).reshape(-1, 4), *corners])

    def _edges(self) -> Iterator[tuple[float, float, float, float]]:
        """The borders between what is solid and what is not, each as long as it is straight."""
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
    """Return the begin and end of each run of equal steps that are not 0."""
    starts = [0, *(np.flatnonzero(np.diff(steps)) + 1).tolist(), len(steps)]
    for (first, last), (step, _) in zip(pairwise(starts), groupby(steps.tolist()), strict=True):
        if step:
            yield first, last
