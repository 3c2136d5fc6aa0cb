"""The paper's example attack: others are claimed to stand between a victim and the goal."""

from __future__ import annotations

import math
from typing import Any

from phalanx.bti.fleet import PLAIN
from phalanx.robot.actions import EVERYBODY, Action
from phalanx.wire.table import KIND_STATE

from .liar import MOTION, Liar, Motion

# Each victim hears a lie in each control period: the adversary broadcasts "faster than correct c-nodes". Several liars
# may share the work: ten of them at that pace fill the channel by themselves.
LIES_PERIOD_S = 0.25
LIES_MPS, TOLD_APART_MPS = 1.0, 1e-6


def spoofed_state(
    victim_pos: tuple[float, float], goal: tuple[float, float], z: float = 150.0, eps: float = 2.0
) -> tuple[float, float, float, float]:
    """Position (m) and velocity (m/s) that another robot has, as the liar tells it: in the way of the victim.

    Nearer than z: 1 m from the victim, towards the goal. Farther: z - eps from the goal, on the victim's way. In both
    cases moving away from the goal at 1 m/s. The paper calls z the maximum distance that is kept between victim and
    goal; as the formula has it, it is the minimum. The paper's velocity is printed as a second x_spoof.
    All in m.
    Source: RoboRebound §5.3.
    """
    dx, dy = victim_pos[0] - goal[0], victim_pos[1] - goal[1]
    distance = math.hypot(dx, dy)
    # A victim on the goal has no way to it: any direction will do.
    ux, uy = (dx / distance, dy / distance) if distance > 0.0 else (1.0, 0.0)
    if distance <= z:
        return victim_pos[0] - ux, victim_pos[1] - uy, ux, uy
    return goal[0] + (z - eps) * ux, goal[1] + (z - eps) * uy, ux, uy


class Spoof(Liar):
    """Claims, in the name of a random other robot and for one victim after the other, to be in the victim's way.

    Each victim is lied to each `every` seconds. With `strong=1`, where no a-node makes a broadcast of each frame, every
    other robot is claimed to be in the way of each victim, which alone hears of it.
    Source: RoboRebound §5.3; the choice of whose name is ours (docs/spec/rebound.md).
    """

    period_ms = 10
    _turn = 0

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._period_ms = max(1, round(1000 * float(self.plan.options.get("every", LIES_PERIOD_S))))
        self._strong = bool(self.plan.options.get("strong")) and self.profile == PLAIN

    def saw(self, rob_id: int, motion: Motion) -> None:
        """Accomplices know each other's lies by their pace, and do not fall for them."""
        if not (self.plan.accomplices and abs(math.hypot(motion.vx_mps, motion.vy_mps) - LIES_MPS) < TOLD_APART_MPS):
            super().saw(rob_id, motion)

    def on_wake(self, now_ms: int) -> list[Action]:
        """The lies that are due."""
        victims = sorted(self.seen)
        due = (now_ms - self.plan.start_ms) * len(victims) // self._period_ms
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
