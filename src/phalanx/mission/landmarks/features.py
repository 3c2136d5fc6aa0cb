"""A scan's walls, corners, doorways and rooms, in the robot's frame; and as landmarks, where a pose puts them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import BOOLx1, F64x1, F64x2
from phalanx.config.lidar import ExtractionConfig
from phalanx.kernel import kernel
from phalanx.mission.angles import HALF_PI, PI, atan2, sin_cos, wrap
from phalanx.mission.observable import InSight, Landmark

from .corners import AFTER, BEFORE, CONVEX, CORNER_X, CORNER_Y, corners_of
from .doorways import DOOR_ALONG_X, DOOR_ALONG_Y, DOOR_X, DOOR_Y, doorways_of, rooms_of
from .scan import LaserScan, Limits, View, limits_of
from .walls import ALONG_X, ALONG_Y, breaks_of, points_of, walls_of

# Instead of a corner's wall that is not seen.
UNSEEN = -1.0


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """What a scan shows; all in the robot's frame, metres and radians, in the order of the bearings.

    Args:
        walls: (w, 8): a point on it, unit direction (robot on the left), first end, last end.
        corners: (c, 6): position, beam, wall before, wall after (-1: not seen), 1 if convex.
        is_jamb: (c,) whether the corner belongs to a doorway.
        doorways: (d, 6): middle, unit vector along the wall, width, thickness of the wall as far as it was seen.
        rooms: (r, 3): centroid and area of three consecutive convex corners.
    """

    walls: NDArray[np.float64]
    corners: NDArray[np.float64]
    is_jamb: NDArray[np.bool_]
    doorways: NDArray[np.float64]
    rooms: NDArray[np.float64]

    def landmarks(self, x_m: float, y_m: float, heading_rad: float) -> tuple[Landmark, ...]:
        """The features as landmarks in the map frame, if the robot is where it believes to be.

        A concave corner comes once for each wall of it that is seen, with that wall's normal: from another side
        another one is seen. A convex corner has the direction halfway between its walls' normals.
        """
        pose = float(x_m), float(y_m), float(heading_rad)
        return InSight(_placed(self.walls, self.corners, self.is_jamb, self.doorways, self.rooms, *pose)).told


def extract(scan: LaserScan, config: ExtractionConfig | None = None) -> Features:
    """The features of a scan; none of it is refused, an empty scan shows nothing. Source: Encoded graphs Alg. 1."""
    return Features(*_extract(*_swept(scan, config or ExtractionConfig())))


def landmarks_in(scan: LaserScan, config: ExtractionConfig, x_m: float, y_m: float, heading_rad: float) -> InSight:
    """As `extract(scan, config).landmarks(x_m, y_m, heading_rad)`, in one call: robots ask ten times a second."""
    return InSight(_sighted(*_swept(scan, config), float(x_m), float(y_m), float(heading_rad)))


def _swept(scan: LaserScan, config: ExtractionConfig) -> tuple[F64x1, F64x1, F64x1, bool, float, float, float, Limits]:
    """What `_extract` takes."""
    ranges, (cosines, sines) = scan.ranges_m, scan.beams
    if scan.full_turn:
        seam = _seam(ranges)
        ranges, cosines, sines = (np.roll(array, -seam) for array in (ranges, cosines, sines))
    farthest_m = scan.range_max_m, min(config.feature_range_m, scan.range_max_m)
    return ranges, cosines, sines, scan.full_turn, scan.angle_increment_rad, *farthest_m, limits_of(config)


@kernel
def _seam(ranges: F64x1) -> int:
    """Where to cut a full turn open: at the largest step of the range, so that no wall is cut."""
    n = len(ranges)
    best, at = -1.0, 0
    for k in range(n):
        a, b = ranges[(k - 1) % n], ranges[k]
        if np.isfinite(a) and np.isfinite(b):
            step = abs(b - a)
        elif np.isfinite(a) or np.isfinite(b):
            step = 1e6
        else:
            step = 0.0
        if step > best:
            best, at = step, k
    return at


@kernel
def _extract(
    ranges: F64x1,
    cosines: F64x1,
    sines: F64x1,
    full_turn: bool,
    step_rad: float,
    range_max_m: float,
    feature_range_m: float,
    limits: Limits,
) -> tuple[F64x2, F64x2, BOOLx1, F64x2, F64x2]:
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
def _placed(
    walls: F64x2,
    corners: F64x2,
    is_jamb: BOOLx1,
    doorways: F64x2,
    rooms: F64x2,
    x_m: float,
    y_m: float,
    heading_rad: float,
) -> F64x2:
    """(k, 5): type, x, y, orientation and area of each landmark, as `rows_of` has them, map frame; doorways first."""
    sine, cosine = sin_cos(heading_rad)
    rows = np.full((len(doorways) + 2 * len(corners) + len(rooms), 5), np.nan)
    found = 0
    for i in range(len(doorways)):
        rows[found, 0] = 0.0
        rows[found, 1], rows[found, 2] = doorways[i, DOOR_X], doorways[i, DOOR_Y]
        turn = wrap(atan2(doorways[i, DOOR_ALONG_Y], doorways[i, DOOR_ALONG_X]) + heading_rad)
        # The same from both sides: modulo half a turn.
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
            # Beams go round to the left: a wall that lies before a corner ends there on its left.
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
def _sighted(
    ranges: F64x1,
    cosines: F64x1,
    sines: F64x1,
    full_turn: bool,
    step_rad: float,
    range_max_m: float,
    feature_range_m: float,
    limits: Limits,
    x_m: float,
    y_m: float,
    heading_rad: float,
) -> F64x2:
    walls, corners, is_jamb, doorways, rooms = _extract(
        ranges, cosines, sines, full_turn, step_rad, range_max_m, feature_range_m, limits
    )
    return _placed(walls, corners, is_jamb, doorways, rooms, x_m, y_m, heading_rad)
