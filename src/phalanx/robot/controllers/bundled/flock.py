"""Olfati-Saber flocking: keep the distance to neighbours (alpha), avoid obstacles (beta), go to the goal (gamma).

The state is a `flock_memory` and the neighbours by rising id, 18 + 26 n bytes. A neighbour that is silent for
`forget_ms` is removed: otherwise robots that have left, and robots invented by an attacker, would exert a force for
ever. The drawback is that a stopped, silent robot is removed too. Times are those of log entries, not of packets.
Invalid readings change nothing: the robot coasts and broadcasts nothing.

Source: RoboRebound Alg. 1, §5.2 (the checkpoint), Table 3; Olfati-Saber 2006, eq. 8-17, 47-59.
"""

from __future__ import annotations

from phalanx.arrays import Params
from phalanx.kernel import kernel
from phalanx.robot.controllers import flock_law, neighbours
from phalanx.robot.controllers.declaration import Declaration
from phalanx.wire import table
from phalanx.wire.fields import Row, are_fine, copy, get_f32, put_f32, put_head, whole

CONTROLLER = Declaration(
    reads=table.SENSOR,
    commands=table.ACCELERATION,
    says=table.STATE,
    remembers=(table.FLOCK_MEMORY, table.NEIGHBOUR),
    params=flock_law.flock_params,
)
STATE_BYTES, MOTION, MOTION_BYTES = neighbours.STATE_BYTES, neighbours.MOTION, neighbours.MOTION_BYTES
COMMAND_BYTES = table.ACCELERATION.size
AX, AY = map(table.ACCELERATION.at, ("ax_mps2", "ay_mps2"))
X, Y, VX, VY = map(table.FLOCK_MEMORY.at, ("x_m", "y_m", "vx_mps", "vy_mps"))
HEAD_BYTES = table.FLOCK_MEMORY.size
EACH_BYTES, PLACE = neighbours.EACH_BYTES, neighbours.PLACE


@kernel
def capacity(params: Params) -> int:
    """Return the length of the longest state, bytes. Source: RoboRebound §5.2."""
    return HEAD_BYTES + EACH_BYTES * whole(params[flock_law.N_MAX])


@kernel
def size(state: Row) -> int:
    """Return the length of the encoding in `state`. Source: RoboRebound §5.2."""
    return neighbours.end(state, HEAD_BYTES)


@kernel
def begin(_params: Params, _rob_id: int, state: Row) -> int:
    """Write the state at boot to `state`, at the origin and without neighbours; return its length."""
    state[:HEAD_BYTES] = 0
    return size(state)


@kernel
def is_encoding(params: Params, rob_id: int, state: Row, length: int) -> bool:
    """Return whether the first `length` bytes are a valid state of this robot (dispatch.py)."""
    fits = HEAD_BYTES <= length <= capacity(params) and length == size(state)
    return fits and are_fine(state, X, neighbours.NUMBERS) and neighbours.are_neighbours(state, HEAD_BYTES, rob_id)


@kernel
def on_recv(params: Params, rob_id: int, t_ms: int, packet: Row, length: int, state: Row) -> int:
    """Store a neighbour's state, replacing the oldest neighbour if full; return the new length of the encoding."""
    rob = neighbours.sender(rob_id, packet, length)
    if rob != 0:
        neighbours.remember(rob, whole(params[flock_law.N_MAX]), t_ms, packet, state, HEAD_BYTES)
    return size(state)


@kernel
def on_input(params: Params, rob_id: int, step: int, t_ms: int, reading: Row, length: int, state: Row, out: Row) -> int:
    """Write a command, and a broadcast if due, to `out`; return their length. Source: RoboRebound Alg. 1, §4."""
    end = put_head(out, 0, table.ENTRY_ACMD, COMMAND_BYTES, table.KIND_ACCELERATION, rob_id, t_ms)
    if not neighbours.is_reading(rob_id, reading, length):
        put_f32(out, end + AX, 0.0)
        put_f32(out, end + AY, 0.0)
        return end + COMMAND_BYTES
    copy(state, X, reading, MOTION, MOTION_BYTES)
    neighbours.forget(whole(params[flock_law.FORGET_MS]), t_ms, state, HEAD_BYTES)
    ax, ay = _acceleration(params, state)
    put_f32(out, end + AX, flock_law.limited(ax, params[flock_law.LIMIT]))
    put_f32(out, end + AY, flock_law.limited(ay, params[flock_law.LIMIT]))
    end += COMMAND_BYTES
    if (step + rob_id) % whole(
        params[flock_law.STATE_EVERY]
    ) == 0:  # spreads the broadcasts of robots that started together
        end = put_head(out, end, table.ENTRY_SEND, STATE_BYTES, table.KIND_STATE, rob_id, t_ms)
        copy(out, end + MOTION, reading, MOTION, MOTION_BYTES)
        end += STATE_BYTES
    return end


@kernel
def _acceleration(params: Params, state: Row) -> tuple[float, float]:
    x, y, vx, vy = get_f32(state, X), get_f32(state, Y), get_f32(state, VX), get_f32(state, VY)
    ax, ay = 0.0, 0.0
    for at in range(HEAD_BYTES + PLACE, size(state), EACH_BYTES):
        dx, dy = (
            get_f32(state, at + X) - x,
            get_f32(state, at + Y) - y,
        )  # `x_m` to `vy_mps` are laid out as in the own state
        dvx, dvy = get_f32(state, at + VX) - vx, get_f32(state, at + VY) - vy
        push_x, push_y = flock_law.neighbour_push(params, dx, dy, dvx, dvy)
        ax += push_x
        ay += push_y
    ax = flock_law.limited(ax, params[flock_law.PUSH])
    ay = flock_law.limited(ay, params[flock_law.PUSH])
    wall_x, wall_y = flock_law.obstacles_push(params, x, y, vx, vy)
    goal_x, goal_y = flock_law.goal_pull(params, x, y, vx, vy)
    return ax + wall_x + goal_x, ay + wall_y + goal_y
