"""Evaluate a robot's beliefs by ground truth.

A fix is false if its error exceeds 0.5 m or 6 degrees, or three of the robot's own standard deviations if it has an
estimate. A decoded node is false if its landmark is hidden from the true pose, or is not the one that the robot saw;
for a position, if the robot is elsewhere.

Walking people are ignored: a landmark hidden by a person does not count as false.
"""

from __future__ import annotations

import math

from phalanx.config.lidar import LidarConfig
from phalanx.mission import Experience, Landmark
from phalanx.mission.landmarks import FloorPlan
from phalanx.mission.observable import HALF_TURN_TYPES, Covariance
from phalanx.mission.walk.opening import Opened
from phalanx.world.building.odometry import Pose

FALSE_FIX_M = 0.5
FALSE_FIX_RAD = math.radians(6)
SIGMAS = 3.0
# Largest errors in position and orientation of a sighting of the landmark: a bin of headings, and some tolerance.
NEAR_M = 0.35
NEAR_RAD = math.radians(20)
# Per axis, plus half a cell.
PLACE_M = 0.5
# A ray may end this far before the landmark, which lies on a wall, because the plan is not exact.
SHORT_M = 0.1
# A beam at this distance beside the landmark may also show it, if an object stands close before it.
BESIDE_M = 0.03
EDGE_RAD = math.radians(1)
# A doorway may be seen at its centre, or this far before or behind it; a room this far around its centre.
DEEP_M, WIDE_M = 0.25, 0.5
# Within this distance the centre of a large landmark may lie behind the robot, which sees its corners or jambs.
AROUND_M = {"room": math.inf, "doorway": 1.5}


def pose_error(true: Pose, estimate: Pose, spread: Covariance | None) -> str:
    """Name the error of an estimated pose: "metres", "degrees", "sigmas", or "" if it is right.

    Args:
        spread: covariance of the robot's estimate, or None if it has none.
    """
    x, y = estimate[0] - true[0], estimate[1] - true[1]
    away, turned = math.hypot(x, y), abs(math.remainder(estimate[2] - true[2], math.tau))
    if not away <= FALSE_FIX_M:
        return "metres"
    if not turned <= FALSE_FIX_RAD:
        return "degrees"
    if spread is None:
        return ""
    # Standard deviation along the error: away² · variance is (x, y) · covariance · (x, y).
    xx, xy, _, yy, _, hh = spread
    along = x * x * xx + 2 * x * y * xy + y * y * yy
    is_beyond = away * away > SIGMAS * math.sqrt(max(0.0, along)) or turned > SIGMAS * math.sqrt(max(0.0, hh))
    return "sigmas" if is_beyond else ""


class Truth:
    """Ground truth of a building, for robots with this lidar."""

    def __init__(self, plan: FloorPlan, lidar: LidarConfig) -> None:
        self._plan, self._lidar = plan, lidar

    def decoding_error(self, true: Pose, opened: Opened, seen: Experience | None, cell_m: float) -> str:
        """Name the error of a decoded node: "elsewhere", "hidden", "another", or "" if it is right.

        Args:
            true: true pose of the robot.
            seen: observations in this step, on the map by the estimated pose.
            cell_m: edge of a cell of the mission.
        """
        landmark = opened.landmark
        if landmark is not None:
            if not self.in_sight(true, landmark):
                return "hidden"
            return "" if seen is None or _was_seen(true, landmark, seen) else "another"
        if opened.place_m is None:
            return ""
        off_m = max(abs(opened.place_m[0] - true[0]), abs(opened.place_m[1] - true[1]))
        return "elsewhere" if off_m > PLACE_M + cell_m / 2 else ""

    def in_sight(self, true: Pose, landmark: Landmark) -> bool:
        """Return whether a landmark is visible from a pose: in range, in the field of view, not behind a wall.

        A room is visible by its walls, so that its centre may be outside the field of view.
        """
        around_m = AROUND_M.get(landmark.type, NEAR_M)
        return any(self._sees(true, point, around_m) for point in _points_of(landmark))

    def _sees(self, true: Pose, point: tuple[float, float], around_m: float) -> bool:
        x, y = point[0] - true[0], point[1] - true[1]
        away = math.hypot(x, y)
        bearing = abs(math.remainder(math.atan2(y, x) - true[2], math.tau))
        if away > self._lidar.range_max_m or (away > around_m and bearing > self._lidar.fov_rad / 2 + EDGE_RAD):
            return False
        if away <= SHORT_M:
            return True
        share = 1 - SHORT_M / away
        aside_x, aside_y = -BESIDE_M * y / away, BESIDE_M * x / away
        return any(
            self._plan.sees((true[0], true[1]), (true[0] + share * x + k * aside_x, true[1] + share * y + k * aside_y))
            for k in (0, 1, -1)
        )


def _points_of(landmark: Landmark) -> list[tuple[float, float]]:
    """Return points of a landmark; the landmark is visible if any of them is."""
    x, y = landmark.x_m, landmark.y_m
    if landmark.type == "room":
        around = [(WIDE_M * math.cos(i * math.pi / 4), WIDE_M * math.sin(i * math.pi / 4)) for i in range(8)]
        return [(x, y), *((x + dx, y + dy) for dx, dy in around)]
    if landmark.type == "doorway" and landmark.orientation_rad is not None:
        dx, dy = -DEEP_M * math.sin(landmark.orientation_rad), DEEP_M * math.cos(landmark.orientation_rad)
        return [(x, y), (x + dx, y + dy), (x - dx, y - dy)]
    return [(x, y)]


def _was_seen(true: Pose, landmark: Landmark, seen: Experience) -> bool:
    """Return whether the robot observed this landmark, with observations placed by its true pose."""
    turn = true[2] - seen.heading_rad
    cosine, sine = math.cos(turn), math.sin(turn)
    for other in seen.landmarks:
        if other.type != landmark.type or other.text != landmark.text:
            continue
        x, y = other.x_m - seen.x_m, other.y_m - seen.y_m
        x, y = true[0] + cosine * x - sine * y, true[1] + sine * x + cosine * y
        if math.hypot(x - landmark.x_m, y - landmark.y_m) > NEAR_M:
            continue
        if other.orientation_rad is None or landmark.orientation_rad is None:
            return True
        whole = math.pi if landmark.type in HALF_TURN_TYPES else math.tau
        if abs(math.remainder(other.orientation_rad + turn - landmark.orientation_rad, whole)) <= NEAR_RAD:
            return True
    return False
