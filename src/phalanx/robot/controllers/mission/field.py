"""Wavefront planner: the cost from each cell around a robot to its goal, or to the edge and then straight on.

Cells near obstacles cost more. Cells in which the robot would touch something cost so much that it takes any other path
first, or waits.
"""

from __future__ import annotations

import math

from phalanx.arrays import F64x2, I64x1, U8x1
from phalanx.kernel import kernel

from .surroundings import HALF, PER_M, SIDE

Point = tuple[float, float]

# Distances of the robot's centre from obstacles: for choosing a path, for keeping to it, and for the next second.
MARGIN_M, KEEP_M, TOUCH_M = 0.25, 0.2, 0.205
BESIDE = 2  # cells
REAR, ABOUT_COST = 3, 12  # cells behind the robot, and their cost: turning about costs as much as 2 m of path
# Chamfer distances: 3 to an adjacent cell, 4 to a diagonal one. At less than TOUCHES a robot touches the obstacle.
STRAIGHT, ACROSS = 3, 4
TOUCHES = 6
TOUCHING = 40
FAR_OFF = 1 << 40
# Cost of a cell far from obstacles.
PER_CELL = 10.0
TOUCHING_COST = 2000
UNSEEN_COST = 160  # of a cell at the edge from which an obstacle blocks the straight path on
PASSES = 24
NEAR_GOAL = 3.2  # distance in cells that counts as the goal, which may be inside a wall


@kernel
def weight(near: int) -> int:
    """Return the cost of a step at a chamfer distance from an obstacle, in halves."""
    if near < TOUCHES:
        return TOUCHING
    if near < 8:
        return 6
    if near < 10:
        return 4
    return 3 if near < 12 else 2


@kernel
def standing(cells: U8x1, here: Point, along: tuple[float, float], points: F64x2, near: I64x1, out: I64x1) -> None:
    """Adjust the costs next to the robot: it may move away from obstacles that it touches; cells behind it cost more.

    Args:
        here: the robot's position, in cells from the corner of the first cell.
        points: (k, 2) obstacles, likewise.
    """
    wide = SIDE + 2
    own = near[(HALF + 1) * wide + HALF + 1]
    for dy in range(-REAR, REAR + 1):
        for dx in range(-REAR, REAR + 1):
            i = (HALF + 1 + dy) * wide + HALF + 1 + dx
            if cells[(HALF + dy) * SIDE + HALF + dx]:
                continue
            if max(abs(dx), abs(dy)) <= BESIDE:
                to_x, to_y = HALF + dx + 0.5 - here[0], HALF + dy + 0.5 - here[1]
                if is_nearer(points, here, to_x, to_y):
                    out[i] = TOUCHING
                elif near[i] >= own:
                    out[i] = min(out[i], TOUCHING // 5)
            if dx * along[0] + dy * along[1] < -0.5:
                out[i] = max(out[i], ABOUT_COST)


@kernel
def is_nearer(points: F64x2, here: Point, to_x: float, to_y: float) -> bool:
    """Return whether a straight move, in cells, comes too near to an obstacle, and nearer than now."""
    whole = to_x * to_x + to_y * to_y
    for k in range(len(points)):
        dx, dy = points[k, 0] - here[0], points[k, 1] - here[1]
        now = dx * dx + dy * dy
        share = min(1.0, max(0.0, (dx * to_x + dy * to_y) / whole)) if whole > 0.0 else 0.0
        dx, dy = dx - share * to_x, dy - share * to_y
        if dx * dx + dy * dy < min(TOUCH_M * TOUCH_M, now / (PER_M * PER_M) - 0.002) * (PER_M * PER_M):
            return True
    return False


@kernel
def weights(cells: U8x1, here: Point, along: tuple[float, float], points: F64x2, out: I64x1) -> None:
    """Write the cost to leave each cell to `out`, (SIDE + 2)^2, by the distance of the nearest obstacle.

    Args:
        along: the robot's heading, which decides between equally good paths; the others are as in `standing`.
    """
    wide = SIDE + 2
    out[:] = 3 * SIDE
    for y in range(SIDE):
        for x in range(SIDE):
            if cells[y * SIDE + x]:
                out[(y + 1) * wide + x + 1] = 0
    for back in (1, -1):  # forwards, then backwards
        for y in range(1, SIDE + 1):
            for x in range(1, SIDE + 1):
                i = y * wide + x if back == 1 else wide * wide - 1 - y * wide - x
                straight = min(out[i - back], out[i - back * wide]) + STRAIGHT
                across = min(out[i - back * wide - 1], out[i - back * wide + 1]) + ACROSS
                out[i] = min(out[i], straight, across)
    near = out.copy()
    for i in range(len(out)):
        out[i] = weight(near[i])
    standing(cells, here, along, points, near, out)


@kernel
def seeds(leave: I64x1, goal_x: float, goal_y: float, points: F64x2, out: I64x1) -> None:
    """Write the cost of the straight path to the goal, from cells at the goal and at the edge, to `out`, (SIDE + 2)^2.

    Args:
        goal_x, goal_y: in cells from the corner of the first cell.
        points: (k, 2) obstacles, likewise.
    """
    wide = SIDE + 2
    out[:] = FAR_OFF
    inside = 0.0 <= goal_x < SIDE and 0.0 <= goal_y < SIDE
    for y in range(1, SIDE + 1):
        for x in range(1, SIDE + 1):
            dx, dy = x - 0.5 - goal_x, y - 0.5 - goal_y
            at_edge = x in (1, SIDE) or y in (1, SIDE)
            at_goal = inside and dx * dx + dy * dy <= NEAR_GOAL * NEAR_GOAL
            if at_edge or at_goal:
                i = y * wide + x
                away = math.sqrt(dx * dx + dy * dy)
                out[i] = int(PER_CELL * away) + (0 if leave[i] < TOUCHING else TOUCHING_COST)
                if at_edge and away > 0.0 and is_between(points, (x - 0.5, y - 0.5), (-dx / away, -dy / away), away):
                    out[i] += UNSEEN_COST


@kernel
def is_between(points: F64x2, here: tuple[float, float], along: tuple[float, float], away: float) -> bool:
    """Return whether an obstacle is on the straight path of length `away` from `here`, in cells."""
    for k in range(len(points)):
        dx, dy = points[k, 0] - here[0], points[k, 1] - here[1]
        ahead = dx * along[0] + dy * along[1]
        if 0.0 < ahead < away and abs(dx * along[1] - dy * along[0]) < MARGIN_M * PER_M:
            return True
    return False


@kernel
def spread(leave: I64x1, out: I64x1) -> None:
    """Compute the cost of the cheapest path from each cell to a seed and on, in `out`, (SIDE + 2)^2."""
    wide = SIDE + 2
    for _ in range(PASSES):
        changed = False
        for back in (1, -1):  # forwards, then backwards
            for y in range(1, SIDE + 1):
                for x in range(1, SIDE + 1):
                    i = y * wide + x if back == 1 else wide * wide - 1 - y * wide - x
                    straight = min(out[i - back], out[i - back * wide]) + 5 * leave[i]
                    across = min(out[i - back * wide - 1], out[i - back * wide + 1]) + 7 * leave[i]
                    if min(straight, across) < out[i]:
                        out[i] = min(straight, across)
                        changed = True
        if not changed:
            break


@kernel
def downhill(costs: I64x1, leave: I64x1, i: int) -> int:
    """Return the next cell on the cheapest path; `i` itself at its end."""
    wide = SIDE + 2
    best, least = i, costs[i]
    # At a seed the path ends: no adjacent cell costs less.
    found = FAR_OFF
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            j = i + dy * wide + dx
            cost = costs[j] + (7 if dx and dy else 5) * leave[i]
            if costs[j] < least and cost < found:
                best, found = j, cost
    return best
