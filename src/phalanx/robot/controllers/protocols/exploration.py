"""Exploration: an area is divided into places, each of which a robot must visit once.

A robot goes to the nearest place that is neither visited nor claimed; a doubted place (places.py) is visited again.
Source: RoboRebound §2.1, §2.3 (exploration, mapping); Yamauchi 1998 (the nearest frontier).
"""

from __future__ import annotations

from collections.abc import Collection

from phalanx.robot.controllers.places import PLACES, PlaceController, PlaceStage
from phalanx.robot.controllers.protocol import Protocol


class Explorer(PlaceController):
    """Robot of an exploration."""

    pace_mps = 1.5  # slow, to look around

    def worth(self, t_ms: int, place: int, away_m: float) -> float | None:
        """Return the negative distance of an unvisited place; None for a visited one."""
        return None if self.last_visit_ms(t_ms, place) else -away_m


class Map(PlaceStage):
    """Map of cells that robots have seen."""

    counts = "% seen"
    lost = "decrease of the share of the area seen by correct robots"
    bites_from = 5.0

    def score(self, left_out: Collection[int]) -> float:
        """Return the share of visited places, %."""
        seen = sum(any(rob_id not in left_out for _, rob_id in visits) for visits in self.visits)
        return 100 * seen / len(PLACES)

    def forget(self, _before_s: float) -> None:
        """Keep only the first visit of each robot to each place: the map is never reset."""
        firsts = [{rob_id: t_s for t_s, rob_id in reversed(visits)} for visits in self.visits]
        self.visits = [[(t_s, rob_id) for rob_id, t_s in first.items()] for first in firsts]


PROTOCOL = Protocol(Explorer, Map)
