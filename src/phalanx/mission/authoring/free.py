"""Where robots can be in a building, and how far it is from one place to another for who has a body."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from itertools import product

from phalanx.mission.landmarks import FloorPlan

# A robot's radius, 0.175 m, and a little.
STAND_M = 0.2
# And what a pilot finds its way through for certain; robots may begin nearer to things, and leave within a metre.
PASS_M, LEAVE_M = 0.25, 1.0
GRID_M = 0.2  # of where robots can be
BESIDE_M = 0.7  # a place in a wall is reached from so near
Place = tuple[float, float]
Cell = tuple[int, int]


class Free:
    """What is free in a building, and joined to where robots begin: cells of a grid.

    Args:
        room_m: that there is on a way to all sides.
    """

    def __init__(self, plan: FloorPlan, starts: Sequence[Place], room_m: float = STAND_M) -> None:
        self._starts, self._room_m = tuple(starts), room_m
        self._origin = starts[0] if starts else (0.0, 0.0)
        waiting = [self._cell(*start) for start in starts]
        self._cells = set(waiting)
        while waiting:
            for cell in _around(*waiting.pop()):
                if cell not in self._cells and self._is_free(plan, cell):
                    self._cells.add(cell)
                    waiting.append(cell)

    def places(self, x_m: float, y_m: float, within_m: float) -> Iterator[Place]:
        """x, y of all that are so near, metres; from one side to the other."""
        (i, j), reach = self._cell(x_m, y_m), math.ceil(within_m / GRID_M)
        for cell in product(range(i - reach, i + reach + 1), range(j - reach, j + reach + 1)):
            if cell in self._cells and math.dist(place := self._place(cell), (x_m, y_m)) <= within_m:
                yield place

    def is_near(self, x_m: float, y_m: float) -> bool:
        """Whether a robot can be there, or a step beside it."""
        return any(cell in self._cells for cell in _around(*self._cell(x_m, y_m)))

    def beside(self, plan: FloorPlan, place: Place) -> list[Place]:
        """Where a robot can be that is at a place, which may lie in a wall: near, and in sight of it."""
        return [each for each in self.places(*place, BESIDE_M) if plan.sees(each, place)]

    def has_way(self, ones: Sequence[Place], others: Sequence[Place], most_m: float) -> bool:
        """Whether a robot gets from one of these places to one of those others on no more than so many metres."""
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

    def _is_free(self, plan: FloorPlan, cell: Cell) -> bool:
        (x, y), (x0, y0, x1, y1) = self._place(cell), plan.bounds
        leaves = any(math.dist((x, y), start) <= LEAVE_M for start in self._starts)
        least_m = STAND_M if leaves else self._room_m
        return x0 <= x <= x1 and y0 <= y <= y1 and plan.clearance_m(x, y) >= least_m

    def _cell(self, x_m: float, y_m: float) -> Cell:
        return round((x_m - self._origin[0]) / GRID_M), round((y_m - self._origin[1]) / GRID_M)

    def _place(self, cell: Cell) -> Place:
        return self._origin[0] + GRID_M * cell[0], self._origin[1] + GRID_M * cell[1]


def _around(i: int, j: int) -> list[Cell]:
    return [(i + dx, j + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
