"""Judge a robot's beliefs by ground truth.

A fix is false if it leaves the robot more than 0.5 m or 6 degrees off, or further than three of its own standard
deviations, where it has an idea of them. A decoded node is false if its landmark is not in sight where it truly is, or
not what the robot saw; or if it is a place, and the robot is elsewhere.

People do not count: who walks before a landmark does not make it a false one.
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
# What was seen lay so near to the landmark's true place, and was turned like it: a bin of headings, and a little.
NEAR_M = 0.35
NEAR_RAD = math.radians(20)
# On each axis; half a cell comes to it.
PLACE_M = 0.5
# A ray may end so far before the landmark: it lies on a wall, and the plan is no more exact.
SHORT_M = 0.1
# And a beam that passes so far beside the landmark may show it, where something stands close before it.
BESIDE_M = 0.03
EDGE_RAD = math.radians(1)
# A doorway is seen in its middle or as deep before or behind it; a room as far around its middle.
DEEP_M, WIDE_M = 0.25, 0.5
# So near, the middle of what has some size may lie behind the robot: it is the corners and jambs that are seen.
AROUND_M = {"room": math.inf, "doorway": 1.5}


def pose_error(true: Pose, estimate: Pose, spread: Covariance | None) -> str:
    """Name the error of an estimated pose: "metres", "degrees", "sigmas", or "" if it is right.

    Args:
        spread: how uncertain the robot takes its estimate to be, or None if it has no idea.
    """
    x, y = estimate[0] - true[0], estimate[1] - true[1]
    away, turned = math.hypot(x, y), abs(math.remainder(estimate[2] - true[2], math.tau))
    if not away <= FALSE_FIX_M:
        return "metres"
    if not turned <= FALSE_FIX_RAD:
        return "degrees"
    if spread is None:
        return ""
    # Along the error, however the axes lie: away² · variance is (x, y) · covariance · (x, y).
    xx, xy, _, yy, _, hh = spread
    along = x * x * xx + 2 * x * y * xy + y * y * yy
    is_beyond = away * away > SIGMAS * math.sqrt(max(0.0, along)) or turned > SIGMAS * math.sqrt(max(0.0, hh))
    return "sigmas" if is_beyond else ""


class Truth:
    """Ground truth of a building, for robots with such a lidar."""

    def __init__(self, plan: FloorPlan, lidar: LidarConfig) -> None:
        self._plan, self._lidar = plan, lidar

    def decoding_error(self, true: Pose, opened: Opened, seen: Experience | None, cell_m: float) -> str:
        """Name the error of a decoded node: "elsewhere", "hidden", "another", or "" if it is right.

        Args:
            true: where the robot is.
            seen: what it experienced in this step, put on the map by where it took itself to be.
            cell_m: edge of a cell of the mission's.
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
        """Return whether a robot there can see where a landmark is: in range, in its field of view, behind no wall.

        Of a room it is the walls around that are in the field of view, so its middle need not be.
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
    """Return points of a landmark; any visible one will do."""
    x, y = landmark.x_m, landmark.y_m
    if landmark.type == "room":
        around = [(WIDE_M * math.cos(i * math.pi / 4), WIDE_M * math.sin(i * math.pi / 4)) for i in range(8)]
        return [(x, y), *((x + dx, y + dy) for dx, dy in around)]
    if landmark.type == "doorway" and landmark.orientation_rad is not None:
        dx, dy = -DEEP_M * math.sin(landmark.orientation_rad), DEEP_M * math.cos(landmark.orientation_rad)
        return [(x, y), (x + dx, y + dy), (x - dx, y - dy)]
    return [(x, y)]


def _was_seen(true: Pose, landmark: Landmark, seen: Experience) -> bool:
    """Return whether something like it was seen where it is, by where the robot truly is."""
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
