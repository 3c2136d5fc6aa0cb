"""Exploration: an area is split into places, each of which somebody has to see once.

A robot goes to the nearest place that nobody has seen or taken on; a doubted place (places.py) is seen again.
Source: RoboRebound §2.1, §2.3 (exploration, mapping); Yamauchi 1998 (the nearest frontier).
"""

from __future__ import annotations

from collections.abc import Collection

from phalanx.robot.controllers.places import PLACES, PlaceController, PlaceStage
from phalanx.robot.controllers.protocol import Protocol


class Explorer(PlaceController):
    """One robot of an exploration."""

    pace_mps = 1.5  # it looks around

    def worth(self, t_ms: int, place: int, away_m: float) -> float | None:
        """The nearer the better; nothing where somebody was."""
        return None if self.last_visit_ms(t_ms, place) else -away_m


class Map(PlaceStage):
    """Map of cells that robots have seen."""

    counts = "% seen"
    lost = "so much less of the area is seen by correct robots"
    bites_from = 5.0

    def score(self, left_out: Collection[int]) -> float:
        """The share of places, %."""
        seen = sum(any(rob_id not in left_out for _, rob_id in visits) for visits in self.visits)
        return 100 * seen / len(PLACES)

    def forget(self, _before_s: float) -> None:
        """Nothing: what is on the map stays there. Once of each robot is enough."""
        firsts = [{rob_id: t_s for t_s, rob_id in reversed(visits)} for visits in self.visits]
        self.visits = [[(t_s, rob_id) for rob_id, t_s in first.items()] for first in firsts]


PROTOCOL = Protocol(Explorer, Map)
