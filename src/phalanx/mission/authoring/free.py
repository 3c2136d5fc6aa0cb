"""Compute the free space of a building for a robot of a given size: reachable cells and path lengths."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from itertools import pairwise, product

from phalanx.mission.landmarks import FloorPlan
from phalanx.mission.landmarks.floorplan import PASS_M

# Robots may start nearer to walls than they pass them (their radius of 0.175 m plus a margin), within 1 m of the start.
STAND_M, LEAVE_M = 0.2, 1.0
GRID_M = 0.2  # size of a cell
BESIDE_M = 0.7  # distance within which a place in a wall counts as reached
# A straight way needs room for a robot, on its line or ASIDE_M beside it, except for its ends: landmarks lie in walls.
END_M, STEP_M = 1.0, 0.2
ASIDE_M = (0.3, 0.45, 0.6)
Place = tuple[float, float]
Cell = tuple[int, int]


class Free:
    """The free grid cells of a building that are connected to the robots' start."""

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
        """Yield x, y of all free cells within a distance, in metres, ordered by x, then y."""
        (i, j), reach = self._cell(x_m, y_m), math.ceil(within_m / GRID_M)
        for cell in product(range(i - reach, i + reach + 1), range(j - reach, j + reach + 1)):
            if cell in self._cells and math.dist(place := self._place(cell), (x_m, y_m)) <= within_m:
                yield place

    def has_room(self, x_m: float, y_m: float) -> bool:
        """Return True if a robot fits there, reachable or not."""
        x0, y0, x1, y1 = self._plan.bounds
        leaves = any(math.dist((x_m, y_m), start) <= LEAVE_M for start in self._starts)
        least_m = STAND_M if leaves else PASS_M
        return x0 <= x_m <= x1 and y0 <= y_m <= y1 and self._plan.clearance_m(x_m, y_m) >= least_m

    def is_near(self, x_m: float, y_m: float) -> bool:
        """Return True if the cell of a place, or one beside it, is free and reachable."""
        return any(cell in self._cells for cell in _around(*self._cell(x_m, y_m)))

    def side_of(self, a: Place, b: Place) -> int | None:
        """Return the side of its line on which a way can be driven straight: 1 left, -1 right, None if on neither.

        A robot drives on the line itself wherever it has room, and beside it along walls.
        """
        away_m = math.dist(a, b)
        line = [END_M + i * STEP_M for i in range(round((away_m - 2 * END_M) / STEP_M) + 1)] or [away_m / 2]
        for side in (1, -1) if away_m > 0 else ():
            way = [self.on_way(a, b, metres, side) for metres in line]
            places = [place for place in way if place is not None]
            # Free cells do not ensure a free path: there may be a wall between the centres of two of them.
            is_whole = len(places) == len(way) and all(math.dist(*pair) < 2 * PASS_M for pair in pairwise(places))
            if is_whole and all(self._plan.sees(*pair) for pair in pairwise((a, *places))):
                return side
        return None

    def on_way(self, a: Place, b: Place, metres: float, side: int) -> Place | None:
        """Return a free place `metres` from a towards b, on the line or beside it; None if there is none."""
        x, y = b[0] - a[0], b[1] - a[1]
        share = metres / math.hypot(x, y)
        return next(self.beside_line((a[0] + share * x, a[1] + share * y), math.atan2(y, x), side), None)

    def beside_line(self, at: Place, along_rad: float, side: int) -> Iterator[Place]:
        """Yield places for a robot that follows a line: on it, or else on the given side, nearest first."""
        x, y = -side * math.sin(along_rad), side * math.cos(along_rad)
        if self._cell(*at) in self._cells:
            yield at
            return
        places = ((at[0] + aside_m * x, at[1] + aside_m * y) for aside_m in ASIDE_M)
        yield from (place for place in places if self._cell(*place) in self._cells)

    def again_beside(self, at: Place, along_rad: float) -> Iterator[Place]:
        """Yield free places left and right of a line, for a robot that drives around an obstacle or retries."""
        for aside_m in (ASIDE_M[0], -ASIDE_M[0], ASIDE_M[-1], -ASIDE_M[-1]):
            place = at[0] - aside_m * math.sin(along_rad), at[1] + aside_m * math.cos(along_rad)
            if self._cell(*place) in self._cells and self._plan.sees(at, place):
                yield place

    def beside(self, plan: FloorPlan, place: Place) -> list[Place]:
        """Return free places near a place that may lie in a wall, with a line of sight to it."""
        return [each for each in self.places(*place, BESIDE_M) if plan.sees(each, place)]

    def has_way(self, ones: Sequence[Place], others: Sequence[Place], most_m: float) -> bool:
        """Return True if a path of at most `most_m` leads from one of the first places to one of the others."""
        ends = {self._cell(*place) for place in others}
        if not ends:
            return False
        (x0, y0), (x1, y1) = (tuple(pick(axis) for axis in zip(*others, strict=True)) for pick in (min, max))

        def left_m(cell: Cell) -> float:  # lower bound, for A*
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
