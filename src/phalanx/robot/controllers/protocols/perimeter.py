"""Perimeter defence: robots on a ring, and intruders heading for its centre; two robots together catch one.

The two nearest robots go to a reported intruder; usually only one of them sees it. Source: RoboRebound §2.3 (perimeter
defence); Agmon, Kaminka and Kraus 2011 (robots along a fence); the rule of two robots is ours.
"""

from __future__ import annotations

import math
from collections.abc import Collection

from phalanx.robot.controllers.protocol import Point, Protocol, Task
from phalanx.robot.controllers.sightings import SightController, SightStage, drawn, middle_m

PAIR = 2
# Lengths are in steps, the spacing of the ring.
CATCH_STEPS = 0.25  # distance at which a robot touches an intruder
AT_ONCE_S = 0.5  # time within which two robots must touch it
EVERY_S, FIRST_S = 5.0, 5.0  # interval of intruders, and start of the first
FROM_STEPS, CORE = 2.0, 0.4  # start of intruders outside the ring, and share of its radius at which they are through
PACE_STEPS = 0.15625  # speed of intruders, steps per second


class Sentry(SightController):
    """Robot of the ring."""

    party = PAIR


class Intruders(SightStage):
    """Intruders; the seed decides when and where they come. They leave when caught or through."""

    counts = "% caught"
    lost = "increase of the share of intruders that get through"
    bites_from = 5.0

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self.middle_m = middle_m(task)
        self.ring_m = max(math.dist(self.middle_m, post) for post in task.waits_m)
        self.pace_mps = PACE_STEPS * task.step_m
        self.caught: dict[int, tuple[int, ...]] = {}  # by intruder, the robots that caught it
        self._hands: dict[int, dict[int, float]] = {}  # by intruder, times at which robots last touched it

    @property
    def _lasts_s(self) -> float:
        return (self.ring_m * (1 - CORE) + FROM_STEPS * self.task.step_m) / self.pace_mps

    def things(self, t_s: float) -> dict[int, Point]:
        """Return the positions of the intruders under way."""
        latest = math.floor((t_s - FIRST_S) / EVERY_S)
        ways_s = {number: t_s - FIRST_S - number * EVERY_S for number in range(self._through_by(t_s), latest + 1)}
        return {
            number: self._place_m(number, on_way_s)
            for number, on_way_s in ways_s.items()
            if number not in self.caught and on_way_s < self._lasts_s
        }

    def _place_m(self, number: int, on_way_s: float) -> Point:
        angle = math.tau * drawn(f"intruder {self.task.seed} {number}")[0]
        away_m = self.ring_m + FROM_STEPS * self.task.step_m - self.pace_mps * on_way_s
        return self.middle_m[0] + away_m * math.cos(angle), self.middle_m[1] + away_m * math.sin(angle)

    def near(self, rob_id: int, t_s: float, number: int, away_m: float) -> None:
        """Record a touch; two robots that touch an intruder at once catch it."""
        if away_m > CATCH_STEPS * self.task.step_m:
            return
        hands = self._hands.setdefault(number, {})
        hands[rob_id] = t_s
        if len(both := [each for each, at_s in hands.items() if t_s - at_s <= AT_ONCE_S]) >= PAIR:
            self.caught[number] = tuple(both)

    def marks(self) -> list[Point]:
        """Return the places where intruders got through."""
        come = range(self._through_by(self.now_s))
        return [self._place_m(number, self._lasts_s) for number in come if number not in self.caught]

    def _through_by(self, t_s: float) -> int:
        """Return the number of intruders that had time to get through by `t_s`."""
        return max(0, math.floor((t_s - FIRST_S - self._lasts_s) / EVERY_S) + 1)

    def score(self, left_out: Collection[int]) -> float:
        """Return the share caught of intruders that had time to get through, %."""
        come = range(self._through_by(self.since_s), self._through_by(self.now_s))
        by = [self.caught.get(number, ()) for number in come]
        return 100 * sum(any(each not in left_out for each in both) for both in by) / max(1, len(by))

    def score_so_far(self, left_out: Collection[int]) -> float | None:
        """Return the score; None until the first intruder had time to get through."""
        return self.score(left_out) if self._through_by(self.now_s) > self._through_by(self.since_s) else None

    def forget(self, before_s: float) -> None:
        """Restart the score at `before_s`, and drop intruders that no longer count."""
        super().forget(before_s)
        first = self._through_by(before_s)
        self.caught = {number: both for number, both in self.caught.items() if number >= first}
        self._hands = {number: hands for number, hands in self._hands.items() if number >= first}


PROTOCOL = Protocol(Sentry, Intruders)
