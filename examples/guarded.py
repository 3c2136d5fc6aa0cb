"""Planners that cannot be replayed, under a guard: a learned policy, an unreliable planner, and a malicious one.

python examples/guarded.py
"""

import random
from collections.abc import Sequence

import numpy as np

from phalanx.config import BtiConfig
from phalanx.config.guard import GuardConfig
from phalanx.robot import Planner
from phalanx.world import Scenario, simulate

Pair = tuple[float, float]
FIELD = ((-10.0, -10.0), (70.0, -10.0), (70.0, 70.0), (-10.0, 70.0))


class Learned(Planner):
    """Linear policy, fitted by least squares to a teacher's actions in random situations."""

    def __init__(self, rob_id: int, goal_m: Pair) -> None:
        """Draw situations and fit the policy; each robot gets another one."""
        super().__init__(rob_id, goal_m)
        chance = np.random.default_rng()
        seen = chance.normal(0, 20, (200, 4))  # offsets to the goal and to the nearest robot
        nearer = np.maximum(0.0, 1 - np.hypot(seen[:, 2], seen[:, 3]) / 20)[:, None]
        taught = 0.2 * seen[:, :2] - nearer * 0.2 * seen[:, 2:] + chance.normal(0, 0.1, (200, 2))
        self.weights, *_ = np.linalg.lstsq(np.tanh(seen / 10), taught, rcond=None)
        self.others = {}

    def hear(self, _t_s: float, rob_id: int, position_m: Pair, _velocity_mps: Pair) -> None:
        """Store the last position of each robot."""
        self.others[rob_id] = np.array(position_m)

    def advise(self, _t_s: float, position_m: Pair, _velocity_mps: Pair) -> Sequence[float] | None:
        """Return the policy's action."""
        gaps = [other - position_m for other in self.others.values()] or [np.array((99.0, 99.0))]
        nearest = min(gaps, key=np.linalg.norm)
        return np.tanh(np.concatenate([np.array(self.goal_m) - position_m, nearest]) / 10) @ self.weights


class Mumbling(Planner):
    """Unreliable planner, like a language model: mostly sensible, sometimes nonsense or nothing, never repeatable."""

    def advise(self, _t_s: float, position_m: Pair, _velocity_mps: Pair) -> Sequence[float] | None:
        """Return a velocity, something invalid, or nothing."""
        to_goal = [to - at for to, at in zip(self.goal_m, position_m, strict=True)]
        return random.choice([to_goal, to_goal, to_goal, (float("nan"), 1.0), (1e9, -1e9), None])  # noqa: S311


class Ramming(Planner):
    """Malicious planner: full speed towards the last robot heard."""

    prey: Pair | None = None

    def hear(self, _t_s: float, _rob_id: int, position_m: Pair, _velocity_mps: Pair) -> None:
        """Choose the sender as the target."""
        self.prey = position_m

    def advise(self, _t_s: float, position_m: Pair, _velocity_mps: Pair) -> Sequence[float] | None:
        """Return full speed towards the target."""
        return None if self.prey is None else [99 * (to - at) for to, at in zip(self.prey, position_m, strict=True)]


if __name__ == "__main__":
    swarm = Scenario(
        robots=9,
        grid_step_m=15.0,
        goal_m=(60.0, 60.0),
        duration_s=60.0,
        bti=BtiConfig(f_max=2),
        controller="guard",
        guard=GuardConfig(fences=(FIELD,)),
    )
    for planner in (None, Learned, Mumbling, Ramming):
        result = simulate(swarm, planner=planner, every_s=0.25)
        (told,) = result.summaries
        gaps = np.linalg.norm(result.positions_m[0, :, :, None] - result.positions_m[0, :, None], axis=3)
        nearest = gaps[gaps > 0].min()
        stopped = told["correct_in_safe_mode"] + told["without_quorum"]
        name = planner.__name__ if planner else "straight to the goal"
        print(f"{name}: {told['contacts']} contacts, never nearer than {nearest:.1f} m; stopped by mistake: {stopped}")
