"""Your own controller in plain Python, protected: robots audit each other and stop a compromised one.

docs/guides/own-controller.md explains it. python examples/own_controller.py
"""

from dataclasses import dataclass

from phalanx.config import BtiConfig
from phalanx.robot import F32, U16, Command, Controller, Reading, State
from phalanx.world import Scenario, simulate

GOAL_M = (120.0, 120.0)


@dataclass(frozen=True)
class Memory:
    """The controller's state: the last robot heard, id 0 for none."""

    id: U16 = 0
    x_m: F32 = 0.0
    y_m: F32 = 0.0


class GoThere(Controller):
    """Controller that drives to the goal and keeps clear of the last robot heard."""

    memory = Memory()

    def on_state(self, _t_ms: int, state: State) -> None:
        """Store another robot's position."""
        self.memory = Memory(state.id, state.x_m, state.y_m)

    def on_reading(self, step: int, _t_ms: int, at: Reading) -> list[Command | State]:
        """Accelerate towards the goal; every sixth time, broadcast the robot's state."""
        dx_m, dy_m = at.x_m - self.memory.x_m, at.y_m - self.memory.y_m
        push = 20.0 / (1.0 + dx_m * dx_m + dy_m * dy_m) if self.memory.id else 0.0
        command = Command(
            ax_mps2=0.01 * (GOAL_M[0] - at.x_m) - 0.2 * at.vx_mps + push * dx_m,
            ay_mps2=0.01 * (GOAL_M[1] - at.y_m) - 0.2 * at.vy_mps + push * dy_m,
        )
        state = State(at.x_m, at.y_m, at.vx_mps, at.vy_mps)
        return [command, state] if (step + self.rob_id) % 6 == 0 else [command]


if __name__ == "__main__":
    scenario = Scenario(robots=9, goal_m=GOAL_M, duration_s=30.0, bti=BtiConfig(f_max=2))
    (told,) = simulate(scenario, controller=GoThere, attacks="equivocate:robot=5,at=10").summaries
    print("robot 5 lied from {first_deviation_s} s on, Safe Mode at {safe_mode_s} s".format(**told["compromised"][0]))
    print(f"honest robots stopped: {told['correct_in_safe_mode']}, for want of a quorum: {told['without_quorum']}")
