"""Pack robots' places into six bytes each, and points of routes into four: they are most of an update.

Source: docs/spec/vocabulary.md#places.
"""

from __future__ import annotations

import math
from base64 import urlsafe_b64encode
from collections.abc import Sequence
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phalanx.robot import Point
from phalanx.wire.table import PASS_BY, ROBOT_PLACE, ROUTE_POINT, TURN_DEG

from .vocabulary import MAX_WAYPOINTS

# As JSON: a record's six bytes are eight characters; AROUND_CHARS is the overhead of a group.
RECORD_CHARS = ROBOT_PLACE.size * 4 // 3
AROUND_CHARS = 56
# With more missing numbers, a new group is shorter.
MOST_LEFT_OUT = PASS_BY * (AROUND_CHARS // RECORD_CHARS)
FARTHEST = 0xFFFF
NOWHERE = 1e7  # mm: pages do not show robots beyond


class Places:
    """A group of places near each other. `rows` are int64 (robots, 4), by number: number, x, y in mm, whole degrees."""

    def __init__(self, rows: NDArray[np.int64]) -> None:
        numbers, at = rows[:, 0], rows[:, 1:3]
        self._corner = at.min(axis=0)
        self._step_mm = _step_mm(at)
        self._first = int(numbers[0])
        skipped = np.diff(numbers, prepend=self._first - 1) - 1
        robots = np.cumsum(skipped // PASS_BY + 1) - 1
        self._records = np.zeros(int(robots[-1]) + 1, ROBOT_PLACE.dtype)
        self._records["w"] = PASS_BY * TURN_DEG
        self._records["w"][robots] = (skipped % PASS_BY) * TURN_DEG + rows[:, 3] % TURN_DEG
        self._records["x"][robots], self._records["y"][robots] = np.rint((at - self._corner) / self._step_mm).T

    @property
    def chars(self) -> int:
        """Return the length as JSON, at most."""
        return AROUND_CHARS + RECORD_CHARS * len(self._records)

    def encode(self) -> list[Any]:
        """Return the group as an item of an update's `places`: `[number, x, y, step, records]`."""
        records = urlsafe_b64encode(self._records.tobytes()).decode()
        return [self._first, *self._corner.tolist(), self._step_mm, records]


def group_places(rows: NDArray[np.int64]) -> list[Places]:
    """Return the rows as few groups of good resolution: a distant robot must not make the others' places coarse."""
    if not len(rows):
        return []
    at = rows[:, 1:3]
    near = (np.abs(at - np.median(at, axis=0)) <= FARTHEST // 2).all(axis=1)
    groups = [rows[near], rows[~near]]
    return [
        Places(run)
        for group in groups
        for run in np.split(group, np.flatnonzero(np.diff(group[:, 0]) > MOST_LEFT_OUT) + 1)
        if len(run)
    ]


def encode_route(number: int, route: Sequence[Point]) -> list[Any]:
    """Return a route as an item of an update's `routes`: `[number, x, y, step, points]`, without invalid points.

    The first point is where the robot started; no server accepts more points after it than are sent.
    """
    known = (p for p in route if math.isfinite(p.x_mm) and math.isfinite(p.y_mm))
    near = [p for p in known if max(abs(p.x_mm), abs(p.y_mm)) < NOWHERE]
    points = [(p.x_mm, p.y_mm) for p in islice(near, MAX_WAYPOINTS + 1)]
    if not points:
        return [number, 0, 0, 1, ""]
    at = np.rint(np.array(points)).astype(np.int64)
    corner, step_mm = at.min(axis=0), _step_mm(at)
    records = np.zeros(len(at), ROUTE_POINT.dtype)
    records["x"], records["y"] = np.rint((at - corner) / step_mm).T
    return [number, *corner.tolist(), step_mm, urlsafe_b64encode(records.tobytes()).decode().rstrip("=")]


def _step_mm(at: NDArray[np.int64]) -> int:
    """Return the resolution with which 16 bits reach from the corner to the farthest point of `at`, (points, 2)."""
    # Exact up to 65 m, and a few mm off beyond, which a map does not show.
    return max(1, -(-int((at - at.min(axis=0)).max()) // FARTHEST))
