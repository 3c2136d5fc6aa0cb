"""From an instruction to wheels, so that auditors come to the same command: no scan, no libm, no memory but its state.

The robot heads for the place where its instruction begins, then along the direction, or straight to a place that it
knows; around whatever the sectors of its reading say is in the way. Back it goes the way it came, where it does not see
the place: straight would lead into every corner of the building.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from phalanx.kernel import kernel
from phalanx.mission.landmarks.angles import atan2, sin_cos
from phalanx.mission.walk.outcome import Kind, Order

from .readings import CLEAR, CLEAR_STEP_M

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]
Point = tuple[float, float]

MARGIN_M = 0.25  # of the robot's middle from everything: its radius, a third, and half a sector
LOOK_M = 1.2
SHORT_M = 0.4
# In a doorway itself a robot does not see it: it arrives a little before, and slowly, four commands a second.
ARRIVE_M, NEAR_M, SLOW_M = 0.25, 0.9, 1.0
CARROT_M = 1.5
LINE_MAX_M = 25.0
HALT_S, STUCK_S = 2.0, 8.0
TRIES = 2
# From one remembered place of the way here to the next, in whole centimetres; so near is there.
CRUMB_M, THERE_M = 1.0, 0.7
TRAIL_MAX = 32
CM_PER_M = 100
PROGRESS_M = 0.1
SPEED_MPS = 0.6
TURN_RADPS = 1.2
TURN_GAIN = 1.5
ABOUT = 0.25  # cosine of a course: what lies further aside is turned to on the spot


@dataclass(frozen=True, slots=True)
class Leg:
    """How far an instruction has been carried out."""

    # The instruction: its kind, target and the node where it begins; -1 for none
    key: tuple[int, int, int] = (-1, -1, -1)
    passed: bool = False  # the place where it begins lies behind
    tries: int = 0  # begun anew after no headway
    best_m: float = math.inf  # least way that was left
    best_s: float = 0.0  # when that was
    # Places of the way here from where the instruction began, map frame, cm; what leads back
    trail: tuple[tuple[int, int], ...] = ()
    # 1 or -1 while it turns about, to the left or to the right, for a course that lies ahead; 0 otherwise
    turning: int = 0


@dataclass(frozen=True, slots=True)
class Drive:
    """What to do now: speeds, and whether the way is given up as blocked."""

    speed_mps: float = 0.0
    turn_radps: float = 0.0
    blocked: bool = False


class Sectors:
    """The directions of a reading's sectors, robot frame.

    Args:
        first_rad: where the field of view begins.
    """

    def __init__(self, first_rad: float, step_rad: float, count: int) -> None:
        self.widest_rad = -first_rad
        self.sines, self.cosines = np.empty(count), np.empty(count)
        for k in range(count):
            self.sines[k], self.cosines[k] = sin_cos(first_rad + (k + 0.5) * step_rad)


def drive(
    leg: Leg, order: Order, begin: int | None, pose: Pose, clear: NDArray[np.uint8], sectors: Sectors, t_s: float
) -> tuple[Leg, Drive]:
    """The next command for an instruction.

    Args:
        begin: the node at which it begins.
        pose: x, y, heading as the robot estimates it, map frame.
        clear: (sectors,) as in a reading.
    """
    if order.kind not in (Kind.GO, Kind.BACK):
        return Leg(), Drive()
    key = (_KINDS.index(order.kind), _number(order.target), _number(begin))
    if key != leg.key:
        trail = leg.trail if leg.key[2] == key[2] else ()
        leg = Leg(key, passed=order.place_m is None, best_s=t_s, trail=trail)
    leg = _remember(leg, order, pose)
    points = hits(clear, sectors.cosines, sectors.sines)
    leg, goal, left_m = _goal(leg, order, pose, points, t_s)
    if left_m < leg.best_m - PROGRESS_M:
        leg = replace(leg, best_m=left_m, best_s=t_s)
    elif t_s - leg.best_s > STUCK_S or left_m < 0:
        leg = replace(leg, tries=leg.tries + 1, passed=False, best_m=math.inf, best_s=t_s)
        if leg.tries >= TRIES:
            return Leg((-1, -1, key[2]), trail=leg.trail), Drive(blocked=True)
    command, turning = _toward(goal, points, sectors, leg.turning)
    return replace(leg, turning=turning), command


_KINDS = tuple(Kind)


def _number(node: int | None) -> int:
    return -1 if node is None else node


def _goal(leg: Leg, order: Order, pose: Pose, points: Floats, t_s: float) -> tuple[Leg, Point, float]:
    """(leg, goal in the robot's frame, metres that are left); fewer than none where the direction has led too far."""
    place = _local(pose, order.place_m or pose[:2])
    if order.kind is Kind.BACK:
        return _homeward(leg, place, pose, points)
    onward, left_m = _onward(order, pose)
    if not leg.passed:
        away = _length(place)
        halted = away < NEAR_M and t_s - leg.best_s > HALT_S
        # Far from where a direction begins it says nothing; a place that is known can be reached from anywhere.
        shorter = (order.toward_m is not None or away < 2 * CARROT_M) and _in_sight(points, onward)
        if away > ARRIVE_M and not halted and not shorter:
            return leg, place, away
        leg = replace(leg, passed=True, best_m=math.inf, best_s=t_s)
    return leg, onward, left_m


def _remember(leg: Leg, order: Order, pose: Pose) -> Leg:
    """Keeps the way from where the instruction begins: every so often the place where the robot is."""
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


def _homeward(leg: Leg, place: Point, pose: Pose, points: Floats) -> tuple[Leg, Point, float]:
    """(leg, where to go, metres that are left): to the place, or to the oldest remembered one in sight."""
    trail = leg.trail
    while trail and _length(_local(pose, _crumb(trail[-1]))) < THERE_M:
        trail = trail[:-1]
    if not trail or _in_sight(points, place):
        return replace(leg, trail=trail), place, _length(place)
    crumbs = [_local(pose, _crumb(crumb)) for crumb in trail]
    at = next((i for i, crumb in enumerate(crumbs) if _in_sight(points, crumb)), len(crumbs) - 1)
    return replace(leg, trail=trail[: at + 1]), crumbs[at], _length(crumbs[at]) + at * CRUMB_M


def _onward(order: Order, pose: Pose) -> tuple[Point, float]:
    """(where to go from the order's place on, metres that are left)."""
    if order.toward_m is not None:
        there = _local(pose, order.toward_m)
        return there, _length(there)
    assert order.direction_rad is not None, "an order to go has a direction or a place"
    x0, y0 = order.place_m or pose[:2]
    along_y, along_x = sin_cos(order.direction_rad)
    done_m = (pose[0] - x0) * along_x + (pose[1] - y0) * along_y
    ahead = max(done_m, 0.0) + CARROT_M
    return _local(pose, (x0 + ahead * along_x, y0 + ahead * along_y)), LINE_MAX_M - done_m


def _local(pose: Pose, point: Point) -> Point:
    """A point of the map in the robot's frame."""
    dx, dy = point[0] - pose[0], point[1] - pose[1]
    sine, cosine = sin_cos(pose[2])
    return cosine * dx + sine * dy, cosine * dy - sine * dx


def _length(point: Point) -> float:
    return math.sqrt(point[0] * point[0] + point[1] * point[1])


def _in_sight(points: Floats, goal: Point) -> bool:
    away = _length(goal)
    # What is farther than a sector's byte can say may have any wall before it.
    in_range = goal[0] > 0 and away < CLEAR * CLEAR_STEP_M
    return in_range and free_way(points, goal[0] / away, goal[1] / away) >= away


def _toward(goal: Point, points: Floats, sectors: Sectors, turning: int) -> tuple[Drive, int]:
    """(what to do now, which way it turns about).

    A free course at one edge of the view is lost as soon as the robot turns the least from it, and another at the other
    edge is nearer: it would turn to and fro for ever. So it goes on as it began, until a course lies ahead.
    """
    bearing = atan2(goal[1], goal[0])
    if _length(goal) < SHORT_M / 2:  # whoever has arrived looks around
        return Drive(0.0, TURN_RADPS if bearing >= 0.0 else -TURN_RADPS), 0
    cosine, sine, free_m = -1.0, goal[1], 0.0  # behind, where the lidar does not see
    if abs(bearing) <= sectors.widest_rad:
        cosine, sine, free_m = course(points, sectors.cosines, sectors.sines, goal[0], goal[1])
    if cosine < ABOUT:
        turning = turning or (1 if sine >= 0.0 else -1)
        return Drive(0.0, turning * TURN_RADPS), turning
    turn = max(-TURN_RADPS, min(TURN_RADPS, TURN_GAIN * atan2(sine, cosine)))
    ahead = cosine * cosine
    slow = min(1.0, max(0.1, free_m), max(0.2, _length(goal) / SLOW_M))
    return Drive(SPEED_MPS * (ahead * ahead) * slow, turn), 0


@kernel
def hits(clear: NDArray[np.uint8], cosines: Floats, sines: Floats) -> Floats:
    """(k, 2) where the nearest thing of each sector may be, robot frame; sectors that are clear have none."""
    out = np.empty((len(clear), 2))
    found = 0
    for k in range(len(clear)):
        if clear[k] != CLEAR:
            range_m = clear[k] * CLEAR_STEP_M
            out[found, 0], out[found, 1] = range_m * cosines[k], range_m * sines[k]
            found += 1
    return out[:found]


@kernel
def free_way(points: Floats, cosine: float, sine: float) -> float:
    """How far a robot gets in a direction before something comes nearer than MARGIN_M."""
    free = np.inf
    for k in range(len(points)):
        along = points[k, 0] * cosine + points[k, 1] * sine
        if 0.0 < along < free and abs(points[k, 1] * cosine - points[k, 0] * sine) < MARGIN_M:
            free = along
    return free


@kernel
def course(points: Floats, cosines: Floats, sines: Floats, goal_x: float, goal_y: float) -> tuple[float, float, float]:
    """(cosine, sine, free way) of the free course that is nearest to the goal's; without one, of the freest."""
    away = math.sqrt(goal_x * goal_x + goal_y * goal_y)
    need = min(LOOK_M, max(0.0, away - SHORT_M))
    best, freest = -2.0, -1.0
    chosen, fallback = -1, 0
    chosen_free = 0.0
    for k in range(len(cosines)):
        toward = (cosines[k] * goal_x + sines[k] * goal_y) / away
        if toward <= best:
            continue
        free = free_way(points, cosines[k], sines[k])
        if free >= need:
            best, chosen, chosen_free = toward, k, free
        elif free > freest:
            freest, fallback = free, k
    if chosen < 0:
        return cosines[fallback], sines[fallback], max(freest, 0.0)
    return cosines[chosen], sines[chosen], chosen_free
