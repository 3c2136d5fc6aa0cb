"""Extract walls, corners, doorways and rooms from a scan in the robot frame, and transform them to landmarks.

A doorway is a pair of concave corners at a suitable distance, in line with the walls beside them, with only free rays
between. A room is three consecutive convex corners, joined by two fully visible walls.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phalanx.arrays import BOOLx1, F64x1, F64x2, I64x1
from phalanx.config.lidar import ExtractionConfig
from phalanx.kernel import kernel
from phalanx.mission.angles import HALF_PI, PI, atan2, sin_cos, wrap
from phalanx.mission.observable import Landmark, ScanLandmarks

from .corners import AFTER, BEAM, BEFORE, CONVEX, CORNER_X, CORNER_Y, corners_of, next_beam
from .scan import LaserScan, Limits, View, limits_of
from .walls import ALONG_X, ALONG_Y, FROM_X, FROM_Y, TO_X, TO_Y, breaks_of, points_of, walls_of

Pair = tuple[float, float]

# Hits this near to a jamb belong to the jamb: its inner face, or its edge with sensor noise.
JAMB_M = 0.1
HIDDEN = -1.0
# Error of the measured width, so that a door exactly at the limit is accepted.
WIDTH_SLACK_M = 0.05
# Columns of an array of doorways: centre, unit vector along the wall, distance of the jambs, thickness of the wall.
DOOR_X, DOOR_Y, DOOR_ALONG_X, DOOR_ALONG_Y, WIDTH, DEPTH = range(6)
# Number of the wall for a wall that is not seen.
UNSEEN = -1.0


@kernel
def _is_open(v: View, from_beam: int, to_beam: int, a: Pair, b: Pair, clear_m: float) -> bool:
    """Return True if beams `from_beam` to `to_beam` pass between jambs a and b; half must have a range.

    No beam may hit anything in front of the line of the jambs, or behind it up to `clear_m`: a closed door, an alcove.
    """
    ranges, n = v.ranges, len(v.ranges)
    ax, ay = a
    along_x, along_y = b[0] - ax, b[1] - ay
    width = math.sqrt(along_x * along_x + along_y * along_y)
    along_x, along_y = along_x / width, along_y / width
    robot = ay * along_x - ax * along_y
    answered, asked = 0, 0
    k = from_beam
    while True:
        asked += 1
        if not np.isnan(ranges[k]):
            answered += 1
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
            return 2 * answered >= asked
        k = (k + 1) % n


@kernel
def _depth_behind(v: View, i: int, step: int, jamb: Pair, along: Pair, limit_m: float) -> float:
    """Return the depth of the jamb's inner face, followed from point i; 0 if none is seen, HIDDEN if its end is not."""
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
            # Another wall begins at the jamb, which hides the thickness of this one.
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
    """Return the first point whose beam is past `at`."""
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
    """Return (d, 6) doorways, and a mask of the corners that are jambs.

    Source: Encoded graphs Alg. 1, Eq. 1; free rays, mid-wall: docs/adr/0019.
    """
    doors = np.empty((len(corners), 6))
    is_jamb = np.zeros(len(corners), np.bool_)
    n = len(v.ranges)
    bend_cosine, depth_max_m = limits.bend_cosine, limits.door_depth_m
    found = 0
    for i in range(len(corners)):
        # The wall ends at jamb i; after the opening it continues at jamb j.
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
            # The walls are longer than the opening, so they give its direction more exactly than the jambs.
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
            # Move the centre away from the robot, to the middle of the wall's thickness.
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
    """Return (r, 3) centroid and area of each triangle of three consecutive convex corners.

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


class Features(NamedTuple):
    """Features of a scan in the robot's frame, metres and radians, ordered by bearing."""

    walls: F64x2  # (w, 8): a point on it, unit direction (robot on the left), first end, last end
    corners: F64x2  # (c, 6): position, beam, wall before, wall after (-1: not seen), 1 if convex
    is_jamb: BOOLx1  # (c,) True if the corner belongs to a doorway
    doorways: F64x2  # (d, 6): centre, unit vector along the wall, width, thickness of the wall as far as seen
    rooms: F64x2  # (r, 3): centroid and area of three consecutive convex corners

    def landmarks(self, x_m: float, y_m: float, heading_rad: float) -> tuple[Landmark, ...]:
        """Return the features as landmarks in the map frame, given the robot's pose.

        A concave corner gives one landmark for each visible wall, with that wall's normal, as other walls are visible
        from other sides. The orientation of a convex corner bisects its walls' normals.
        """
        return ScanLandmarks(_placed(self, float(x_m), float(y_m), float(heading_rad))).landmarks


class Sweep(NamedTuple):
    """Input of `_extract`: a scan, rotated so that a full turn does not begin within a wall."""

    ranges: F64x1
    cosines: F64x1
    sines: F64x1
    full_turn: bool
    step_rad: float
    range_max_m: float
    feature_range_m: float


def extract(scan: LaserScan, config: ExtractionConfig | None = None) -> Features:
    """Return the features of a scan; any scan is accepted, an empty one has none. Source: Encoded graphs Alg. 1."""
    config = config or ExtractionConfig()
    return Features(*_extract(_sweep_of(scan, config), limits_of(config)))


def landmarks_in(
    scan: LaserScan, config: ExtractionConfig, x_m: float, y_m: float, heading_rad: float
) -> ScanLandmarks:
    """Return `extract(scan, config).landmarks(...)` in one fast kernel call, as robots need it ten times a second."""
    pose = float(x_m), float(y_m), float(heading_rad)
    return ScanLandmarks(_sighted(_sweep_of(scan, config), limits_of(config), *pose))


def _sweep_of(scan: LaserScan, config: ExtractionConfig) -> Sweep:
    ranges, (cosines, sines) = scan.ranges_m, scan.beams
    if scan.full_turn:
        seam = _seam(ranges)
        ranges, cosines, sines = (np.roll(array, -seam) for array in (ranges, cosines, sines))
    farthest_m = scan.range_max_m, min(config.feature_range_m, scan.range_max_m)
    return Sweep(ranges, cosines, sines, scan.full_turn, scan.angle_increment_rad, *farthest_m)


@kernel
def _seam(ranges: F64x1) -> int:
    """Return the beam at which to cut a full turn: the largest jump of the range, so that no wall is cut."""
    n = len(ranges)
    best, at = -1.0, 0
    for k in range(n):
        a, b = ranges[(k - 1) % n], ranges[k]
        one_hits = np.isfinite(a) or np.isfinite(b)
        step = abs(b - a) if np.isfinite(a) and np.isfinite(b) else (1e6 if one_hits else 0.0)
        if step > best:
            best, at = step, k
    return at


@kernel
def _extract(sweep: Sweep, limits: Limits) -> tuple[F64x2, F64x2, BOOLx1, F64x2, F64x2]:  # the fields of Features
    ranges, cosines, sines, full_turn, step_rad, range_max_m, feature_range_m = sweep
    x, y, beam = points_of(ranges, cosines, sines, feature_range_m)
    new_run = breaks_of(ranges, beam, step_rad, limits.jump_m, limits.graze_slope)
    view = View(ranges, cosines, sines, full_turn, range_max_m, x, y, beam, new_run)
    walls, spans = walls_of(
        x, y, new_run, limits.split_m, limits.line_m, limits.wall_min_m, int(limits.wall_min_points)
    )
    corners = corners_of(view, limits, walls, spans)
    doorways, is_jamb = doorways_of(view, limits, walls, corners)
    return walls, corners, is_jamb, doorways, rooms_of(corners, limits.room_min_m2)


@kernel
def _placed(features: Features, x_m: float, y_m: float, heading_rad: float) -> F64x2:
    """Return (k, 5) rows of landmarks in the map frame, in the layout of `rows_of`; doorways first."""
    walls, corners, is_jamb, doorways, rooms = features
    sine, cosine = sin_cos(heading_rad)
    rows = np.full((len(doorways) + 2 * len(corners) + len(rooms), 5), np.nan)
    found = 0
    for i in range(len(doorways)):
        rows[found, 0] = 0.0
        rows[found, 1], rows[found, 2] = doorways[i, DOOR_X], doorways[i, DOOR_Y]
        turn = wrap(atan2(doorways[i, DOOR_ALONG_Y], doorways[i, DOOR_ALONG_X]) + heading_rad)
        # A doorway looks the same from both sides: modulo half a turn.
        rows[found, 3] = turn + PI if turn < 0.0 else turn
        found += 1
    for i in range(len(corners)):
        if is_jamb[i]:
            continue
        normal_x, normal_y = 0.0, 0.0
        for side in (BEFORE, AFTER):
            if corners[i, side] == UNSEEN:
                continue
            # The robot is on the left of a wall's direction.
            w = int(corners[i, side])
            if corners[i, CONVEX] == 1.0:
                normal_x -= walls[w, ALONG_Y]
                normal_y += walls[w, ALONG_X]
                if side == BEFORE:
                    continue
                turn = atan2(normal_y, normal_x)
            else:
                turn = atan2(walls[w, ALONG_Y], walls[w, ALONG_X]) + HALF_PI
            # Beams turn counter-clockwise: the wall before a corner ends there with its left end.
            rows[found, 0] = 1.0 if corners[i, CONVEX] == 1.0 else (2.0 if side == BEFORE else 3.0)
            rows[found, 1], rows[found, 2] = corners[i, CORNER_X], corners[i, CORNER_Y]
            rows[found, 3] = wrap(turn + heading_rad)
            found += 1
    for i in range(len(rooms)):
        rows[found, 0] = 4.0
        rows[found, 1], rows[found, 2], rows[found, 4] = rooms[i, 0], rooms[i, 1], rooms[i, 2]
        found += 1
    for i in range(found):
        x, y = rows[i, 1], rows[i, 2]
        rows[i, 1] = x_m + (cosine * x - sine * y)
        rows[i, 2] = y_m + (sine * x + cosine * y)
    return rows[:found]


@kernel
def _sighted(sweep: Sweep, limits: Limits, x_m: float, y_m: float, heading_rad: float) -> F64x2:
    walls, corners, is_jamb, doorways, rooms = _extract(sweep, limits)
    return _placed(Features(walls, corners, is_jamb, doorways, rooms), x_m, y_m, heading_rad)
