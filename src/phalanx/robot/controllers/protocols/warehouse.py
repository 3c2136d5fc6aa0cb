"""Multi-agent path finding in a warehouse: robots carry goods from shelves to stations, one robot per cell.

A robot finds its path by A*; each lane has a preferred direction. It requests a cell in one broadcast (`wants`), and
claims it in a later one (`holds`). Before that it must have received a broadcast of every other robot since the
request: no robot may hold or occupy the cell, and none with a lower id may want it. So two robots never hold the same
cell, unless one misses four broadcasts of another in a row. A robot releases its last cell on arrival at the next. A
silent robot blocks the cell of its last position for good, and the cells nearby that it claimed.

Source: RoboRebound §2.1 (MAPF); Hart, Nilsson and Raphael 1968 (A*); Wurman, D'Andrea and Mountz 2008;
docs/guides/protocols.md.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Collection, Iterator
from functools import cache

from phalanx.errors import UsageError
from phalanx.robot.controllers.peers import Peer, PeerController
from phalanx.robot.controllers.protocol import Point, Protocol, Stage, Task, squared_m
from phalanx.wire.protocols import NOWHERE

CELLS_A_STEP = 3  # robots start on every third cell, where lanes cross
# Extra cost of a cell: against the lane's direction, occupied by a robot, occupied by a silent robot.
AGAINST, BEHIND, STUCK = 20, 2, 60
ARRIVED = 0.3  # distance from a cell's centre that counts as arrived, in cells
FITS_CELLS = 1.5  # largest distance of a robot from a cell that it has claimed, in cells
BEYOND_CELLS = 1.3  # distance at which an errand counts as done, in cells: a stopped robot may block its cell

MOST_CELLS = 100_000  # which takes about a second to set up


class Floor:
    """Cells of a warehouse, numbered from the corner at the origin. Raises: UsageError: more than MOST_CELLS.

    Attributes:
        picks, stations: cells off the crossings: beside shelves, and in the first row.
    """

    def __init__(self, task: Task) -> None:
        self.task, self.cell_m = task, task.step_m / CELLS_A_STEP
        far_m = [*task.starts_m, *((box.right_m, box.top_m) for box in task.boxes)]
        self.columns, self.rows = (math.ceil(max(axis) / self.cell_m) + 1 for axis in zip(*far_m, strict=True))
        if self.columns * self.rows > MOST_CELLS:
            raise UsageError(
                f"warehouse of {self.columns} by {self.rows} cells",
                f"use at most {MOST_CELLS}: put shelves closer to the origin",
            )
        cells = range(self.columns * self.rows)
        self.shelves = frozenset(cell for cell in cells if self._is_shelf(*self.middle(cell)))
        lanes = [cell for cell in cells if cell not in self.shelves and len(list(self.around(cell))) == 2]
        self.stations = tuple(cell for cell in lanes if 0 < cell < self.columns - 1) or (0,)
        self.picks = tuple(cell for cell in lanes if cell >= self.columns) or tuple(cells)

    def _is_shelf(self, x: float, y: float) -> bool:
        return any(b.left_m <= x <= b.right_m and b.bottom_m <= y <= b.top_m for b in self.task.boxes)

    def middle(self, cell: int) -> Point:
        """Return the centre of a cell, m."""
        return cell % self.columns * self.cell_m, cell // self.columns * self.cell_m

    def cell_at(self, place_m: Point) -> int:
        """Return the cell nearest to a position."""
        x, y = (round(at / self.cell_m) for at in place_m)
        return int(min(self.rows - 1, max(0, y)) * self.columns + min(self.columns - 1, max(0, x)))

    def around(self, cell: int) -> Iterator[tuple[int, int]]:
        """Yield the adjacent cells with their costs; the preferred direction alternates from lane to lane."""
        x, y = cell % self.columns, cell // self.columns
        east, north = y // CELLS_A_STEP % 2 == 0, x // CELLS_A_STEP % 2 == 1
        for dx, dy, along in ((1, 0, east), (-1, 0, not east), (0, 1, north), (0, -1, not north)):
            if 0 <= x + dx < self.columns and 0 <= y + dy < self.rows:
                beside = cell + dx + dy * self.columns
                if beside not in self.shelves:
                    yield beside, 1 if along else 1 + AGAINST

    def goal(self, rob_id: int, leg: int) -> int:
        """Return the target cell of a robot's errand: a shelf on even legs, a station on odd ones."""
        cells = self.stations if leg % 2 else self.picks
        return cells[(7 * rob_id + 13 * leg + 5 * self.task.seed) % len(cells)]

    def way(self, start: int, goal: int, more: dict[int, int]) -> list[int]:
        """Return the cheapest path by A*, without its start, or []; `more` has extra costs of cells."""
        goal_x, goal_y = goal % self.columns, goal // self.columns
        best, seen = [(0, 0, start, start)], {}
        while best:
            _, spent, cell, before = heapq.heappop(best)
            if cell in seen:
                continue
            seen[cell] = before
            if cell == goal:
                way = []
                while cell != start:
                    way.append(cell)
                    cell = seen[cell]
                return way[::-1]
            for beside, cost in self.around(cell):
                if beside not in seen:
                    cost_there = spent + cost + more.get(beside, 0)
                    left = abs(beside % self.columns - goal_x) + abs(beside // self.columns - goal_y)
                    heapq.heappush(best, (cost_there + left, cost_there, beside, cell))
        return []


class Warehouse(PeerController):
    """Robot of the warehouse."""

    def __init__(self, rob_id: int, task: Task) -> None:
        super().__init__(rob_id, task)
        self.floor = _floor_of(task)
        self.here = self.floor.cell_at(task.starts_m[rob_id - 1])
        for other in self.others.values():  # robots stay at their start until their first broadcast
            other.here = self.floor.cell_at((other.x_m, other.y_m))

    def turn(self, t_ms: int, place_m: Point) -> None:
        """Update the cells that the robot occupies, holds and wants."""
        floor = self.floor
        if self.holds != NOWHERE and _near(place_m, floor.middle(self.holds), ARRIVED * floor.cell_m):
            self.here, self.holds = self.holds, NOWHERE
        if self.wants != NOWHERE and self.holds == NOWHERE and self._may_hold(self.wants, t_ms):
            self.holds, self.wants = self.wants, NOWHERE
        goal = floor.goal(self.rob_id, self.done)
        if _near(place_m, floor.middle(goal), BEYOND_CELLS * floor.cell_m):
            self.done += 1
            goal = floor.goal(self.rob_id, self.done)
        more: dict[int, int] = {}
        for other in self.others.values():
            for cell in self._cells(other, t_ms):
                more[cell] = STUCK if self.is_silent(other, t_ms) else BEHIND
        way = floor.way(self.here if self.holds == NOWHERE else self.holds, goal, more)
        self.wants = way[0] if way else NOWHERE

    def _may_hold(self, cell: int, t_ms: int) -> bool:
        return not any(
            cell in self._cells(other, t_ms)
            or (not self.is_silent(other, t_ms) and self._waits_for(rob_id, other, cell, t_ms))
            for rob_id, other in self.others.items()
        )

    def _cells(self, other: Peer, t_ms: int) -> list[int]:
        # A silent robot may have been stopped for false claims: only claims near its last position count.
        at_m, cells = (other.x_m, other.y_m), [other.here, other.holds]
        if self.is_silent(other, t_ms):
            cells = [cell for cell in cells if _near(at_m, self.floor.middle(cell), FITS_CELLS * self.floor.cell_m)]
        return [self.floor.cell_at(at_m), *cells]

    def _waits_for(self, rob_id: int, other: Peer, cell: int, t_ms: int) -> bool:
        # Before claiming a cell, a robot must have received a broadcast of each other robot since its request. So of
        # two robots that want a cell, the later one knows that the other holds or wants it too.
        return t_ms - other.heard_ms >= self.period_ms or (cell == other.wants and rob_id < self.rob_id)

    def target_point(self) -> Point:
        """Return the centre of the cell that the robot holds or occupies."""
        return self.floor.middle(self.here if self.holds == NOWHERE else self.holds)


class Errands(Stage):
    """Errands from a shelf to a station; a delivery is a visit to both."""

    counts = "deliveries"
    lost = "decrease of the deliveries by correct robots"
    bites_from = 2.0
    shared = False

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self._floor = _floor_of(task)
        self._legs = dict.fromkeys(range(1, len(task.starts_m) + 1), 0)

    def look(self, rob_id: int, _t_s: float, place_m: Point, *, lies: bool) -> bytes:
        """Record that an honest robot has reached its shelf or station."""
        goal_m = self._floor.middle(self._floor.goal(rob_id, self._legs[rob_id]))
        if not lies and _near(place_m, goal_m, BEYOND_CELLS * self._floor.cell_m):
            self._legs[rob_id] += 1
        return b""

    def marks(self) -> list[Point]:
        """Return the positions of the stations."""
        return [self._floor.middle(cell) for cell in self._floor.stations]

    def score(self, left_out: Collection[int]) -> float:
        """Return the number of deliveries."""
        return float(sum(legs // 2 for rob_id, legs in self._legs.items() if rob_id not in left_out))


def _near(one_m: Point, other_m: Point, within_m: float) -> bool:
    return squared_m(one_m, other_m) <= within_m * within_m


@cache
def _floor_of(task: Task) -> Floor:
    return Floor(task)


PROTOCOL = Protocol(Warehouse, Errands)
