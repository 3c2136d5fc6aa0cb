"""Where robots of ROS 2 are on a page, and how they are steered to a point of it; nothing of rclpy.

A page has millimetres, x to the right and y down from its top left corner; REP 103 has metres, y up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from phalanx.robot import Point

from .ahead import Pair, Place

MM_PER_M = 1000.0
LARGEST_M = 1000.0
SLOW_M = 1.0  # nearer than that to a point a robot is as much slower


@dataclass(frozen=True, slots=True)
class Area:
    """A rectangle of the map: its left, its top, width and height, metres."""

    left_m: float = -10.0
    top_m: float = 10.0
    width_m: float = 20.0
    height_m: float = 20.0

    @classmethod
    def of(cls, columns: int, rows: int, resolution_m: float, origin: Place) -> Area:
        """Of an occupancy grid; one that is turned has the rectangle around it, one that makes no sense the usual one.

        Source: nav_msgs/MapMetaData: the origin is the lower left corner.
        """
        width_m, height_m = columns * resolution_m, rows * resolution_m
        if not (0.0 < width_m <= LARGEST_M and 0.0 < height_m <= LARGEST_M):
            return cls()
        corners = [origin.of(Place(x_m=x, y_m=y)) for x in (0.0, width_m) for y in (0.0, height_m)]
        left_m, bottom_m = min(each.x_m for each in corners), min(each.y_m for each in corners)
        top_m = max(each.y_m for each in corners)
        if not all(map(math.isfinite, (left_m, bottom_m, top_m))):
            return cls()
        return cls(left_m, top_m, max(each.x_m for each in corners) - left_m, top_m - bottom_m)

    @property
    def size_mm(self) -> tuple[int, int]:
        """Width and height."""
        return round(self.width_m * MM_PER_M), round(self.height_m * MM_PER_M)

    def place_of(self, point: Point) -> Pair:
        """A point of the page in the map, m."""
        return self.left_m + point.x_mm / MM_PER_M, self.top_m - point.y_mm / MM_PER_M


def pose_of(area: Area, at: Place) -> tuple[Point, int]:
    """Where a robot is on the page, inside of it wherever it says that it is, and its direction in whole degrees."""
    x_m = min(max(at.x_m - area.left_m, 0.0), area.width_m)
    y_m = min(max(area.top_m - at.y_m, 0.0), area.height_m)
    # 0 degrees are down the page, and they are counted clockwise (docs/spec/vocabulary.md).
    degrees = math.degrees(math.atan2(-math.cos(at.yaw_rad), -math.sin(at.yaw_rad)))
    return Point(x_m * MM_PER_M, y_m * MM_PER_M), round(degrees) % 360


def steered(at: Place, goal_m: Pair, most_mps: float) -> Pair:
    """How a robot moves that makes for a place, m/s in the map."""
    dx_m, dy_m = goal_m[0] - at.x_m, goal_m[1] - at.y_m
    away_m = math.hypot(dx_m, dy_m)
    speed = most_mps * min(1.0, away_m / SLOW_M)
    return (speed * dx_m / away_m, speed * dy_m / away_m) if away_m else (0.0, 0.0)
