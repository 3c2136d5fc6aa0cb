"""The paper's example attack: others are claimed to stand between a victim and the goal."""

from __future__ import annotations

from typing import Any

from phalanx.bti.fleet import PLAIN
from phalanx.robot.cnode import EVERYBODY, Action
from phalanx.robot.controllers.spoof import spoofed_state
from phalanx.wire.table import KIND_STATE

from .liar import MOTION, Liar

# Each victim hears a lie in each control period: the adversary broadcasts "faster than correct c-nodes".
LIES_PERIOD_MS = 250


class Spoof(Liar):
    """Claims, in the name of a random other robot and for one victim after the other, to be in the victim's way.

    With `strong=1`, where no a-node makes a broadcast of each frame, every other robot is claimed to be in the way of
    each victim, which alone hears of it.
    Source: RoboRebound §5.3; the choice of whose name is ours (docs/spec/rebound.md).
    """

    period_ms = 10

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._turn = 0
        self._strong = bool(self.plan.options.get("strong")) and self.profile == PLAIN

    def on_wake(self, now_ms: int) -> list[Action]:
        """The lies that are due."""
        victims = sorted(self.seen)
        due = (now_ms - self.plan.start_ms) * len(victims) // LIES_PERIOD_MS
        self._turn = max(self._turn, due - len(victims))
        actions: list[Action] = []
        while self._turn < due:
            victim = victims[self._turn % len(victims)]
            self._turn += 1
            others = [rob_id for rob_id in self.plan.ids if rob_id not in (victim, self.id)]
            if self._strong:
                for name in others:
                    actions += self.send(now_ms, self._lie(now_ms, victim, name), victim)
            elif others:
                name = others[int(self.plan.chance.integers(len(others)))]
                actions += self.send(now_ms, self._lie(now_ms, victim, name), EVERYBODY)
        return actions

    def _lie(self, now_ms: int, victim: int, name: int) -> bytes:
        """The state that `name` is claimed to have."""
        where = self.seen[victim]
        return MOTION.pack(KIND_STATE, name, now_ms, *spoofed_state((where.x_m, where.y_m), self.plan.goal_m))
