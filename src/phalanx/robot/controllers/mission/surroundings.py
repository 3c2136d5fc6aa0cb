"""Local obstacle map: a square of cells that moves with the robot, in the frame of its odometry.

It does not use the map frame, so position fixes do not shift it. Obstacles out of view are kept long enough to turn
about and drive around them, and short enough for a person who has left. A cell is FRESH when a beam hit something in
it, one less after every FADE_S, and 0 when free or unknown.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phalanx.arrays import F64x1, F64x2, U8x1
from phalanx.kernel import kernel
from phalanx.mission.angles import atan2, sin_cos

from .readings import CLEAR, CLEAR_STEP_M

Pose = tuple[float, float, float]
Stop = tuple[int, int]
Fan = tuple[F64x1, F64x1, float, float]

SIDE = 48  # cells; the robot is in the middle
CELL_M = 0.125
PER_M = 8.0
HALF = SIDE // 2
FRESH = 3
FADE_S = 4.0
PER_BYTE = 4  # cells, in a checkpoint
# Larger than any odometry: added before `int`, so that it rounds down negative numbers too.
_FAR = 1 << 23
# The centre of a cell is up to 0.09 m from a hit in it.
_SEEN_M = 0.13


class Seen(NamedTuple):
    """A reading, and the cells before it."""

    old: U8x1  # cells before the reading
    base: Stop  # indices of the first of them
    fade: int  # decrease of cells in this step
    moved: Pose  # pose by odometry
    clear: U8x1  # (sectors,) as in a reading
    fan: Fan  # cosines and sines of the sectors, start of the field of view, and width of a sector


class Sectors:
    """Directions of a reading's sectors, robot frame.

    Args:
        first_rad: start of the field of view.
    """

    def __init__(self, first_rad: float, step_rad: float, count: int) -> None:
        directions = (sin_cos(first_rad + (k + 0.5) * step_rad) for k in range(count))
        self.sines, self.cosines = np.array([*zip(*directions, strict=True)])
        self.fan = (self.cosines, self.sines, first_rad, step_rad)


def packed(cells: bytes) -> bytes:
    """Pack cells for a checkpoint, two bits each."""
    four = np.frombuffer(cells, np.uint8).reshape(-1, PER_BYTE)
    return (four[:, 0] | four[:, 1] << 2 | four[:, 2] << 4 | four[:, 3] << 6).astype(np.uint8).tobytes()


def unpacked(raw: bytes) -> bytes:
    """Return the cells from the result of `packed`."""
    four = np.frombuffer(raw, np.uint8)
    return np.stack([four & 3, four >> 2 & 3, four >> 4 & 3, four >> 6], axis=1).tobytes()


@kernel
def cell_at(value_m: float) -> int:
    """Return the index of a cell along an axis."""
    return int(value_m * PER_M + _FAR) - _FAR


@kernel
def look(seen: Seen, cells: U8x1, points: F64x2) -> tuple[int, int, int]:
    """Update the cells by a reading; return the indices of the first cell, and the number of points.

    Args:
        cells: output, the updated cells.
        points: output, (k, 2) obstacles, robot frame: hits of this reading, and remembered cells out of view.
    """
    old, base, fade, moved, clear, fan = seen
    cosines, sines, first_rad, step_rad = fan
    sine, cosine = sin_cos(moved[2])
    base_x, base_y = cell_at(moved[0]) - HALF, cell_at(moved[1]) - HALF
    by_x, by_y = base_x - base[0], base_y - base[1]
    cells[:] = 0
    found = 0
    for y in range(max(0, -by_y), min(SIDE, SIDE - by_y)):
        for x in range(max(0, -by_x), min(SIDE, SIDE - by_x)):
            left = int(old[(y + by_y) * SIDE + x + by_x])
            if left <= fade:
                continue
            dx, dy = (base_x + x + 0.5) * CELL_M - moved[0], (base_y + y + 0.5) * CELL_M - moved[1]
            ahead, aside = cosine * dx + sine * dy, cosine * dy - sine * dx
            away = math.sqrt(ahead * ahead + aside * aside)
            bearing = atan2(aside, ahead)
            is_hidden = True
            if abs(bearing) < -first_rad:
                k = min(len(clear) - 1, int((bearing - first_rad) / step_rad))
                beyond = int(clear[k]) * CLEAR_STEP_M - away
                if beyond > _SEEN_M or clear[k] == CLEAR:
                    continue
                is_hidden = beyond < -_SEEN_M
            cells[y * SIDE + x] = left - fade
            if is_hidden:
                points[found, 0], points[found, 1] = ahead, aside
                found += 1
    for k in range(len(clear)):
        if clear[k] == CLEAR:
            continue
        range_m = int(clear[k]) * CLEAR_STEP_M
        ahead, aside = range_m * cosines[k], range_m * sines[k]
        points[found, 0], points[found, 1] = ahead, aside
        found += 1
        x = cell_at(moved[0] + (cosine * ahead - sine * aside)) - base_x
        y = cell_at(moved[1] + (sine * ahead + cosine * aside)) - base_y
        if 0 <= x < SIDE and 0 <= y < SIDE:
            cells[y * SIDE + x] = FRESH
    return base_x, base_y, found


@kernel
def free_way(points: F64x2, count: int, cosine: float, sine: float, margin_m: float) -> float:
    """Return the distance that a robot can drive in a direction until an obstacle is within the margin."""
    free = np.inf
    for k in range(count):
        along = points[k, 0] * cosine + points[k, 1] * sine
        if 0.0 < along < free and abs(points[k, 1] * cosine - points[k, 0] * sine) < margin_m:
            free = along
    return free


@kernel
def sight(clear: U8x1, cosines: F64x1, sines: F64x1, goal_x: float, goal_y: float, margin_m: float) -> bool:
    """Return whether a reading shows a free straight path to a place, robot frame."""
    away = math.sqrt(goal_x * goal_x + goal_y * goal_y)
    # Beyond the range of a sector's byte, a wall could be in between.
    if goal_x <= 0.0 or away >= CLEAR * CLEAR_STEP_M:
        return False
    points = np.empty((len(clear), 2))
    count = 0
    for k in range(len(clear)):
        if clear[k] != CLEAR:
            range_m = int(clear[k]) * CLEAR_STEP_M
            points[count, 0], points[count, 1] = range_m * cosines[k], range_m * sines[k]
            count += 1
    return free_way(points, count, goal_x / away, goal_y / away, margin_m) >= away
