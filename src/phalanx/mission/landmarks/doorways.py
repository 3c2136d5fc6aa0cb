"""Corners → doorways and rooms, in the robot's frame.

A doorway is two concave corners the right distance apart, in one line with the walls beside them, with nothing but
free rays between. A room is three consecutive convex corners, joined by two walls seen from end to end.
"""

from __future__ import annotations

import math

import numpy as np

from phalanx.arrays import BOOLx1, F64x2, I64x1
from phalanx.kernel import kernel

from .corners import AFTER, BEAM, BEFORE, CONVEX, CORNER_X, CORNER_Y, next_beam
from .scan import Limits, View
from .walls import ALONG_X, ALONG_Y, FROM_X, FROM_Y, TO_X, TO_Y

Pair = tuple[float, float]

# Hits so near to a jamb are the jamb's: its inner face, or its edge with the sensor's noise.
JAMB_M = 0.1
HIDDEN = -1.0
# Jambs are found to within so much: a door exactly as narrow as the limit is one.
WIDTH_SLACK_M = 0.05
# Columns of an array of doorways: middle, a unit vector along the wall, distance of the jambs, thickness of the wall.
DOOR_X, DOOR_Y, DOOR_ALONG_X, DOOR_ALONG_Y, WIDTH, DEPTH = range(6)


@kernel
def _is_open(v: View, from_beam: int, to_beam: int, a: Pair, b: Pair, clear_m: float) -> bool:
    """Whether all beams from `from_beam` to `to_beam` pass between jambs a and b; half of them must say something.

    Nothing may be hit before the line of the jambs, nor behind it up to `clear_m`: a closed door, an alcove.
    """
    ranges, n = v.ranges, len(v.ranges)
    ax, ay = a
    along_x, along_y = b[0] - ax, b[1] - ay
    width = math.sqrt(along_x * along_x + along_y * along_y)
    along_x, along_y = along_x / width, along_y / width
    robot = ay * along_x - ax * along_y
    said, asked = 0, 0
    k = from_beam
    while True:
        asked += 1
        if not np.isnan(ranges[k]):
            said += 1
        # A miss hits nothing.
        if np.isfinite(ranges[k]):
            dx, dy = ranges[k] * v.cosines[k] - ax, ranges[k] * v.sines[k] - ay
            at = dx * along_x + dy * along_y
            behind = dy * along_x - dx * along_y
            if robot < 0.0:
                behind = -behind
            if behind < -JAMB_M or (behind < clear_m and JAMB_M < at < width - JAMB_M):
                return False
        if k == to_beam:
            return 2 * said >= asked
        k = (k + 1) % n


@kernel
def _depth_behind(v: View, i: int, step: int, jamb: Pair, along: Pair, limit_m: float) -> float:
    """How deep the jamb's face goes that begins at point i, straight behind the jamb; 0 if there is none.

    HIDDEN if something before it hides its end: how thick the wall is cannot be told.
    """
    (jamb_x, jamb_y), (along_x, along_y) = jamb, along
    robot = jamb_x * along_y - jamb_y * along_x
    deepest = 0.0
    while 0 <= i + step < len(v.x) and not v.new_run[max(i, i + step)]:
        i += step
        dx, dy = v.x[i] - jamb_x, v.y[i] - jamb_y
        off = dx * along_y - dy * along_x
        if robot < 0.0:
            off = -off
        if abs(dx * along_x + dy * along_y) > JAMB_M:
            return deepest
        if off > limit_m:
            # A wall that begins at the jamb: how thick the other one is cannot be seen.
            return 0.0
        deepest = max(deepest, off)
    if deepest > JAMB_M:
        beam = int(v.beam[i])
        there = next_beam(v, beam, step)
        if there < 0 or v.ranges[there] < v.ranges[beam]:
            return HIDDEN
    return deepest


@kernel
def _point_at(beam: I64x1, at: float) -> int:
    """The first point whose beam is past `at`."""
    low, high = 0, len(beam)
    while low < high:
        middle = (low + high) // 2
        if beam[middle] > at:
            high = middle
        else:
            low = middle + 1
    return low


@kernel
def doorways_of(v: View, limits: Limits, walls: F64x2, corners: F64x2) -> tuple[F64x2, BOOLx1]:
    """(d, 6) doorways, and which corners are jambs.

    Source: Encoded graphs Alg. 1, Eq. 1; free rays, mid-wall: docs/adr/0019.
    """
    doors = np.empty((len(corners), 6))
    is_jamb = np.zeros(len(corners), np.bool_)
    n = len(v.ranges)
    bend_cosine, depth_max_m = limits.bend_cosine, limits.door_depth_m
    found = 0
    for i in range(len(corners)):
        # The wall ends at jamb i, then comes the opening, and at jamb j the wall goes on.
        if corners[i, CONVEX] != 0.0 or corners[i, BEFORE] < 0.0:
            continue
        before = int(corners[i, BEFORE])
        for j in range(len(corners)):
            if corners[j, CONVEX] != 0.0 or corners[j, AFTER] < 0.0 or not (j > i or (v.full_turn and j < i)):
                continue
            after = int(corners[j, AFTER])
            ax, ay, bx, by = corners[i, CORNER_X], corners[i, CORNER_Y], corners[j, CORNER_X], corners[j, CORNER_Y]
            dx, dy = bx - ax, by - ay
            width = math.sqrt(dx * dx + dy * dy)
            if not limits.door_min_m - WIDTH_SLACK_M <= width <= limits.door_max_m + WIDTH_SLACK_M:
                continue
            if (
                walls[before, ALONG_X] * dx + walls[before, ALONG_Y] * dy < bend_cosine * width
                or walls[after, ALONG_X] * dx + walls[after, ALONG_Y] * dy < bend_cosine * width
            ):
                continue
            from_beam = int(corners[i, BEAM] + 1.0) % n
            to_beam = int(corners[j, BEAM] + n) % n
            if not _is_open(v, from_beam, to_beam, (ax, ay), (bx, by), limits.door_clear_m):
                continue
            # The walls are longer than the opening, and so give its direction better than the jambs.
            first = _length(walls, before)
            second = _length(walls, after)
            along_x = first * walls[before, ALONG_X] + second * walls[after, ALONG_X]
            along_y = first * walls[before, ALONG_Y] + second * walls[after, ALONG_Y]
            length = math.sqrt(along_x * along_x + along_y * along_y)
            along_x, along_y = along_x / length, along_y / length
            middle_x, middle_y = 0.5 * (ax + bx), 0.5 * (ay + by)
            last = _point_at(v.beam, corners[i, BEAM]) - 1
            first_after = _point_at(v.beam, corners[j, BEAM])
            along = (along_x, along_y)
            near = _depth_behind(v, last, 1, (ax, ay), along, depth_max_m) if last >= 0 else 0.0
            far = _depth_behind(v, first_after, -1, (bx, by), along, depth_max_m) if first_after < len(v.beam) else 0.0
            is_jamb[i] = True
            is_jamb[j] = True
            if min(near, far) == HIDDEN:
                break
            depth = max(near, far)
            # Away from the robot, to the middle of the wall.
            side = 0.5 * depth if middle_x * along_y - middle_y * along_x >= 0.0 else -0.5 * depth
            doors[found, DOOR_X] = middle_x + side * along_y
            doors[found, DOOR_Y] = middle_y - side * along_x
            doors[found, DOOR_ALONG_X], doors[found, DOOR_ALONG_Y] = along_x, along_y
            doors[found, WIDTH], doors[found, DEPTH] = width, depth
            found += 1
            break
    return doors[:found], is_jamb


@kernel
def _length(walls: F64x2, w: int) -> float:
    dx, dy = walls[w, TO_X] - walls[w, FROM_X], walls[w, TO_Y] - walls[w, FROM_Y]
    return math.sqrt(dx * dx + dy * dy)


@kernel
def rooms_of(corners: F64x2, room_min_m2: float) -> F64x2:
    """(r, 3): centroid and area of the triangle of each three consecutive convex corners.

    Source: Encoded graphs Alg. 1, Eq. 3.
    """
    rooms = np.empty((len(corners), 3))
    found = 0
    for i in range(len(corners) - 2):
        chained = True
        for j in range(i, i + 3):
            if corners[j, CONVEX] != 1.0 or (j > i and corners[j, BEFORE] != corners[j - 1, AFTER]):
                chained = False
        if not chained:
            continue
        ax, ay = corners[i, CORNER_X], corners[i, CORNER_Y]
        bx, by = corners[i + 1, CORNER_X], corners[i + 1, CORNER_Y]
        cx, cy = corners[i + 2, CORNER_X], corners[i + 2, CORNER_Y]
        area = 0.5 * abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
        if area >= room_min_m2:
            rooms[found, 0], rooms[found, 1], rooms[found, 2] = (ax + bx + cx) / 3.0, (ay + by + cy) / 3.0, area
            found += 1
    return rooms[:found]
