"""Simulated swarm of DotBot-like robots: two wheels, an LED, a battery, and known positions.

The state of all robots is one array with a column per robot; a step advances all of them together.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phalanx.errors import UsageError
from phalanx.robot import Point, Robot
from phalanx.robot.follow import wheels_towards
from phalanx.robot.roster import DEFAULT_THRESHOLD_MM, HISTORY, HISTORY_STEP_MM, Member, Roster, member
from phalanx.world.drive import AXLE_M, BODY_M, TOP_SPEED_MPS, turned

AREA_MM = (2000, 2000)
BODY_MM, AXLE_MM, TOP_SPEED_MMPS = (1000 * size for size in (BODY_M, AXLE_M, TOP_SPEED_MPS))
BATTERY_FULL_MV = 3000.0
BATTERY_EMPTY_MV = 2200.0
IDLE_MVPS = 0.15  # empty after an hour and a half without driving
DRIVE_MVPS = 0.45  # additional at full speed: empty after 22 minutes
CHARGE_S = 60.0
HISTORY_IN_ALL = 100_000
# Rows of that array: position, mm; direction, rad; wheels, percent; battery, mV; route threshold and next point, mm;
# last point of the trail, mm.
X, Y, ANGLE, LEFT, RIGHT, BATTERY, THRESHOLD, GOAL_X, GOAL_Y, TRAIL_X, TRAIL_Y = range(11)
ROWS = TRAIL_Y + 1
MAX_ROBOTS = 2000  # limit of the visitors' page


class Dotbots(Roster):
    """A `phalanx.robot.Swarm` advanced by `step`.

    Robots with an empty battery leave to charge, and return. The clock returns seconds since 1970. `unprotected` is the
    reason why robots do not audit each other, for users who expect audits, or "".

    Raises: UsageError: the count is out of range.
    """

    def __init__(self, count: int, seed: int, clock: Callable[[], float], *, unprotected: str = "") -> None:
        if not 1 <= count <= MAX_ROBOTS:
            raise UsageError(f"a swarm of {count} robots", f"use 1 to {MAX_ROBOTS}")
        super().__init__(())
        self._random = np.random.default_rng(seed)
        self._clock = clock
        self.unprotected = unprotected
        self._goals: list[int] = []
        self._charging: list[tuple[float, Member]] = []
        self._elapsed_s = 0.0
        self._created = 0
        # Set by another thread, applied in the next step before any movement.
        self._held, self._to_stop = False, set[str]()
        self._now = np.zeros((ROWS, 0))
        self._longest_trail = max(30, min(HISTORY, HISTORY_IN_ALL // count))
        self._following: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        for _ in range(count):
            self.join()

    @property
    def area_mm(self) -> tuple[int, int]:
        """Return width and height of the area."""
        return AREA_MM

    def robots(self) -> Sequence[Robot]:
        """Return all robots that are present."""
        now = self._clock()
        places = zip(
            self._now[X].tolist(),
            self._now[Y].tolist(),
            np.rint(np.degrees(self._now[ANGLE])).astype(int).tolist(),
            self._now[BATTERY].tolist(),
            strict=True,
        )
        return [
            self._members[i].snapshot(Point(x, y), direction, millivolts / 1000, now)
            for i, (x, y, direction, millivolts) in enumerate(places)
        ]

    def drive(self, address: str, left_pct: int, right_pct: int) -> None:
        """Set the wheels' speeds until the next order; ends waypoint following."""
        i = self._find(address)
        self._stop_following(i)
        self._now[LEFT, i] = max(-100, min(100, left_pct))
        self._now[RIGHT, i] = max(-100, min(100, right_pct))

    def stop(self, address: str) -> None:
        """Stop the robot until the next order."""
        self._find(address)
        self._to_stop.add(address)

    def hold(self) -> None:
        """Stop all robots until `release`."""
        self._held = True

    def release(self) -> None:
        """Allow driving again."""
        self._held = False

    def follow(self, address: str, route: Sequence[Point], threshold_mm: float) -> None:
        """Drive to these points in order; an empty route stops the robot."""
        i = self._find(address)
        self._stop_following(i)
        self._now[LEFT, i] = self._now[RIGHT, i] = 0
        self._now[THRESHOLD, i] = self._members[i].threshold_mm = threshold_mm
        if route:
            self._members[i].route = (Point(float(self._now[X, i]), float(self._now[Y, i])), *route)
            self._following[i] = True
            self._aim(i, 1)

    def clear_history(self, address: str) -> None:
        """Delete the robot's trail."""
        super().clear_history(address)
        i = self._find(address)
        self._now[TRAIL_X, i] = self._now[TRAIL_Y, i] = math.nan

    def join(self) -> str:
        """Add a robot at a random position, and return its address."""
        added = member(self._created)
        self._created += 1
        charge = self._random.uniform(0.5, 1.0)
        self._enter(added, BATTERY_EMPTY_MV + charge * (BATTERY_FULL_MV - BATTERY_EMPTY_MV))
        return added.address

    def leave(self, address: str) -> None:
        """Remove a robot."""
        gone = self._find(address)
        self._now = np.delete(self._now, gone, axis=1)
        self._following = np.delete(self._following, gone)
        del self._members[gone], self._goals[gone]
        self._number_rows()

    def step(self, dt_s: float) -> None:
        """Advance by `dt_s` seconds: steer, move, record, drain, charge."""
        self._elapsed_s += dt_s
        while self._to_stop:
            if (address := self._to_stop.pop()) in self._rows:
                self.drive(address, 0, 0)
        if self._held:
            self._now[LEFT] = self._now[RIGHT] = 0
            for i in np.flatnonzero(self._following).tolist():
                self._stop_following(i)
        self._steer()
        self._move(dt_s)
        self._record()
        self._drain(dt_s)

    def _enter(self, member: Member, battery_mv: float) -> None:
        edge = 4 * BODY_MM
        new = np.zeros((ROWS, 1))
        new[X] = self._random.uniform(edge, AREA_MM[0] - edge)
        new[Y] = self._random.uniform(edge, AREA_MM[1] - edge)
        new[ANGLE] = self._random.uniform(0, 2 * math.pi)
        new[BATTERY], new[THRESHOLD], new[TRAIL_X], new[TRAIL_Y] = battery_mv, DEFAULT_THRESHOLD_MM, math.nan, math.nan
        self._now = np.hstack((self._now, new))
        self._following = np.append(self._following, False)
        self._rows[member.address] = len(self._members)
        self._members.append(replace(member, route=(), history=deque(maxlen=self._longest_trail)))
        self._goals.append(0)

    def _stop_following(self, i: int) -> None:
        self._following[i] = False
        self._members[i].route = ()

    def _aim(self, i: int, goal: int) -> None:
        self._goals[i] = goal
        at = self._members[i].route[goal]
        self._now[GOAL_X, i], self._now[GOAL_Y, i] = at.x_mm, at.y_mm

    def _steer(self) -> None:
        if not self._following.any():
            return
        indices = np.flatnonzero(self._following)
        dx, dy = self._now[GOAL_X, indices] - self._now[X, indices], self._now[GOAL_Y, indices] - self._now[Y, indices]
        for i in indices[dx * dx + dy * dy <= self._now[THRESHOLD, indices] ** 2].tolist():
            if self._goals[i] + 1 < len(self._members[i].route):
                self._aim(i, self._goals[i] + 1)
            else:
                self._stop_following(i)
                self._now[LEFT, i] = self._now[RIGHT, i] = 0
        indices = np.flatnonzero(self._following)
        dx, dy = self._now[GOAL_X, indices] - self._now[X, indices], self._now[GOAL_Y, indices] - self._now[Y, indices]
        sin, cos = np.sin(self._now[ANGLE, indices]), np.cos(self._now[ANGLE, indices])
        # The robot's front points along (-sin, cos), its right-hand side along (-cos, -sin).
        self._now[LEFT, indices], self._now[RIGHT, indices] = wheels_towards(-dx * sin + dy * cos, -dx * cos - dy * sin)

    def _move(self, dt_s: float) -> None:
        left = self._now[LEFT] * (TOP_SPEED_MMPS / 100)
        right = self._now[RIGHT] * (TOP_SPEED_MMPS / 100)
        ahead, turn = turned(left, right, AXLE_MM, dt_s)
        middle = self._now[ANGLE] + turn / 2
        self._now[X] = np.clip(self._now[X] - ahead * np.sin(middle), BODY_MM, AREA_MM[0] - BODY_MM)
        self._now[Y] = np.clip(self._now[Y] + ahead * np.cos(middle), BODY_MM, AREA_MM[1] - BODY_MM)
        self._now[ANGLE] = np.mod(self._now[ANGLE] + turn, 2 * math.pi)

    def _record(self) -> None:
        dx, dy = self._now[X] - self._now[TRAIL_X], self._now[Y] - self._now[TRAIL_Y]
        driving = (self._now[LEFT] != 0) | (self._now[RIGHT] != 0)
        # NaN before the first point: not near.
        indices = np.flatnonzero(driving & ~(dx * dx + dy * dy < HISTORY_STEP_MM**2))
        self._now[TRAIL_X, indices], self._now[TRAIL_Y, indices] = self._now[X, indices], self._now[Y, indices]
        for i, x, y in zip(
            indices.tolist(), self._now[X, indices].tolist(), self._now[Y, indices].tolist(), strict=True
        ):
            self._members[i].history.append(Point(round(x, 1), round(y, 1)))

    def _drain(self, dt_s: float) -> None:
        effort = (np.abs(self._now[LEFT]) + np.abs(self._now[RIGHT])) / 200
        self._now[BATTERY] = np.maximum(self._now[BATTERY] - (IDLE_MVPS + DRIVE_MVPS * effort) * dt_s, BATTERY_EMPTY_MV)
        for i in reversed(np.flatnonzero(self._now[BATTERY] <= BATTERY_EMPTY_MV).tolist()):
            self._charging.append((self._elapsed_s + CHARGE_S, self._members[i]))
            self.leave(self._members[i].address)
        while self._charging and self._charging[0][0] <= self._elapsed_s:
            self._enter(self._charging.pop(0)[1], BATTERY_FULL_MV)
