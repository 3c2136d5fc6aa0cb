"""Patrolling: places are visited again and again, so that none stays unobserved for long.

A robot goes to the place with the longest time since its last visit, minus the travel time: the conscientious reactive
strategy, with visits that others report.
Source: RoboRebound §2.1, §2.3 (patrolling, surveillance); Machado et al. 2002.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection

from phalanx.robot.controllers.places import PLACES, PlaceController, PlaceStage
from phalanx.robot.controllers.protocol import Protocol

WATCHED_S = 30.0  # time after a visit for which a place counts as watched


class Patrol(PlaceController):
    """Robot of a patrol."""

    def worth(self, t_ms: int, place: int, away_m: float) -> float:
        """Return the seconds since the last visit, minus the travel time."""
        return (t_ms - self.last_visit_ms(t_ms, place)) / 1000 - away_m / self.body.pace_mps


class Watch(PlaceStage):
    """Share of places that are watched, for a while after each visit."""

    counts = "% watched"
    lost = "decrease of the share of places and time watched by correct robots"
    bites_from = 5.0

    def score(self, left_out: Collection[int]) -> float:
        """Return the watched share of places and time, %."""
        watched_s = 0.0
        for visits in self.visits:
            times = [t_s for t_s, rob_id in visits if rob_id not in left_out]
            watched_s += sum(self._watched_s(t_s, later) for t_s, later in itertools.pairwise([*times, self.now_s]))
        return 100 * watched_s / (len(PLACES) * max(self.now_s - self.since_s, 1e-9))

    def _watched_s(self, visit_s: float, later_s: float) -> float:
        begin_s = max(visit_s, self.since_s)
        return max(0.0, min(WATCHED_S - (begin_s - visit_s), later_s - begin_s))

    def forget(self, before_s: float) -> None:
        """Restart the score at `before_s`, and drop visits that no longer count."""
        super().forget(before_s)
        self.visits = [[each for each in visits if each[0] >= before_s - WATCHED_S] for visits in self.visits]


PROTOCOL = Protocol(Patrol, Watch)
