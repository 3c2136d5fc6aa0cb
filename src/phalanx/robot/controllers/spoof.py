"""The lie of the example attack: what a compromised robot claims of others, to keep a victim from the goal."""

from __future__ import annotations

import math


def spoofed_state(
    victim_pos: tuple[float, float], goal: tuple[float, float], z: float = 150.0, eps: float = 2.0
) -> tuple[float, float, float, float]:
    """Position (m) and velocity (m/s) that another robot has, as the liar tells it: in the way of the victim.

    Nearer than z: 1 m from the victim, towards the goal. Farther: z - eps from the goal, on the victim's way. In both
    cases moving away from the goal at 1 m/s. The paper calls z the maximum distance that is kept between victim and
    goal; as the formula has it, it is the minimum. The paper's velocity is printed as a second x_spoof.

    Args:
        victim_pos: where the victim is, m.
        goal: where it wants to go, m.
        z: m.
        eps: m.
    Source: RoboRebound §5.3.
    """
    dx, dy = victim_pos[0] - goal[0], victim_pos[1] - goal[1]
    distance = math.hypot(dx, dy)
    # A victim on the goal has no way to it: any direction will do.
    ux, uy = (dx / distance, dy / distance) if distance > 0.0 else (1.0, 0.0)
    if distance <= z:
        return victim_pos[0] - ux, victim_pos[1] - uy, ux, uy
    return goal[0] + (z - eps) * ux, goal[1] + (z - eps) * uy, ux, uy
