"""Target tracking: robots keep a moving target in sight that is faster than they are.

The four nearest robots go to its reported position, so that it is handed over from robot to robot. Source: RoboRebound
§2.3; Parker 2002 (cooperative observation of moving targets by local sensors and messages); the rule is ours.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from itertools import pairwise

from phalanx.robot.controllers.peer_bodies import WHEELS_MPS
from phalanx.robot.controllers.protocol import Point, Protocol, Task
from phalanx.robot.controllers.sightings import SightController, SightStage, drawn, middle_m

TARGET, PACES = 0, 1.5  # number of the target, and its speed in units of the robots'
WATCHERS = 2  # robots that must see it at once to track it


class Tracker(SightController):
    """Robot that follows the target, or waits at its post."""

    party, pace_mps = 4, 4.0


class Target(SightStage):
    """The target, which moves between random positions in the area, determined by the seed."""

    counts = "% tracked"
    lost = "increase of the time in which fewer than two correct robots see the target"
    bites_from = 5.0

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self.pace_mps = PACES * (Tracker.pace_mps if task.wheels is None else WHEELS_MPS)
        self._way = [(0.0, middle_m(task))]  # times and positions at the turns of its path
        self._legs = 1
        self.watchers: dict[int, set[int]] = {}  # by control step, the robots that saw it

    def things(self, t_s: float) -> dict[int, Point]:
        """Return the position of the target."""
        while self._way[-1][0] <= t_s:
            was_s, was_m = self._way[-1]
            place_m = self._place(self._legs)
            self._legs += 1
            self._way.append((was_s + max(1.0, math.dist(was_m, place_m) / self.pace_mps), place_m))
        for (left_s, left_m), (due_s, due_m) in pairwise(self._way):
            if left_s <= t_s < due_s:
                share = (t_s - left_s) / (due_s - left_s)
                x, y = (a + share * (b - a) for a, b in zip(left_m, due_m, strict=True))
        return {TARGET: (x, y)}

    def _place(self, leg: int) -> Point:
        shares = drawn(f"target {self.task.seed} {leg}")
        x, y = zip(*self.task.waits_m, strict=True)
        x_m, y_m = self.task.origin_m
        return x_m + shares[0] * (max(x) - x_m), y_m + shares[1] * (max(y) - y_m)

    def look(self, rob_id: int, t_s: float, place_m: Point, *, lies: bool) -> bytes:
        """Return the target if it is in sight, and count the control step for the score."""
        self.watchers.setdefault(self._step(t_s), set())
        return super().look(rob_id, t_s, place_m, lies=lies)

    def _step(self, t_s: float) -> int:
        return int(1000 * t_s) // self.task.control_ms

    def near(self, rob_id: int, t_s: float, _number: int, _away_m: float) -> None:
        """Record that a robot sees the target."""
        self.watchers[self._step(t_s)].add(rob_id)

    def marks(self) -> list[Point]:
        """Return the places where the target turned."""
        return [place_m for _, place_m in self._way]

    def score(self, left_out: Collection[int]) -> float:
        """Return the share of time in which the target was tracked, %."""
        seen = sum(len(each.difference(left_out)) >= WATCHERS for each in self.watchers.values())
        return 100 * seen / max(1, len(self.watchers))

    def forget(self, before_s: float) -> None:
        """Restart the score at `before_s`, and drop earlier steps and turns."""
        super().forget(before_s)
        self.watchers = {step: ids for step, ids in self.watchers.items() if step >= self._step(before_s)}
        while len(self._way) > 1 and self._way[1][0] < before_s:
            del self._way[0]


PROTOCOL = Protocol(Tracker, Target)
