"""Your own controller in plain Python, protected: its robots audit each other, and stop the one that lies.

What it may do: phalanx/robot/controllers/python_controller.py. python examples/own_controller.py
"""

import struct

from phalanx.config import BtiConfig
from phalanx.robot import Act, Controller, Send
from phalanx.sim import Scenario, simulate

STATE = struct.Struct("<BHQffff")  # kind, id, time ms, place m, velocity m/s: what robots read, and what they broadcast
COMMAND = struct.Struct("<BHQff")  # kind, id, time ms, acceleration m/s²
GOAL_M = (120.0, 120.0)


class GoThere(Controller):
    """Goes to the goal, and keeps clear of the robot that it heard last: that is all it remembers."""

    neighbour = (0, 0.0, 0.0)

    def encode(self) -> bytes:
        """The checkpoint."""
        return struct.pack("<Hff", *self.neighbour)

    def decode(self, encoding: bytes) -> None:
        """Back to a checkpoint."""
        self.neighbour = struct.unpack("<Hff", encoding)

    def on_recv(self, _t_ms: int, frame: bytes) -> None:
        """Another robot said something."""
        if len(frame) == STATE.size and frame[0] == 0x01:
            _, rob_id, _, x_m, y_m, _, _ = STATE.unpack(frame)
            if abs(x_m) < 1e6 and abs(y_m) < 1e6:  # liars send NaN, too
                self.neighbour = (rob_id, x_m, y_m)

    def on_input(self, step: int, t_ms: int, reading: bytes) -> list[Act | Send]:
        """The robot's own sensors said something: what it does, and says."""
        _, _, _, x_m, y_m, vx_mps, vy_mps = STATE.unpack(reading)
        if not all(abs(number) < 1e6 for number in (x_m, y_m, vx_mps, vy_mps)):  # so do broken sensors: go on as you do
            return []
        rob_id, dx_m, dy_m = self.neighbour[0], x_m - self.neighbour[1], y_m - self.neighbour[2]
        push = 20.0 / (1.0 + dx_m * dx_m + dy_m * dy_m) if rob_id else 0.0
        ax_mps2 = 0.01 * (GOAL_M[0] - x_m) - 0.2 * vx_mps + push * dx_m
        ay_mps2 = 0.01 * (GOAL_M[1] - y_m) - 0.2 * vy_mps + push * dy_m
        act = Act(COMMAND.pack(0x03, self.rob_id, t_ms, ax_mps2, ay_mps2))
        say = Send(STATE.pack(0x01, self.rob_id, t_ms, x_m, y_m, vx_mps, vy_mps))
        return [act, say] if (step + self.rob_id) % 6 == 0 else [act]


if __name__ == "__main__":
    scenario = Scenario(robots=9, goal_m=GOAL_M, duration_s=30.0, bti=BtiConfig(f_max=2))
    (told,) = simulate(scenario, controller=GoThere, attacks="equivocate:robot=5,at=10").summaries
    print("robot 5 lied from {first_deviation_s} s on, Safe Mode at {safe_mode_s} s".format(**told["compromised"][0]))
    print(f"honest robots stopped: {told['correct_in_safe_mode']}, for want of a quorum: {told['without_quorum']}")
