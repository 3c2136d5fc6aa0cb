"""From a LaserScan and odometry of ROS 2 to what a mission's robot reads; nothing of rclpy.

A mission's lidar is centred on forward and counts its beams to the left. Whatever a driver's scan is like becomes one,
beam for beam; what is left of its place on the robot is that of the robot's eye, whose way odometry is reckoned to.

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

# A lidar that does not see all around looks ahead, give or take so much.
ASTRAY_RAD = 0.35
FARTHEST_M = 60.0
KEPT = 200  # moments of odometry: four seconds of a fast one


@dataclass(frozen=True, slots=True)
class Beams:
    """Converts a driver's scans to those of `lidar`, which a mission knows; `eye` is its place on the robot."""

    count: int
    clockwise: bool
    lidar: LidarConfig
    eye: Place
    first: int

    def scan_of(self, ranges: Sequence[float]) -> LaserScan:
        """The same scan, as a mission's robot has it. Raises: UsageError: it has more beams, or fewer."""
        if len(ranges) != self.count:
            raise UsageError(f"a scan of {len(ranges)} beams", f"{self.count}, as the first one")
        said: NDArray[np.float64] = np.asarray(ranges, np.float64)
        lidar = self.lidar
        said = np.roll((said[::-1] if self.clockwise else said)[: lidar.beams], -self.first)
        return LaserScan(said, lidar.angle_min_rad, lidar.angle_increment_rad, lidar.range_min_m, lidar.range_max_m)


def beams_of(
    count: int, first_rad: float, step_rad: float, limits_m: tuple[float, float], noise_m: float, mounted: Place
) -> Beams:
    """Return how scans lie whose first beam is at `first_rad` of the laser's frame, each further one `step_rad` on.

    `limits_m` are range_min and range_max, `mounted` is the laser's frame in the robot's.
    Raises: UsageError: no lidar is so, or it looks aside.
    """
    if not (count >= 2 and math.isfinite(first_rad) and 0 < abs(step_rad) < math.pi):
        raise UsageError(f"a scan of {count} beams, {step_rad} rad apart", "as sensor_msgs/LaserScan has it")
    step = abs(step_rad)
    least = first_rad if step_rad > 0 else first_rad + (count - 1) * step_rad
    whole = round(math.tau / step)
    if count > whole + 1:
        raise UsageError(f"a scan of {count} beams, {step_rad} rad apart", "a whole turn at most")
    used = min(count, whole)  # the last beam of some drivers is their first again
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
        raise UsageError(f"a lidar that looks {math.degrees(astray):.0f} degrees aside", "its middle beam ahead")
    eye = Place(x_m=mounted.x_m, y_m=mounted.y_m, yaw_rad=astray)
    return Beams(count, step_rad < 0, lidar, eye, first % used)


class Track:
    """Follows the robot's eye by odometry, in a frame that begins where it did; `travelled_m` counts both ways."""

    def __init__(self, eye: Place) -> None:
        self._eye, self._began = eye, Place()
        self._times: list[float] = []
        self._places: list[Place] = []
        self.travelled_m, self.newest_s = 0.0, -math.inf

    def add(self, t_s: float, base: Place, latest_s: float) -> bool:
        """Odometry said this of that moment; one that is no later than the last is left out.

        And so is what is dated after `latest_s`, or all that comes until then would be too late; False says so.
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
            # Headings go on where a turn is full: a reading's is no angle but how far it turned.
            yaw_rad = last.yaw_rad + math.remainder(here.yaw_rad - last.yaw_rad, math.tau)
            here = replace(here, yaw_rad=yaw_rad)
            self.travelled_m += math.dist((here.x_m, here.y_m), (last.x_m, last.y_m))
        self._times.append(t_s)
        self.newest_s = t_s
        self._places.append(here)
        del self._times[:-KEPT], self._places[:-KEPT]
        return True

    def at(self, t_s: float) -> Place | None:
        """Where it was at that moment, the last place if odometry is not so far; None before the first."""
        if not self._times or t_s < self._times[0]:
            return None
        places = ([each.x_m, each.y_m, each.yaw_rad] for each in self._places)
        x_m, y_m, yaw_rad = (float(np.interp(t_s, self._times, axis)) for axis in zip(*places, strict=True))
        return Place(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)
