"""Your own compiled flocking controller: robots keep their spacing, match velocities, and go to the goal.

It is written in the compiled subset of Python, as the bundled controllers are (docs/guides/own-controller.md,
"Compile it"). python examples/own_kernels.py
"""

import math

from phalanx.config import BtiConfig
from phalanx.config.flock import FlockConfig
from phalanx.robot.kernels import (
    Declaration,
    Params,
    Row,
    are_fine,
    copy,
    get_f32,
    get_u16,
    get_u64,
    kernel,
    limited,
    put_f32,
    put_head,
    put_u16,
    put_u64,
    table,
)
from phalanx.world import Scenario, simulate

# A neighbour is stored at its id modulo 16: id, time, position and velocity.
PLACES, EACH = 16, table.NEIGHBOUR.size
HEARD, MOTION = table.NEIGHBOUR.at("heard"), table.NEIGHBOUR.at("x_m")
ID, SAID = table.STATE.at("id"), table.STATE.at("x_m")  # a reading has the same layout as a state
AX, AY = map(table.ACCELERATION.at, ("ax_mps2", "ay_mps2"))
NUMBERS, FLOAT = 4, 4  # x, y, vx, vy
FORGET_MS, LIMIT_MPS2 = 5000, 4.0
GOAL_X, GOAL_Y, SPACING = 0, 1, 2


def params(config: FlockConfig) -> list[float]:
    """Return the kernels' parameters from the scenario."""
    return [*config.goal_m, config.d_m]


CONTROLLER = Declaration(
    reads=table.SENSOR,
    commands=table.ACCELERATION,
    says=table.STATE,
    remembers=(table.NEIGHBOUR,),
    params=params,
)


@kernel
def capacity(_params: Params) -> int:
    """Return the length of the longest state, bytes."""
    return PLACES * EACH


@kernel
def size(_state: Row) -> int:
    """Return the length of this state, bytes: always the same."""
    return PLACES * EACH


@kernel
def begin(_params: Params, _rob_id: int, state: Row) -> int:
    """Write the boot state: no neighbours."""
    state[: PLACES * EACH] = 0
    return PLACES * EACH


@kernel
def is_encoding(_params: Params, _rob_id: int, state: Row, length: int) -> bool:
    """Return whether a checkpoint is a valid state: the other kernels rely on it."""
    if length != PLACES * EACH:
        return False
    for at in range(0, length, EACH):
        if get_u64(state, at + HEARD) < 0 or not are_fine(state, at + MOTION, NUMBERS):
            return False
    return True


@kernel
def on_recv(_params: Params, rob_id: int, t_ms: int, packet: Row, length: int, state: Row) -> int:
    """Process a packet: store its sender if it is a state of finite numbers."""
    if length == table.STATE.size and packet[0] == table.KIND_STATE and are_fine(packet, SAID, NUMBERS):
        rob = get_u16(packet, ID)
        if rob not in (0, rob_id):
            at = EACH * (rob % PLACES)
            put_u16(state, at, rob)
            put_u64(state, at + HEARD, t_ms)
            copy(state, at + MOTION, packet, SAID, NUMBERS * FLOAT)
    return PLACES * EACH


@kernel
def on_input(
    params: Params, rob_id: int, step: int, t_ms: int, reading: Row, _length: int, state: Row, out: Row
) -> int:
    """Process a sensor reading: write a command, and every sixth time a broadcast."""
    is_fine = are_fine(reading, SAID, NUMBERS)  # broken sensors say NaN
    ax, ay = 0.0, 0.0
    if is_fine:
        ax, ay = acceleration(params, t_ms, reading, state)
    begin = put_head(out, 0, table.ENTRY_ACMD, table.ACCELERATION.size, table.KIND_ACCELERATION, rob_id, t_ms)
    put_f32(out, begin + AX, limited(ax, LIMIT_MPS2))
    put_f32(out, begin + AY, limited(ay, LIMIT_MPS2))
    end = begin + table.ACCELERATION.size
    if is_fine and (step + rob_id) % 6 == 0:
        begin = put_head(out, end, table.ENTRY_SEND, table.STATE.size, table.KIND_STATE, rob_id, t_ms)
        copy(out, begin + SAID, reading, SAID, NUMBERS * FLOAT)
        end = begin + table.STATE.size
    return end


@kernel
def acceleration(params: Params, t_ms: int, reading: Row, state: Row) -> tuple[float, float]:
    """Return the acceleration: a spring and a damper to each near neighbour, and a bounded pull to the goal."""
    x, y = get_f32(reading, SAID), get_f32(reading, SAID + FLOAT)
    vx, vy = get_f32(reading, SAID + 2 * FLOAT), get_f32(reading, SAID + 3 * FLOAT)
    ax, ay = 0.0, 0.0
    for at in range(0, PLACES * EACH, EACH):
        dx, dy = get_f32(state, at + MOTION) - x, get_f32(state, at + MOTION + FLOAT) - y
        gap = math.sqrt(dx * dx + dy * dy)
        known = get_u16(state, at) != 0 and t_ms - get_u64(state, at + HEARD) <= FORGET_MS
        if known and 0.0 < gap < 1.3 * params[SPACING]:
            spring = 1.0 - params[SPACING] / max(gap, 0.2 * params[SPACING])
            ax += 0.3 * spring * dx + 0.2 * (get_f32(state, at + MOTION + 2 * FLOAT) - vx)
            ay += 0.3 * spring * dy + 0.2 * (get_f32(state, at + MOTION + 3 * FLOAT) - vy)
    # Both parts are limited, however far the goal is and whatever compromised robots claim.
    ax = limited(ax, 3.0) + limited(0.02 * (params[GOAL_X] - x), 1.0) - 0.4 * vx
    ay = limited(ay, 3.0) + limited(0.02 * (params[GOAL_Y] - y), 1.0) - 0.4 * vy
    return ax, ay


if __name__ == "__main__":
    scenario = Scenario(robots=25, goal_m=(120.0, 120.0), duration_s=60.0, bti=BtiConfig(f_max=2))
    (told,) = simulate(scenario, controller=__file__, attacks="equivocate:robot=5,at=10").summaries
    print("robot 5 lied from {first_deviation_s} s on, Safe Mode at {safe_mode_s} s".format(**told["compromised"][0]))
    print(f"honest robots stopped: {told['correct_in_safe_mode']}, for want of a quorum: {told['without_quorum']}")
    print(f"{told['real_time_factor']:.0f} times real time, {told['mean_distance_to_goal_m']:.0f} m from the goal")
