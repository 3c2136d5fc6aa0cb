"""The point ahead of a differential drive's axle: the guard drives it as it drives a point mass.

Two wheels push a point on the axle forward alone, but one that lies `ahead_m` in front of it anywhere: along x as fast
as the robot drives, along y ahead_m times as fast as it turns. So velocities of that point and twists are one to one,
and the robot's body is in a disc around it. Frames are those of REP 105.

Source: docs/ros2.md; Yun and Yamamoto, "Internal dynamics of a wheeled mobile robot", 1993 (the point).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

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


def yaw_of(x: float, y: float, z: float, w: float) -> float:
    """The heading of a quaternion, radians. Source: REP 103."""
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


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
