"""Poses in frames, the control point of a differential drive, and positions on a page. Does not need rclpy.

The guard controls a point `ahead_m` in front of the axle as a point mass. A point on the axle moves only forward, but
this one moves in any direction: along x with the robot's speed, along y with ahead_m times its turn rate. So velocities
of the point and twists of the robot correspond one to one, and the body lies in a disc around the point. Frames are
those of REP 105: metres, y up. A page uses millimetres, x to the right and y down from its top left corner.

Source: docs/guides/ros2.md; Yun and Yamamoto, "Internal dynamics of a wheeled mobile robot", 1993 (the point).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from phalanx.robot import Point

MM_PER_M = 1000.0
LARGEST_M = 1000.0
SLOW_M = 1.0  # within this distance of its goal a robot slows down in proportion
Pair = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Pose of a frame or a robot in another frame: metres, and radians counterclockwise."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0

    def of(self, inner: Place) -> Place:
        """Compose poses: return `inner`, given in this frame, in the parent frame."""
        x_m, y_m = turned((inner.x_m, inner.y_m), self.yaw_rad)
        return Place(x_m=self.x_m + x_m, y_m=self.y_m + y_m, yaw_rad=self.yaw_rad + inner.yaw_rad)

    def sees(self, there: Place) -> Place:
        """Return `there`, given in the parent frame, in this frame."""
        x_m, y_m = turned((there.x_m - self.x_m, there.y_m - self.y_m), -self.yaw_rad)
        return Place(x_m=x_m, y_m=y_m, yaw_rad=there.yaw_rad - self.yaw_rad)


def turned(vector: Pair, yaw_rad: float) -> Pair:
    """Return the vector, rotated counterclockwise."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return vector[0] * cos - vector[1] * sin, vector[0] * sin + vector[1] * cos


def place_of(pose: Any) -> Place:
    """Return the planar pose of a geometry_msgs/Pose. Source: REP 103."""
    at, q = pose.position, pose.orientation
    yaw_rad = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    return Place(x_m=at.x, y_m=at.y, yaw_rad=yaw_rad)


def point_of(base: Place, ahead_m: float) -> Pair:
    """Return the position of the control point, m."""
    x_m, y_m = turned((ahead_m, 0.0), base.yaw_rad)
    return base.x_m + x_m, base.y_m + y_m


def velocity_of(linear_mps: float, angular_radps: float, yaw_rad: float, ahead_m: float) -> Pair:
    """Return the control point's velocity, m/s, in the frame of the heading, from the robot's twist."""
    return turned((linear_mps, ahead_m * angular_radps), yaw_rad)


def twist_of(velocity_mps: Pair, yaw_rad: float, ahead_m: float) -> Pair:
    """Return the robot's speed, m/s, and turn rate, rad/s, from the control point's velocity."""
    along, across = turned(velocity_mps, -yaw_rad)
    return along, across / ahead_m


@dataclass(frozen=True, slots=True)
class Area:
    """Rectangle of the map that a page shows, metres."""

    left_m: float = -10.0
    top_m: float = 10.0
    width_m: float = 20.0
    height_m: float = 20.0

    @classmethod
    def of(cls, columns: int, rows: int, resolution_m: float, origin: Place) -> Area:
        """Return the bounding rectangle of an occupancy grid, or the default one if its numbers are invalid.

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
        """Return width and height, mm."""
        return round(self.width_m * MM_PER_M), round(self.height_m * MM_PER_M)

    def place_of(self, point: Point) -> Pair:
        """Return the map position of a point on the page, m."""
        return self.left_m + point.x_mm / MM_PER_M, self.top_m - point.y_mm / MM_PER_M


def pose_of(area: Area, at: Place) -> tuple[Point, int]:
    """Return a robot's position on the page, clamped to it, and its direction in whole degrees."""
    x_m = min(max(at.x_m - area.left_m, 0.0), area.width_m)
    y_m = min(max(area.top_m - at.y_m, 0.0), area.height_m)
    # 0 degrees are down the page, and they are counted clockwise (docs/spec/vocabulary.md).
    degrees = math.degrees(math.atan2(-math.cos(at.yaw_rad), -math.sin(at.yaw_rad)))
    return Point(x_m * MM_PER_M, y_m * MM_PER_M), round(degrees) % 360


def steered(at: Place, goal_m: Pair, most_mps: float) -> Pair:
    """Return the velocity of a robot that drives to a goal, m/s in the map."""
    dx_m, dy_m = goal_m[0] - at.x_m, goal_m[1] - at.y_m
    away_m = math.hypot(dx_m, dy_m)
    speed = most_mps * min(1.0, away_m / SLOW_M)
    return (speed * dx_m / away_m, speed * dy_m / away_m) if away_m else (0.0, 0.0)
