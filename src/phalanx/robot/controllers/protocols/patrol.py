"""Patrolling: places are visited again and again, so that none is alone for long.

A robot goes where nobody has been for longest, less the way there: the conscientious reactive patrol, with what others
say of their visits. Source: RoboRebound §2.1, §2.3 (patrolling, surveillance); Machado et al. 2002.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection

from phalanx.robot.controllers.places import PLACES, PlaceController, PlaceStage
from phalanx.robot.controllers.protocol import Protocol

WATCHED_S = 30.0  # so long after a visit nobody would have slipped in


class Patrol(PlaceController):
    """One robot of a patrol."""

    def worth(self, t_ms: int, place: int, away_m: float) -> float:
        """How long nobody was there by the time it would be."""
        return (t_ms - self.last_visit_ms(t_ms, place)) / 1000 - away_m / self.body.pace_mps


class Watch(PlaceStage):
    """A place is watched for a while after each visit."""

    counts = "% watched"
    lost = "so much less of the places and the time is watched by correct robots, of all that could be"
    bites_from = 5.0

    def score(self, left_out: Collection[int]) -> float:
        """The share of places and time, %."""
        watched_s = 0.0
        for visits in self.visits:
            times = [t_s for t_s, rob_id in visits if rob_id not in left_out]
            watched_s += sum(self._watched_s(t_s, later) for t_s, later in itertools.pairwise([*times, self.now_s]))
        return 100 * watched_s / (len(PLACES) * max(self.now_s - self.since_s, 1e-9))

    def _watched_s(self, visit_s: float, later_s: float) -> float:
        begin_s = max(visit_s, self.since_s)
        return max(0.0, min(WATCHED_S - (begin_s - visit_s), later_s - begin_s))

    def forget(self, before_s: float) -> None:
        """See `Stage`."""
        super().forget(before_s)
        self.visits = [[each for each in visits if each[0] >= before_s - WATCHED_S] for visits in self.visits]


PROTOCOL = Protocol(Patrol, Watch)
