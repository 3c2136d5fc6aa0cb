"""Compute free space of a building for a robot with a body: reachable cells and path lengths."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from itertools import pairwise, product

from phalanx.mission.landmarks import FloorPlan
from phalanx.mission.landmarks.floorplan import PASS_M

# Robots may begin nearer to things than they pass them, a radius of 0.175 m and a little, and leave within a metre.
STAND_M, LEAVE_M = 0.2, 1.0
GRID_M = 0.2  # of where robots can be
BESIDE_M = 0.7  # a place in a wall is reached from so near
# Ways end in walls, where landmarks lie: the rest of a straight one has room for a robot, or so far beside its line.
END_M, STEP_M = 1.0, 0.2
ASIDE_M = (0.3, 0.45, 0.6)
Place = tuple[float, float]
Cell = tuple[int, int]


class Free:
    """Grid cells of a building that are free and connected to the robots' start."""

    def __init__(self, plan: FloorPlan, starts: Sequence[Place]) -> None:
        self._plan, self._starts = plan, tuple(starts)
        self._origin = starts[0] if starts else (0.0, 0.0)
        waiting = [self._cell(*start) for start in starts]
        self._cells = set(waiting)
        while waiting:
            for cell in _around(*waiting.pop()):
                if cell not in self._cells and self.has_room(*self._place(cell)):
                    self._cells.add(cell)
                    waiting.append(cell)

    def places(self, x_m: float, y_m: float, within_m: float) -> Iterator[Place]:
        """x, y of all that are so near, metres; from one side to the other."""
        (i, j), reach = self._cell(x_m, y_m), math.ceil(within_m / GRID_M)
        for cell in product(range(i - reach, i + reach + 1), range(j - reach, j + reach + 1)):
            if cell in self._cells and math.dist(place := self._place(cell), (x_m, y_m)) <= within_m:
                yield place

    def has_room(self, x_m: float, y_m: float) -> bool:
        """Return whether a robot can be there, if it gets there."""
        x0, y0, x1, y1 = self._plan.bounds
        leaves = any(math.dist((x_m, y_m), start) <= LEAVE_M for start in self._starts)
        least_m = STAND_M if leaves else PASS_M
        return x0 <= x_m <= x1 and y0 <= y_m <= y1 and self._plan.clearance_m(x_m, y_m) >= least_m

    def is_near(self, x_m: float, y_m: float) -> bool:
        """Return whether a robot can be there, or a step beside it."""
        return any(cell in self._cells for cell in _around(*self._cell(x_m, y_m)))

    def side_of(self, a: Place, b: Place) -> int | None:
        """On which side of its line a way can be driven straight: 1 the left, -1 the right; None on neither.

        Where the line has room it is driven there; one that runs along a wall leads past what is behind that.
        """
        away_m = math.dist(a, b)
        line = [END_M + i * STEP_M for i in range(round((away_m - 2 * END_M) / STEP_M) + 1)] or [away_m / 2]
        for side in (1, -1) if away_m > 0 else ():
            way = [self.on_way(a, b, metres, side) for metres in line]
            places = [place for place in way if place is not None]
            # Room is a cell's, and a line may pass between the middles of two: there may be a wall between.
            is_whole = len(places) == len(way) and all(math.dist(*pair) < 2 * PASS_M for pair in pairwise(places))
            if is_whole and all(self._plan.sees(*pair) for pair in pairwise((a, *places))):
                return side
        return None

    def on_way(self, a: Place, b: Place, metres: float, side: int) -> Place | None:
        """Return a free place so many metres from a towards b, on the line or beside it; None if there is none."""
        x, y = b[0] - a[0], b[1] - a[1]
        share = metres / math.hypot(x, y)
        return next(self.beside_line((a[0] + share * x, a[1] + share * y), math.atan2(y, x), side), None)

    def beside_line(self, at: Place, along_rad: float, side: int) -> Iterator[Place]:
        """Return where a robot that follows a line can be: on it, or else on this side, nearest first."""
        x, y = -side * math.sin(along_rad), side * math.cos(along_rad)
        if self._cell(*at) in self._cells:
            yield at
            return
        places = ((at[0] + aside_m * x, at[1] + aside_m * y) for aside_m in ASIDE_M)
        yield from (place for place in places if self._cell(*place) in self._cells)

    def again_beside(self, at: Place, along_rad: float) -> Iterator[Place]:
        """Return free places left and right of a line's end, for a robot that goes around or retries."""
        for aside_m in (ASIDE_M[0], -ASIDE_M[0], ASIDE_M[-1], -ASIDE_M[-1]):
            place = at[0] - aside_m * math.sin(along_rad), at[1] + aside_m * math.cos(along_rad)
            if self._cell(*place) in self._cells and self._plan.sees(at, place):
                yield place

    def beside(self, plan: FloorPlan, place: Place) -> list[Place]:
        """Return free places near a place, which may lie in a wall, and in sight of it."""
        return [each for each in self.places(*place, BESIDE_M) if plan.sees(each, place)]

    def has_way(self, ones: Sequence[Place], others: Sequence[Place], most_m: float) -> bool:
        """Return whether a robot gets from one of these places to one of those on at most so many metres."""
        ends = {self._cell(*place) for place in others}
        if not ends:
            return False
        (x0, y0), (x1, y1) = (tuple(pick(axis) for axis in zip(*others, strict=True)) for pick in (min, max))

        def left_m(cell: Cell) -> float:  # at least
            x, y = self._place(cell)
            return math.hypot(max(x0 - x, 0.0, x - x1), max(y0 - y, 0.0, y - y1))

        heap = [(left_m(cell), 0.0, cell) for cell in (self._cell(*place) for place in ones)]
        heapq.heapify(heap)
        done: set[Cell] = set()
        while heap and heap[0][0] <= most_m:
            _, so_far_m, cell = heapq.heappop(heap)
            if cell in ends:
                return True
            if cell in done:
                continue
            done.add(cell)
            for other in _around(*cell):
                if other in self._cells and other not in done:
                    way_m = so_far_m + GRID_M * math.dist(cell, other)
                    heapq.heappush(heap, (way_m + left_m(other), way_m, other))
        return False

    def _cell(self, x_m: float, y_m: float) -> Cell:
        return round((x_m - self._origin[0]) / GRID_M), round((y_m - self._origin[1]) / GRID_M)

    def _place(self, cell: Cell) -> Place:
        return self._origin[0] + GRID_M * cell[0], self._origin[1] + GRID_M * cell[1]


def _around(i: int, j: int) -> list[Cell]:
    return [(i + dx, j + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
