"""Places in frames, the point ahead of a differential drive's axle, and places on a page; nothing of rclpy.

The guard drives that point as it drives a point mass. Two wheels push a point on the axle forward alone, but one that
lies `ahead_m` in front of it anywhere: along x as fast as the robot drives, along y ahead_m times as fast as it turns.
So velocities of that point and twists are one to one, and the robot's body is in a disc around it. Frames are those of
REP 105: metres, y up. A page has millimetres, x to the right and y down from its top left corner.

Source: docs/guides/ros2.md; Yun and Yamamoto, "Internal dynamics of a wheeled mobile robot", 1993 (the point).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from phalanx.robot import Point

MM_PER_M = 1000.0
LARGEST_M = 1000.0
SLOW_M = 1.0  # nearer than that to a point a robot is as much slower
Pair = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where a frame or a robot is in another frame: metres, and radians counterclockwise."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0

    def of(self, inner: Place) -> Place:
        """What has the place `inner` in the frame that is here, in the frame that this place is in."""
        x_m, y_m = turned((inner.x_m, inner.y_m), self.yaw_rad)
        return Place(x_m=self.x_m + x_m, y_m=self.y_m + y_m, yaw_rad=self.yaw_rad + inner.yaw_rad)

    def sees(self, there: Place) -> Place:
        """What has the place `there` in the frame that this place is in, in the frame that is here."""
        x_m, y_m = turned((there.x_m - self.x_m, there.y_m - self.y_m), -self.yaw_rad)
        return Place(x_m=x_m, y_m=y_m, yaw_rad=there.yaw_rad - self.yaw_rad)


def turned(vector: Pair, yaw_rad: float) -> Pair:
    """The vector, turned counterclockwise."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return vector[0] * cos - vector[1] * sin, vector[0] * sin + vector[1] * cos


def place_of(pose: Any) -> Place:
    """Return the place of a geometry_msgs/Pose, with its heading alone. Source: REP 103."""
    at, q = pose.position, pose.orientation
    yaw_rad = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    return Place(x_m=at.x, y_m=at.y, yaw_rad=yaw_rad)


def point_of(base: Place, ahead_m: float) -> Pair:
    """Where the point ahead is, m."""
    x_m, y_m = turned((ahead_m, 0.0), base.yaw_rad)
    return base.x_m + x_m, base.y_m + y_m


def velocity_of(linear_mps: float, angular_radps: float, yaw_rad: float, ahead_m: float) -> Pair:
    """How the point moves with a robot that drives and turns so, m/s, in the frame of the heading."""
    return turned((linear_mps, ahead_m * angular_radps), yaw_rad)


def twist_of(velocity_mps: Pair, yaw_rad: float, ahead_m: float) -> Pair:
    """How a robot drives, m/s, and turns, rad/s, whose point moves so."""
    along, across = turned(velocity_mps, -yaw_rad)
    return along, across / ahead_m


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
