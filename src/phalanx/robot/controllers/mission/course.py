"""Choice of direction and speed: straight to the goal if the path is free, else around obstacles.

On the path of field.py, the robot heads for the farthest point that it can reach in a straight line. It keeps this
point until it is there or an obstacle comes between: otherwise it would alternate between two equally good paths.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phalanx.arrays import F64x2, U8x1
from phalanx.kernel import kernel
from phalanx.mission.angles import atan2, sin_cos

from .field import (
    BESIDE,
    KEEP_M,
    MARGIN_M,
    PER_CELL,
    TOUCH_M,
    TOUCHING,
    Point,
    downhill,
    seeds,
    spread,
    weights,
)
from .surroundings import CELL_M, HALF, PER_M, SIDE, Pose, Seen, Stop, free_way, look

SPEED_MPS = 0.6
TURN_RADPS = 1.2
TURN_GAIN = 1.5
# Cosines of the bearing: below ABOUT the robot turns on the spot, and below BEHIND it may turn to either side.
ABOUT, BEHIND = 0.25, -0.94
SHORT_M, SLOW_M = 0.4, 1.0
LOOK_M, BEYOND_LOOK_M = 2.0, 3.0  # length of straight path that must be free
NO_STOP = -(1 << 31)
REACHED_M = 0.3
# Before a detour that leads aside (cosine below ASIDE) or costs LONGER more, the robot waits: people walk on.
ASIDE, LONGER, WAIT_S = 0.7, 100, 2.0
LOOK_S = 3.0  # time for which a robot that does not know its target's position then looks around, once
FORGETS = 3.0  # seconds of waiting that are cancelled per metre of progress
BEFORE_M = 0.5  # distance from an obstacle at which it waits: the target may be in a wall, or the obstacle a person
AHEAD_STEPS = 13  # cells of the path that are searched for a point to head for
CM_PER_M = 100.0
ARC_S, ARC_STEPS = 1.0, 8
CREEP_MPS, ASIDE_STEPS, ON_COURSE_RADPS = 0.1, 3, 0.15
NEARBY_M = 1.0


class Goal(NamedTuple):
    """Goal of a robot, in its own frame."""

    at: Point
    beyond: Point  # goal of a detour
    looks: bool  # whether the position of the target is unknown


class Course(NamedTuple):
    """State of driving to a goal, kept from step to step."""

    stop: Stop = (NO_STOP, NO_STOP)  # point of a detour that the robot heads for, cm, odometry frame
    # 1 or -1 while the robot turns about to the left or to the right; 2 or -2 afterwards; 0 before the first time
    turning: int = 0
    waited_s: float = 0.0  # time of waiting before a long detour


@kernel
def around(
    cells: U8x1, base: Stop, moved: Pose, goal: tuple[float, float], points: F64x2, count: int
) -> tuple[float, float, bool, bool]:
    """Return the next point of a detour, x and y, robot frame; whether to wait before it; whether it is long."""
    wide = SIDE + 2
    leave, costs = np.empty(wide * wide, np.int64), np.empty(wide * wide, np.int64)
    sine, cosine = sin_cos(moved[2])
    # In cells from the corner of the first cell.
    here_x, here_y = moved[0] / CELL_M - base[0], moved[1] / CELL_M - base[1]
    there = np.empty((count, 2))
    for k in range(count):
        px, py = points[k, 0], points[k, 1]
        there[k, 0] = here_x + (cosine * px - sine * py) * PER_M
        there[k, 1] = here_y + (sine * px + cosine * py) * PER_M
    weights(cells, (here_x, here_y), (cosine, sine), there, leave)
    goal_x = here_x + (cosine * goal[0] - sine * goal[1]) * PER_M
    goal_y = here_y + (sine * goal[0] + cosine * goal[1]) * PER_M
    seeds(leave, goal_x, goal_y, there, costs)
    spread(leave, costs)
    i = (HALF + 1) * wide + HALF + 1
    least, goal_m = costs[i], math.sqrt(goal[0] * goal[0] + goal[1] * goal[1])
    ahead, aside, steps, is_straight = 0.0, 0.0, 0, True
    to_x, to_y = 0.0, 0.0
    for step in range(AHEAD_STEPS):
        j = downhill(costs, leave, i)
        if j == i or leave[j] == TOUCHING:
            break
        i = j
        dx = (base[0] + i % wide - 0.5) * CELL_M - moved[0]
        dy = (base[1] + i // wide - 0.5) * CELL_M - moved[1]
        to_x, to_y = cosine * dx + sine * dy, cosine * dy - sine * dx
        away = math.sqrt(to_x * to_x + to_y * to_y)
        is_straight = is_straight and (
            step < BESIDE or free_way(points, count, to_x / away, to_y / away, MARGIN_M - 0.02) >= away
        )
        if is_straight:
            ahead, aside, steps = to_x, to_y, step + 1
    along = to_x * goal[0] + to_y * goal[1]
    is_long = (
        along <= ASIDE * goal_m * math.sqrt(to_x * to_x + to_y * to_y) or least > PER_CELL * PER_M * goal_m + LONGER
    )
    if steps == 0:  # an obstacle is right in front
        j = downhill(costs, leave, i)
        dx = (base[0] + j % wide - 0.5) * CELL_M - moved[0]
        dy = (base[1] + j // wide - 0.5) * CELL_M - moved[1]
        return cosine * dx + sine * dy, cosine * dy - sine * dx, True, is_long
    return ahead, aside, False, is_long


@kernel
def touches(points: F64x2, count: int, speed_mps: float, turn_radps: float) -> bool:
    """Return whether a second of driving at these speeds comes too near to an obstacle, and nearer than now."""
    part = ARC_S / ARC_STEPS
    xs, ys = np.empty(ARC_STEPS), np.empty(ARC_STEPS)
    x, y = 0.0, 0.0
    for step in range(ARC_STEPS):
        sine, cosine = sin_cos((step + 0.5) * part * turn_radps)
        x += part * speed_mps * cosine
        y += part * speed_mps * sine
        xs[step], ys[step] = x, y
    for k in range(count):
        px, py = points[k, 0], points[k, 1]
        now = px * px + py * py
        if now > NEARBY_M * NEARBY_M:
            continue
        limit = min(TOUCH_M * TOUCH_M, now - 0.002)
        for step in range(ARC_STEPS):
            if (px - xs[step]) * (px - xs[step]) + (py - ys[step]) * (py - ys[step]) < limit:
                return True
    return False


@kernel
def command(
    points: F64x2, count: int, to: tuple[float, float], left_m: float, turning: int
) -> tuple[float, float, int]:
    """Return speed, turn rate and `turning` to a point in free sight; `left_m` is the distance to the goal.

    A robot that turns about continues in the same direction until the point is ahead: otherwise a point at the edge of
    the view would be lost at once. It alternates the direction of turns to points behind, so that errors of its
    odometry cancel.
    """
    away = math.sqrt(to[0] * to[0] + to[1] * to[1])
    cosine = to[0] / away if away > 0.0 else 1.0
    bearing = atan2(to[1], to[0])
    if cosine < ABOUT:
        if abs(turning) != 1:
            side = 1 if bearing >= 0.0 else -1
            turning = -turning // 2 if turning and cosine < BEHIND else side
        return 0.0, turning * TURN_RADPS, turning
    if abs(turning) == 1:
        turning *= 2
    turn = max(-TURN_RADPS, min(TURN_RADPS, TURN_GAIN * bearing))
    ahead = cosine * cosine
    room = free_way(points, count, 1.0, 0.0, KEEP_M)
    slow = min(1.0, max(0.2, room - 0.2), max(0.2, left_m / SLOW_M))
    speed = SPEED_MPS * (ahead * ahead) * slow
    for _ in range(3):
        if not touches(points, count, speed, turn):
            return speed, turn, turning
        speed *= 0.5
    if abs(turn) > ON_COURSE_RADPS:
        return 0.0, turn, turning
    # On its course the robot would touch something beside it, so it first creeps away from that.
    for step in range(1, ASIDE_STEPS + 1):
        for way in (1.0, -1.0):
            aside = way * step * TURN_RADPS / ASIDE_STEPS
            if not touches(points, count, CREEP_MPS, aside):
                return CREEP_MPS, aside, turning
    return 0.0, turn, turning


@kernel
def looking(for_s: float) -> float:
    """Return the turn rate of looking around: 45 degrees to each side, for a lidar of 270 degrees; errors cancel."""
    part = for_s / LOOK_S
    part -= int(part)
    return -TURN_RADPS if 0.25 <= part < 0.75 else TURN_RADPS


@kernel
def _rested(waited_s: float, way_m: float) -> float:
    """Return the waiting time after progress of `way_m`, so that a robot that stops again soon waits less.

    Turning on the spot is no progress: otherwise looking around and turning back would alternate for ever.
    """
    return max(0.0, min(waited_s, WAIT_S + LOOK_S) - FORGETS * way_m)


@kernel
def steer(seen: Seen, wanted: Goal, course: Course, past_s: float, cells: U8x1) -> tuple[float, float, Stop, Course]:
    """Return speed, turn rate, base and course, `past_s` after the last step; write the cells to `cells`, as `look`."""
    goal, moved = wanted.at, seen.moved
    stop, turning, waited_s = course
    points = np.empty((len(seen.clear) + SIDE * SIDE, 2))
    base_x, base_y, count = look(seen, cells, points)
    base = base_x, base_y
    left_m = math.sqrt(goal[0] * goal[0] + goal[1] * goal[1])
    if left_m < 0.5 * SHORT_M:  # arrived: look around
        return 0.0, looking(waited_s), base, Course((NO_STOP, NO_STOP), turning, waited_s + past_s)
    # A straight course ends when an obstacle is near; a detour ends when a longer path ahead is free.
    along, look_m = goal, LOOK_M
    if stop[0] != NO_STOP:
        along, look_m = wanted.beyond, BEYOND_LOOK_M
    length_m = math.sqrt(along[0] * along[0] + along[1] * along[1])
    need = min(look_m, max(0.0, length_m - SHORT_M))
    if length_m > 0.0 and free_way(points, count, along[0] / length_m, along[1] / length_m, MARGIN_M) >= need:
        speed, turn, turning = command(points, count, goal, left_m, turning)
        return speed, turn, base, Course((NO_STOP, NO_STOP), turning, _rested(waited_s, speed * past_s))
    sine, cosine = sin_cos(moved[2])
    to_x, to_y, away = 0.0, 0.0, 0.0
    has_progress = False
    if stop[0] != NO_STOP:
        dx, dy = stop[0] / CM_PER_M - moved[0], stop[1] / CM_PER_M - moved[1]
        to_x, to_y = cosine * dx + sine * dy, cosine * dy - sine * dx
        away = math.sqrt(to_x * to_x + to_y * to_y)
    if away < REACHED_M or free_way(points, count, to_x / away, to_y / away, KEEP_M) < away:
        to_x, to_y, waits, is_long = around(cells, base, moved, wanted.beyond, points, count)
        has_progress = not is_long
        if is_long and waited_s <= (WAIT_S + LOOK_S if wanted.looks else WAIT_S):
            free_m = free_way(points, count, goal[0] / left_m, goal[1] / left_m, MARGIN_M) - BEFORE_M
            if free_m <= 0.0 or waited_s > WAIT_S:
                turn = looking(waited_s - WAIT_S) if waited_s > WAIT_S else 0.0
                return 0.0, turn, base, Course((NO_STOP, NO_STOP), turning, waited_s + past_s)
            speed, turn, turning = command(points, count, goal, free_m, turning)
            return speed, turn, base, Course((NO_STOP, NO_STOP), turning, waited_s)
        if waits:  # blocked in the grid of cells; in a narrow place there may still be a path between their centres
            speed, turn, turning = command(points, count, (to_x, to_y), left_m, turning)
            return min(speed, CREEP_MPS), turn, base, Course((NO_STOP, NO_STOP), turning, waited_s)
        x = moved[0] + (cosine * to_x - sine * to_y)
        y = moved[1] + (sine * to_x + cosine * to_y)
        stop = int(x * CM_PER_M + (1 << 30)) - (1 << 30), int(y * CM_PER_M + (1 << 30)) - (1 << 30)
    speed, turn, turning = command(points, count, (to_x, to_y), left_m, turning)
    if has_progress:
        waited_s = _rested(waited_s, speed * past_s)
    return speed, turn, base, Course(stop, turning, waited_s)
