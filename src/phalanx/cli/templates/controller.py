"""Template, a controller: phalanx sim run flock-12 --controller template.py

Check that it can be audited: phalanx sim check template.py
"""

from dataclasses import dataclass

from phalanx.robot import F32, U16, U64, Command, Controller, Reading, State

GOAL_M = (100.0, 60.0)
COLUMNS, SPACING_M = 4, 10.0
FORGET_MS = 5_000


@dataclass(frozen=True)
class Memory:
    """The last state received: sender, 0 for none; time of reception; position."""

    id: U16 = 0
    heard_ms: U64 = 0
    x_m: F32 = 0.0
    y_m: F32 = 0.0


class Template(Controller):
    """Fly in formation: each robot has its own place near the goal, and avoids the robot received last."""

    memory = Memory()

    def on_state(self, t_ms: int, state: State) -> None:
        """Handle the state of another robot. It may be false."""
        self.memory = Memory(state.id, t_ms, state.x_m, state.y_m)

    def on_reading(self, step: int, t_ms: int, reading: Reading) -> list[Command | State]:
        """Return a command, and in every sixth step a state for all robots in range.

        Auditors compare each byte. Use no clock but `t_ms`, no random numbers, no operations but + - * / and math.sqrt.
        """
        row, column = divmod(self.rob_id - 1, COLUMNS)
        ax = 0.02 * (GOAL_M[0] + SPACING_M * column - reading.x_m) - 0.3 * reading.vx_mps
        ay = 0.02 * (GOAL_M[1] + SPACING_M * row - reading.y_m) - 0.3 * reading.vy_mps
        dx, dy = reading.x_m - self.memory.x_m, reading.y_m - self.memory.y_m
        if self.memory.id and t_ms - self.memory.heard_ms < FORGET_MS:
            push = 1.0 / (1.0 + 0.1 * (dx * dx + dy * dy))
            ax, ay = ax + push * dx, ay + push * dy
        outputs: list[Command | State] = [Command(ax, ay)]
        if step % 6 == 0:
            outputs.append(State(reading.x_m, reading.y_m, reading.vx_mps, reading.vy_mps))
        return outputs
