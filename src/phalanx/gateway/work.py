"""What is told of a swarm's own work: what has come of it lately, and where the things are that it is about."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from phalanx.robot.swarm import AtWork

LOOK_EVERY_S = 1.0
MOST_THINGS = 32


class WorkWatch:
    """Looks at the work once a second, and at its things in every tick."""

    def __init__(self, swarm: AtWork) -> None:
        self._swarm = swarm
        self._look_at_s = 0.0
        self._things: list[list[int]] = []

    def news(self, _number: Callable[[str], int], uptime_s: float) -> dict[str, list[Any]]:
        """`work` and `things` of the next frame; the uptime is monotonic."""
        told: dict[str, list[Any]] = {}
        things = [[round(x_mm), round(y_mm)] for x_mm, y_mm in self._places()]
        is_due = uptime_s >= self._look_at_s
        if is_due and (done := self._swarm.done()):
            self._look_at_s = uptime_s + LOOK_EVERY_S
            score = None if done.score is None else round(done.score)
            told["work"] = [[done.name, score, done.counts, round(done.lately_s)]]
        if things != self._things or (things and is_due):
            self._things = things
            told["things"] = [things]
        return told

    def _places(self) -> list[tuple[float, float]]:
        return [(each.x_mm, each.y_mm) for each in self._swarm.things()[:MOST_THINGS]]
