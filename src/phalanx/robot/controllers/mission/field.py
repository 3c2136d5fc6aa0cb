"""The cost from each cell around a robot to its goal, or to the edge and straight on: a wavefront planner's field.

Cells near things cost more, and those where the robot would touch something so much that it takes any other way first,
or waits before them.
"""

from __future__ import annotations

import math

from phalanx.arrays import F64x2, I64x1, U8x1
from phalanx.kernel import kernel

from .surroundings import HALF, PER_M, SIDE

Point = tuple[float, float]

# Of the robot's middle from everything, where it may choose; on a way once chosen; and by what it does in a second.
MARGIN_M, KEEP_M, TOUCH_M = 0.25, 0.2, 0.205
BESIDE = 2  # cells
REAR, ABOUT_COST = 3, 12  # cells, and what they cost: to turn about is as good as 2 m of way
# Distances in cells: 3 to the next, 4 to that at the corner. Nearer to a thing than two a robot touches it.
STRAIGHT, ACROSS = 3, 4
TOUCHES = 6
TOUCHING = 40
FAR_OFF = 1 << 40
# A way in the open costs 10 a cell.
PER_CELL = 10.0
TOUCHING_COST = 2000
UNSEEN_COST = 160  # straight on from the edge something is seen to be in the way
PASSES = 24
NEAR_GOAL = 3.2  # cells: a place in a wall is reached from so near


@kernel
def weight(near: int) -> int:
    """Return the cost of a step at a distance from an obstacle, in halves."""
    if near < TOUCHES:
        return TOUCHING
    if near < 8:
        return 6
    if near < 10:
        return 4
    return 3 if near < 12 else 2


@kernel
def standing(cells: U8x1, here: Point, along: tuple[float, float], points: F64x2, near: I64x1, out: I64x1) -> None:
    """Let a robot go on from where it stands to where nothing is nearer; behind it cells cost more.

    Args:
        here: where it is, in cells from the corner of the first.
        points: (k, 2) what is in the way, likewise.
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
    """Put (SIDE + 2)^2 costs to leave a cell into `out`, by how near the nearest thing is; the rest as in `standing`.

    Args:
        along: where the robot looks; of two ways that are equally good it goes on along one.
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
    """Put the straight way to the goal from cells there and at the edge into `out`, (SIDE + 2)^2, 0.01 m.

    Args:
        goal_x, goal_y, points: in cells, from the corner of the first; points (k, 2) are in the way.
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
    """Return whether something is on the straight way from here, in cells."""
    for k in range(len(points)):
        dx, dy = points[k, 0] - here[0], points[k, 1] - here[1]
        ahead = dx * along[0] + dy * along[1]
        if 0.0 < ahead < away and abs(dx * along[1] - dy * along[0]) < MARGIN_M * PER_M:
            return True
    return False


@kernel
def spread(leave: I64x1, out: I64x1) -> None:
    """(SIDE + 2)^2: the cheapest way from each cell to a seed, and on."""
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
    """The next cell of the way; the same where it ends."""
    wide = SIDE + 2
    best, least = i, costs[i]
    # A seed is where the way ends: nothing beside it is nearer.
    found = FAR_OFF
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            j = i + dy * wide + dx
            cost = costs[j] + (7 if dx and dy else 5) * leave[i]
            if costs[j] < least and cost < found:
                best, found = j, cost
    return best
