"""Drive commands for an instruction of the mission, reproducible by auditors: no scans, no libm, no hidden state.

The robot drives to the place where the instruction begins, then along its direction, or straight to a known place. It
avoids the obstacles that it sees or remembers (course.py). To go back, it follows its own path if the place is out of
sight. The time without progress until it gives up, and the distance along a direction, are shares of the time limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from phalanx.mission.angles import sin_cos
from phalanx.mission.walk.state import Kind, Order

from .course import SPEED_MPS, Course, Goal, steer
from .field import MARGIN_M, Point
from .readings import Reading
from .surroundings import FADE_S, FRESH, SIDE, Pose, Sectors, Seen, Stop, sight

# Distance of arrival: a robot cannot see a doorway while in it, so it stops shortly before.
ARRIVE_M, NEAR_M = 0.25, 0.9
# A doorway between two shelves is visible only from outside: a robot at a known place without a sighting drives on.
PAST_M = 2.0
# A robot that waits at a place must stand in its cell, whose edge may be this near; outside, no search takes place.
AT_M = 0.2
CARROT_M = 1.5
# Goal of a detour along the line, farther away than the remembered surroundings.
BEYOND_M = 6.0
# Lateral offset of a line that would lead along a wall or against a pillar.
ASIDE_M = 0.6
HALT_S = 2.0
# Shares of the time limit for a validation: without progress, and on a line, so that the robot can still return.
PATIENCE, LINE = 1 / 3, 3 / 4
# Distance between stored points of the path, in whole centimetres, and distance at which one counts as reached.
CRUMB_M, THERE_M = 1.0, 0.7
TRAIL_MAX = 32
CM_PER_M = 100
PROGRESS_M = 0.1


@dataclass(frozen=True, slots=True)
class Leg:
    """Progress of an instruction, and the remembered surroundings."""

    # The instruction: its kind, target and the node where it begins; -1 for none
    key: tuple[int, int, int] = (-1, -1, -1)
    passed: bool = False  # whether the robot has passed the place where it begins
    best_m: float = math.inf  # smallest remaining distance so far
    best_s: float = 0.0  # time of that distance
    # Points of the path since the instruction began, for the way back, map frame, cm
    trail: tuple[tuple[int, int], ...] = ()
    course: Course = Course()  # noqa: RUF009  # frozen
    base: Stop = (0, 0)  # indices of the first cell, odometry frame
    seen_s: float = 0.0  # time of the last update of `cells`
    cells: bytes = bytes(SIDE * SIDE)  # obstacles around the robot (surroundings.py)


@dataclass(frozen=True, slots=True)
class Drive:
    """Drive command: speeds, and whether the robot gives the path up as blocked."""

    speed_mps: float = 0.0
    turn_radps: float = 0.0
    blocked: bool = False


def drive(
    leg: Leg, order: Order, begin: int | None, pose: Pose, now: Reading, sectors: Sectors, t_s: float, timeout_s: float
) -> tuple[Leg, Drive]:
    """Return the next command for an instruction, and its progress.

    Args:
        begin: node at which the instruction begins.
        pose: estimated x, y and heading, map frame.
        timeout_s: the mission's time limit for the next validation.
    """
    waits = order.kind is Kind.WAIT and order.place_m is not None
    if not (waits or order.kind in (Kind.GO, Kind.BACK)):
        return Leg(), Drive()
    if order.aside and order.place_m is not None and order.toward_m is None and order.direction_rad is not None:
        y, x = sin_cos(order.direction_rad)
        aside_m = order.aside * ASIDE_M
        order = replace(order, place_m=(order.place_m[0] - aside_m * y, order.place_m[1] + aside_m * x))
    key = (_KINDS.index(order.kind), _number(order.target), _number(begin))
    if key != leg.key:
        trail = leg.trail if leg.key[2] == key[2] else ()
        leg = replace(_anew(leg, key, trail), passed=order.place_m is None, best_s=t_s)
    if waits:  # at the place itself, not where the node came into sight
        place = _local(pose, order.place_m or pose[:2])
        return (leg, Drive()) if _length(place) < AT_M else _steered(leg, place, place, now, sectors, t_s)
    leg = _remember(leg, order, pose)
    leg, goal, beyond, left_m = _goal(leg, order, pose, now, sectors, t_s, LINE * SPEED_MPS * timeout_s)
    if left_m < leg.best_m - PROGRESS_M:
        leg = replace(leg, best_m=left_m, best_s=t_s)
    elif t_s - leg.best_s > PATIENCE * timeout_s or left_m < 0:
        return _anew(leg, (-1, -1, key[2]), leg.trail), Drive(blocked=True)
    return _steered(leg, goal, beyond, now, sectors, t_s)


_KINDS = tuple(Kind)


def _number(node: int | None) -> int:
    return -1 if node is None else node


def _anew(leg: Leg, key: tuple[int, int, int], trail: tuple[tuple[int, int], ...]) -> Leg:
    """Return the initial progress of another instruction, in the same surroundings."""
    course = Course(turning=leg.course.turning)
    return Leg(key, trail=trail, course=course, base=leg.base, seen_s=leg.seen_s, cells=leg.cells)


def _steered(leg: Leg, goal: Point, beyond: Point, now: Reading, sectors: Sectors, t_s: float) -> tuple[Leg, Drive]:
    cells = np.empty(SIDE * SIDE, np.uint8)
    fade = min(FRESH, max(0, int(t_s // FADE_S - leg.seen_s // FADE_S)))
    seen = Seen(np.frombuffer(leg.cells, np.uint8), leg.base, fade, now.pose, now.clear, sectors.fan)
    wanted = Goal(goal, beyond, looks=goal is not beyond)
    speed, turn, base, course = steer(seen, wanted, leg.course, t_s - leg.seen_s, cells)
    return replace(leg, course=course, base=base, seen_s=t_s, cells=cells.tobytes()), Drive(speed, turn)


def _goal(
    leg: Leg, order: Order, pose: Pose, now: Reading, sectors: Sectors, t_s: float, line_m: float
) -> tuple[Leg, Point, Point, float]:
    """Return leg, goal, goal of a detour, both in the robot frame, and metres left; < 0 beyond the end of the line."""
    place = _local(pose, order.place_m or pose[:2])
    if order.kind is Kind.BACK:
        return _homeward(leg, place, pose, now, sectors)
    onward, beyond, left_m = _onward(order, pose, line_m)
    if not leg.passed:
        away = _length(place)
        halted = away < NEAR_M and t_s - leg.best_s > HALT_S
        # A direction is meaningful only near its begin; a known place can be reached from anywhere.
        shorter = (order.toward_m is not None or away < 2 * CARROT_M) and _in_sight(now, sectors, onward)
        if away > ARRIVE_M and not halted and not shorter:
            return leg, place, place, away
        leg = replace(leg, passed=True, best_m=math.inf, best_s=t_s)
    return leg, onward, beyond, left_m


def _remember(leg: Leg, order: Order, pose: Pose) -> Leg:
    """Append the robot's position to the trail, once per CRUMB_M."""
    if order.kind is not Kind.GO:
        return leg
    trail = leg.trail
    if order.place_m is not None and _length(_local(pose, order.place_m)) < THERE_M:
        trail = ()
    if not trail or _length(_local(pose, _crumb(trail[-1]))) > CRUMB_M:
        trail = (*(trail if len(trail) < TRAIL_MAX else trail[::2]), (_cm(pose[0]), _cm(pose[1])))
    return leg if trail is leg.trail else replace(leg, trail=trail)


def _cm(value_m: float) -> int:
    return round(value_m * CM_PER_M)


def _crumb(crumb: tuple[int, int]) -> Point:
    return crumb[0] / CM_PER_M, crumb[1] / CM_PER_M


def _homeward(leg: Leg, place: Point, pose: Pose, now: Reading, sectors: Sectors) -> tuple[Leg, Point, Point, float]:
    """Return the result of `_goal` on the way back: the place, or the oldest point of the trail in sight."""
    trail = leg.trail
    while trail and _length(_local(pose, _crumb(trail[-1]))) < THERE_M:
        trail = trail[:-1]
    leg = leg if trail is leg.trail else replace(leg, trail=trail)
    if not trail or _in_sight(now, sectors, place):
        return leg, place, place, _length(place)
    crumbs = [_local(pose, _crumb(crumb)) for crumb in trail]
    at = next((i for i, crumb in enumerate(crumbs) if _in_sight(now, sectors, crumb)), len(crumbs) - 1)
    return replace(leg, trail=trail[: at + 1]), crumbs[at], crumbs[at], _length(crumbs[at]) + at * CRUMB_M


def _onward(order: Order, pose: Pose, line_m: float) -> tuple[Point, Point, float]:
    """Return the goal after passing the order's place, the goal of a detour, and the metres left."""
    if order.toward_m is not None:
        there = _past(order, pose, order.toward_m)
        return there, there, _length(there)
    assert order.direction_rad is not None, "an order to go has a direction or a place"
    x0, y0 = order.place_m or pose[:2]
    along_y, along_x = sin_cos(order.direction_rad)
    done_m = (pose[0] - x0) * along_x + (pose[1] - y0) * along_y
    near, far = max(done_m, 0.0) + CARROT_M, max(done_m, 0.0) + BEYOND_M
    onward = _local(pose, (x0 + near * along_x, y0 + near * along_y))
    return onward, _local(pose, (x0 + far * along_x, y0 + far * along_y)), line_m - done_m


def _past(order: Order, pose: Pose, there_m: Point) -> Point:
    """Return the goal, robot frame: a known place, or beyond it in the same direction if not seen from there."""
    there = _local(pose, there_m)
    x0, y0 = order.place_m or pose[:2]
    dx, dy = there_m[0] - x0, there_m[1] - y0
    way_m = _length((dx, dy))
    is_before = (pose[0] - there_m[0]) * dx + (pose[1] - there_m[1]) * dy < 0.0
    if way_m < NEAR_M or (is_before and _length(there) > ARRIVE_M):
        return there
    return _local(pose, (there_m[0] + PAST_M * dx / way_m, there_m[1] + PAST_M * dy / way_m))


def _local(pose: Pose, point: Point) -> Point:
    """Return a point of the map in the robot frame."""
    dx, dy = point[0] - pose[0], point[1] - pose[1]
    sine, cosine = sin_cos(pose[2])
    return cosine * dx + sine * dy, cosine * dy - sine * dx


def _length(point: Point) -> float:
    return math.sqrt(point[0] * point[0] + point[1] * point[1])


def _in_sight(now: Reading, sectors: Sectors, goal: Point) -> bool:
    return sight(now.clear, sectors.cosines, sectors.sines, goal[0], goal[1], MARGIN_M)
