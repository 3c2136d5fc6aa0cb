"""Conversion of ROS 2 scans and odometry to a mission's readings. Does not need rclpy.

A mission's lidar is centred on forward and counts its beams to the left. A driver's scan is reordered to that form beam
for beam. The remaining offset is the pose of the lidar on the robot; odometry is transformed to the lidar's pose.

Source: sensor_msgs/LaserScan, REP 103, 105 and 117.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from phalanx.config.lidar import LidarConfig
from phalanx.errors import UsageError
from phalanx.mission.landmarks.scan import LaserScan

from .geometry import Place

# A lidar with less than a full turn must point forward within this angle.
ASTRAY_RAD = 0.35
FARTHEST_M = 60.0
KEPT = 200  # stored odometry messages: four seconds at a high rate


@dataclass(frozen=True, slots=True)
class Beams:
    """Conversion of a driver's scans to those of `lidar`; `eye` is the lidar's pose on the robot."""

    count: int
    clockwise: bool
    lidar: LidarConfig
    eye: Place
    first: int

    def scan_of(self, ranges: Sequence[float]) -> LaserScan:
        """Return the scan in a mission's form. Raises: UsageError: another number of beams."""
        if len(ranges) != self.count:
            raise UsageError(f"a scan of {len(ranges)} beams", f"{self.count}, as the first one")
        said: NDArray[np.float64] = np.asarray(ranges, np.float64)
        lidar = self.lidar
        said = np.roll((said[::-1] if self.clockwise else said)[: lidar.beams], -self.first)
        return LaserScan(said, lidar.angle_min_rad, lidar.angle_increment_rad, lidar.range_min_m, lidar.range_max_m)


def beams_of(
    count: int, first_rad: float, step_rad: float, limits_m: tuple[float, float], noise_m: float, mounted: Place
) -> Beams:
    """Return the conversion of scans with the first beam at `first_rad` in the laser's frame, and steps of `step_rad`.

    `limits_m` are range_min and range_max, `mounted` is the pose of the laser's frame on the robot.
    Raises: UsageError: the geometry is invalid, or the lidar points aside.
    """
    if not (count >= 2 and math.isfinite(first_rad) and 0 < abs(step_rad) < math.pi):
        raise UsageError(f"a scan of {count} beams, {step_rad} rad apart", "as sensor_msgs/LaserScan has it")
    step = abs(step_rad)
    least = first_rad if step_rad > 0 else first_rad + (count - 1) * step_rad
    whole = round(math.tau / step)
    if count > whole + 1:
        raise UsageError(f"a scan of {count} beams, {step_rad} rad apart", "at most a full turn")
    used = min(count, whole)  # some drivers repeat the first beam at the end
    lidar = LidarConfig(
        beams=used,
        fov_rad=math.tau if used == whole else step * used,
        range_min_m=limits_m[0],
        range_max_m=min(limits_m[1], FARTHEST_M),
        noise_m=noise_m,
    )
    astray = math.remainder(mounted.yaw_rad + least - lidar.angle_min_rad, math.tau)
    first = 0
    if used == whole:
        first = round(-astray / step)
        astray += first * step
    elif abs(astray) > ASTRAY_RAD:
        raise UsageError(
            f"the lidar points {math.degrees(astray):.0f} degrees aside", "the middle beam must point forward"
        )
    eye = Place(x_m=mounted.x_m, y_m=mounted.y_m, yaw_rad=astray)
    return Beams(count, step_rad < 0, lidar, eye, first % used)


class Track:
    """Poses of the lidar by odometry, relative to its first pose; `travelled_m` counts forward and backward motion."""

    def __init__(self, eye: Place) -> None:
        self._eye, self._began = eye, Place()
        self._times: list[float] = []
        self._places: list[Place] = []
        self.travelled_m, self.newest_s = 0.0, -math.inf

    def add(self, t_s: float, base: Place, latest_s: float) -> bool:
        """Store the odometry of time `t_s`, unless it is not later than the last one.

        Return False, and store nothing, if it is dated after `latest_s`: later messages would then count as too old.
        """
        if t_s > latest_s:
            return False
        there = base.of(self._eye)
        if not self._times:
            self._began = there
        elif t_s <= self._times[-1]:
            return True
        here = self._began.sees(there)
        if self._places:
            last = self._places[-1]
            # Headings are unwrapped: a reading has the total rotation.
            yaw_rad = last.yaw_rad + math.remainder(here.yaw_rad - last.yaw_rad, math.tau)
            here = replace(here, yaw_rad=yaw_rad)
            self.travelled_m += math.dist((here.x_m, here.y_m), (last.x_m, last.y_m))
        self._times.append(t_s)
        self.newest_s = t_s
        self._places.append(here)
        del self._times[:-KEPT], self._places[:-KEPT]
        return True

    def at(self, t_s: float) -> Place | None:
        """Return the interpolated pose at a time, or the last one if it is later; None before the first."""
        if not self._times or t_s < self._times[0]:
            return None
        places = ([each.x_m, each.y_m, each.yaw_rad] for each in self._places)
        x_m, y_m, yaw_rad = (float(np.interp(t_s, self._times, axis)) for axis in zip(*places, strict=True))
        return Place(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)
