"""Progress of a mission for the pages: decoded landmarks, each robot's state, and the number of nodes left.

Nothing here knows what no robot has decoded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

from phalanx.robot.on_mission import Decoded, DecodedPlace, News, NotValidated, OnMission, Progress, Walk
from phalanx.robot.swarm import WorkingSwarm

TELL_EVERY_S = LOOK_EVERY_S = 1.0
MOST_THINGS = 32


class MissionWatch:
    """Compares the mission with what visitors were told last. `say` is told what `--events` prints of it."""

    def __init__(self, swarm: OnMission, say: Callable[[dict[str, Any]], None]) -> None:
        self._swarm = swarm
        self._say = say
        self._walls = swarm.walls_mm()
        self._told: dict[str, Walk] = {}
        self._told_lit = 0
        self._told_progress: Progress | None = None
        self._tell_at_s = 0.0

    def news(self, number: Callable[[str], int], uptime_s: float) -> dict[str, list[Any]]:
        """`mission`, `lit` and `walks` of the next frame; `number` is what frames call a robot, uptime monotonic."""
        progress, lit = self._swarm.progress(), self._swarm.lit()
        if progress is not None and (self._told_progress is None or progress.id != self._told_progress.id):
            self._told_lit = 0
            self._say({"event": "mission", "what": "begun", "name": progress.name, "nodes": progress.nodes})
        walks = {walk.address: walk for walk in self._swarm.walks()}
        for address, news in self._swarm.news():
            self._say({"event": "mission", "robot": address, "who": walks[address].name, **_what(news, walks[address])})
        # Once a second in any case: whoever missed the frame with which it began finds out. And no more often of a
        # drift alone, which changes a little with every landmark.
        is_due = progress != self._told_progress or uptime_s >= self._tell_at_s
        changed = [walk for address, walk in walks.items() if _differs(walk, self._told.get(address), is_due)]
        self._told |= {walk.address: walk for walk in changed}
        new = lit[self._told_lit :]
        self._told_lit = len(lit)
        if is_due:
            self._tell_at_s = uptime_s + TELL_EVERY_S
        self._told_progress = progress
        return {
            "mission": [tell_progress(progress)] if is_due and progress is not None else [],
            "lit": [tell_lit(each) for each in new],
            "walks": [[number(walk.address), *tell_walk(walk)] for walk in changed],
        }

    def in_list(self) -> dict[str, dict[str, Any]]:
        """Return the mission fields of each robot for the answer to request 0, by address."""
        return {walk.address: {"walk": tell_walk(walk)} for walk in self._swarm.walks()}

    def in_area(self) -> dict[str, Any]:
        """Return the mission fields of the answer to request 1."""
        progress = self._swarm.progress()
        return {"walls": len(self._walls), "mission": None if progress is None else tell_progress(progress)}

    def walls(self) -> list[list[int]]:
        """The answer to request 2."""
        return self._walls

    def lit(self) -> list[list[Any]]:
        """The answer to request 3."""
        return [tell_lit(each) for each in self._swarm.lit()]

    def state(self) -> dict[str, Any]:
        """Return the mission's state for the operator's page."""
        progress = self._swarm.progress()
        return {
            "world": self._swarm.plan.name,
            "running": None if progress is None else asdict(progress),
            "robots": {
                walk.address: dict(zip(("phase", "decoded", "of", "why", "drift"), tell_walk(walk), strict=True))
                for walk in self._swarm.walks()
            },
        }


class WorkWatch:
    """Looks at the work once a second, and at its things in every tick."""

    def __init__(self, swarm: WorkingSwarm) -> None:
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


def _differs(walk: Walk, told: Walk | None, in_drift: bool) -> bool:
    return told is None or walk != (told if in_drift else replace(told, drift=walk.drift))


def _what(news: News, walk: Walk) -> dict[str, Any]:
    if isinstance(news, Decoded):
        return {
            "what": "decoded",
            "node": news.node,
            "name": news.name,
            "decoded": walk.decoded,
            "of": walk.of,
        }
    if isinstance(news, NotValidated):
        return {"what": "not validated", "reason": news.why}
    return {"what": "completed"}


def tell_progress(progress: Progress) -> list[Any]:
    """`[id, nodes, left]`."""
    return [progress.id[:16], progress.nodes, progress.left]


def tell_lit(lit: DecodedPlace) -> list[Any]:
    """`[x, y, type]`."""
    return [round(lit.at.x_mm), round(lit.at.y_mm), lit.type]


def tell_walk(walk: Walk) -> list[Any]:
    """`[phase, decoded, of, why, [way, turn, curve]]`."""
    return [walk.phase, walk.decoded, walk.of, walk.why, list(walk.drift)]
