"""From an instruction to wheels: a robot that knows no map drives where the order says, around what its lidar shows.

It heads for the place where the instruction begins, then along the direction, or straight to what it sees it can reach.
Back it goes the way it came: straight would lead into every corner of the building.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from phalanx.kernel import kernel
from phalanx.mission.landmarks.scan import LaserScan
from phalanx.mission.walk.outcome import Kind, Order
from phalanx.sim.building.odometry import Pose

Floats = NDArray[np.float64]
Point = tuple[float, float]

MARGIN_M = 0.23  # of the middle of the robot from everything: its radius and a third
COURSE_BEAMS, POINT_BEAMS = 8, 4  # courses are 2 degrees apart; obstacles are one of 4 beams, the nearest
LOOK_M = 1.2  # a course is free if nothing comes for so long, or until shortly before the goal
SHORT_M = 0.4
# In the middle of a doorway, or as near to a corner as its walls let a robot.
ARRIVE_M, NEAR_M = 0.15, 0.9
CARROT_M = 1.5
LINE_MAX_M = 25.0
HALT_S, STUCK_S = 2.0, 8.0
TRIES = 2
PROGRESS_M = 0.1
CRUMB_M, THERE_M = 0.5, 0.7  # from one remembered place of the way here to the next; so near is there
SPEED_MPS = 0.6
TURN_RADPS = 1.5
TURN_GAIN = 2.0


@kernel
def _obstacles(ranges: Floats, cosines: Floats, sines: Floats) -> Floats:
    """(k, 2) the nearest hit of every POINT_BEAMS beams, robot frame."""
    out = np.empty((len(ranges) // POINT_BEAMS + 1, 2))
    found = 0
    for first in range(0, len(ranges), POINT_BEAMS):
        best, at = np.inf, -1
        for k in range(first, min(first + POINT_BEAMS, len(ranges))):
            if ranges[k] < best:  # neither a miss nor a beam that says nothing
                best, at = ranges[k], k
        if at >= 0:
            out[found, 0], out[found, 1] = best * cosines[at], best * sines[at]
            found += 1
    return out[:found]


@kernel
def _free(points: Floats, cosine: float, sine: float, margin_m: float) -> float:
    """How far a robot gets in a direction before something comes nearer than `margin_m`."""
    free = np.inf
    for k in range(len(points)):
        along = points[k, 0] * cosine + points[k, 1] * sine
        if 0.0 < along < free and abs(points[k, 1] * cosine - points[k, 0] * sine) < margin_m:
            free = along
    return free


@kernel
def _is_free(points: Floats, cosine: float, sine: float, margin_m: float, need_m: float) -> bool:
    """Whether a robot gets so far in a direction."""
    for k in range(len(points)):
        along = points[k, 0] * cosine + points[k, 1] * sine
        if 0.0 < along < need_m and abs(points[k, 1] * cosine - points[k, 0] * sine) < margin_m:
            return False
    return True


@kernel
def _course(
    points: Floats, cosines: Floats, sines: Floats, goal_x: float, goal_y: float, margin_m: float
) -> tuple[float, float, float]:
    """(cosine, sine, free way) of the free course that is nearest to the goal's; without one, of the freest."""
    away = math.sqrt(goal_x * goal_x + goal_y * goal_y)
    need = min(LOOK_M, max(0.0, away - SHORT_M))
    toward = np.empty(len(cosines))
    straight = 0
    for k in range(0, len(cosines), COURSE_BEAMS):
        toward[k] = (cosines[k] * goal_x + sines[k] * goal_y) / away
        if toward[k] > toward[straight]:
            straight = k
    chosen = straight
    if not _is_free(points, cosines[straight], sines[straight], margin_m, need):
        chosen, best = -1, -2.0
        for k in range(0, len(cosines), COURSE_BEAMS):
            if toward[k] > best and _is_free(points, cosines[k], sines[k], margin_m, need):
                chosen, best = k, toward[k]
    if chosen >= 0:
        return cosines[chosen], sines[chosen], _free(points, cosines[chosen], sines[chosen], margin_m)
    freest = -1.0
    for k in range(0, len(cosines), COURSE_BEAMS):
        free = _free(points, cosines[k], sines[k], margin_m)
        if free > freest:
            freest, chosen = free, k
    return cosines[chosen], sines[chosen], max(freest, 0.0)


class Pilot:
    """One robot's way of carrying out orders."""

    def __init__(self) -> None:
        self._leg: object = None
        self._passed = False
        self._tries = 0
        self._best_m = math.inf
        self._best_s = 0.0
        self._home: Point | None = None
        self._trail: list[Point] = []

    def step(self, order: Order, pose: Pose, scan: LaserScan, t_s: float) -> tuple[float, float, bool]:
        """(speed_mps, turn_radps, blocked) for an order.

        Args:
            order: in force.
            pose: as the robot estimates it.
            scan: of this moment.
            t_s: now.
        Returns: `blocked` if there was no headway for STUCK_S, TRIES times; each begins where the order does.
        """
        if order.kind not in (Kind.GO, Kind.BACK):
            self._leg = None
            return 0.0, 0.0, False
        leg = (order.kind, order.target, order.place_m)
        if leg != self._leg:
            self._leg, self._tries = leg, 0
            self._begin(t_s, passed=order.place_m is None)
        self._remember(order, pose)
        points = _obstacles(scan.ranges_m, *scan.beams)
        (x, y), left_m = self._goal(order, pose, points, t_s)
        if left_m < self._best_m - PROGRESS_M:
            self._best_m, self._best_s = left_m, t_s
        elif t_s - self._best_s > STUCK_S or left_m < 0:
            self._tries += 1
            self._begin(t_s, passed=False)
            if self._tries >= TRIES:
                self._leg = None
                return 0.0, 0.0, True
        return (*_drive(points, scan, x, y), False)

    def _begin(self, t_s: float, *, passed: bool) -> None:
        self._passed = passed
        self._best_m, self._best_s = math.inf, t_s

    def _goal(self, order: Order, pose: Pose, points: Floats, t_s: float) -> tuple[Point, float]:
        """(goal in the robot's frame, metres that are left); fewer than none where the direction has led too far."""
        place = _local(pose, order.place_m or pose[:2])
        if order.kind is Kind.BACK:
            return self._homeward(place, pose, points)
        onward = self._onward(order, pose)
        if not self._passed:
            away = math.hypot(*place)
            halted = away < NEAR_M and t_s - self._best_s > HALT_S
            # Far from where a direction begins it says nothing; a place that is known can be reached from anywhere.
            shorter = (order.toward_m is not None or away < 2 * CARROT_M) and _in_sight(points, onward[0])
            if away > ARRIVE_M and not halted and not shorter:
                return place, away
            self._begin(t_s, passed=True)
        return onward

    def _remember(self, order: Order, pose: Pose) -> None:
        """Keeps the way from where the order begins: every so often the place where the robot is."""
        if order.place_m != self._home or math.dist(pose[:2], order.place_m or pose[:2]) < THERE_M:
            self._home, self._trail = order.place_m, []
        if order.kind is Kind.GO and (not self._trail or math.dist(pose[:2], self._trail[-1]) > CRUMB_M):
            self._trail.append(pose[:2])

    def _homeward(self, place: Point, pose: Pose, points: Floats) -> tuple[Point, float]:
        """(where to go, metres that are left): to the place, or to the oldest remembered one in sight."""
        while self._trail and math.dist(pose[:2], self._trail[-1]) < THERE_M:
            self._trail.pop()
        if not self._trail or _in_sight(points, place):
            return place, math.hypot(*place)
        crumbs = [_local(pose, crumb) for crumb in self._trail]
        at = next((i for i, crumb in enumerate(crumbs) if _in_sight(points, crumb)), len(crumbs) - 1)
        del self._trail[at + 1 :]
        return crumbs[at], math.hypot(*crumbs[at]) + at * CRUMB_M

    @staticmethod
    def _onward(order: Order, pose: Pose) -> tuple[Point, float]:
        """(where to go from the order's place on, metres that are left)."""
        if order.toward_m is not None:
            there = _local(pose, order.toward_m)
            return there, math.hypot(*there)
        assert order.direction_rad is not None, "an order to go has a direction or a place"
        x0, y0 = order.place_m or pose[:2]
        along_x, along_y = math.cos(order.direction_rad), math.sin(order.direction_rad)
        done_m = (pose[0] - x0) * along_x + (pose[1] - y0) * along_y
        ahead = max(done_m, 0.0) + CARROT_M
        return _local(pose, (x0 + ahead * along_x, y0 + ahead * along_y)), LINE_MAX_M - done_m


def _local(pose: Pose, point: Point) -> Point:
    """A point of the map in the robot's frame."""
    dx, dy = point[0] - pose[0], point[1] - pose[1]
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    return cosine * dx + sine * dy, cosine * dy - sine * dx


def _in_sight(points: Floats, goal: Point) -> bool:
    away = math.hypot(*goal)
    return goal[0] > 0 and _free(points, goal[0] / away, goal[1] / away, MARGIN_M) >= away


def _drive(points: Floats, scan: LaserScan, x: float, y: float) -> tuple[float, float]:
    away = math.hypot(x, y)
    cosines, sines = scan.beams
    bearing = math.atan2(y, x)
    widest = -scan.angle_min_rad
    if away < SHORT_M / 2 or abs(bearing) > widest:
        # Behind is where the lidar does not see; and whoever has arrived looks around.
        return 0.0, math.copysign(TURN_RADPS, bearing)
    cosine, sine, free_m = _course(points, cosines, sines, x, y, MARGIN_M)
    course = math.atan2(sine, cosine)
    turn = max(-TURN_RADPS, min(TURN_RADPS, TURN_GAIN * course))
    return SPEED_MPS * max(0.0, cosine) ** 4 * min(1.0, max(0.1, free_m)), turn
