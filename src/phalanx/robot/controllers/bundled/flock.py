"""Olfati-Saber flocking: neighbours at their distance (alpha), around obstacles (beta), to the goal (gamma).

Reads the sensor's record `sensor`, hears and broadcasts `state`, commands `acceleration`; its own state is a
`flock_memory` and its neighbours (phalanx.wire.table): 18 + 26 n bytes.

The state is the paper's checkpoint less the c-node's own part. Neighbours lie in it by rising id and are summed in that
order. One not heard for `forget_ms` is forgotten: who has driven out of range would otherwise push for ever from where
it was last seen, and a liar's inventions would outlive the liar. The price: a robot that is switched off and silent is
soon forgotten too, though it still stands there (the paper keeps the time it was heard, and does not say what for).
Times are those of the log's entries; what a frame says of its own time is not believed, and not used.

A reading that makes no sense (another's id, NaN, beyond 10^6) changes nothing: the robot is told to coast and says
nothing.

Source: RoboRebound Alg. 1, §5.2 (the checkpoint), Table 3; Olfati-Saber 2006, eq. 8-17, 47-59.
"""

from __future__ import annotations

from phalanx.kernel import kernel
from phalanx.robot.controllers import flock_law
from phalanx.robot.controllers.declaration import Declaration, Params
from phalanx.robot.controllers.outputs import put_head
from phalanx.wire import table
from phalanx.wire.fields import (
    F32_BYTES,
    Row,
    are_fine,
    copy,
    get_f32,
    get_u16,
    get_u64,
    put_f32,
    put_u16,
    put_u64,
    whole,
)

CONTROLLER = Declaration(
    reads=table.SENSOR,
    commands=table.ACCELERATION,
    says=table.STATE,
    remembers=(table.FLOCK_MEMORY, table.NEIGHBOUR),
    params=flock_law.flock_params,
)
STATE_BYTES = table.STATE.size
SENSOR_BYTES = table.SENSOR.size
COMMAND_BYTES = table.ACCELERATION.size
ID = table.STATE.at("id")  # as in the other two
MOTION = table.STATE.at("x_m")  # position and velocity, as in the reading and in what is remembered
AX, AY = map(table.ACCELERATION.at, ("ax_mps2", "ay_mps2"))
MOTION_BYTES = table.STATE.size - MOTION
NUMBERS = MOTION_BYTES // F32_BYTES

X, Y, VX, VY, COUNT = map(table.FLOCK_MEMORY.at, ("x_m", "y_m", "vx_mps", "vy_mps", "count"))
HEAD_BYTES = table.FLOCK_MEMORY.size
EACH_BYTES = table.NEIGHBOUR.size
HEARD, PLACE = map(table.NEIGHBOUR.at, ("heard", "x_m"))


@kernel
def capacity(params: Params) -> int:
    """The longest that a state gets, bytes: what its row must hold. Source: RoboRebound §5.2."""
    return HEAD_BYTES + EACH_BYTES * whole(params[flock_law.N_MAX])


@kernel
def size(state: Row) -> int:
    """The length of the encoding that `state` holds now. Source: RoboRebound §5.2."""
    return HEAD_BYTES + EACH_BYTES * get_u16(state, COUNT)


@kernel
def begin(_params: Params, _rob_id: int, state: Row) -> int:
    """The boot state is in `state`, at the origin and alone; its length."""
    state[:HEAD_BYTES] = 0
    return size(state)


@kernel
def is_encoding(params: Params, rob_id: int, state: Row, length: int) -> bool:
    """Whether the first `length` bytes are a state that this robot can be in; to be asked of every foreign checkpoint.

    The other kernels believe their state: a count too high would have them read and write past its row.
    """
    if length < HEAD_BYTES or length != size(state) or length > capacity(params) or not are_fine(state, X, NUMBERS):
        return False
    last = whole(0)
    for at in range(HEAD_BYTES, length, EACH_BYTES):
        rob = get_u16(state, at)
        if rob <= last or rob == rob_id or get_u64(state, at + HEARD) < 0 or not are_fine(state, at + PLACE, NUMBERS):
            return False
        last = rob
    return True


@kernel
def on_recv(params: Params, rob_id: int, t_ms: int, frame: Row, length: int, state: Row) -> int:
    """What the sender of a broadcast says is remembered, anything else ignored; the new length of the encoding.

    Who is new when N_max are known takes the place of the one heard longest ago, of these of the lowest id.
    Source: docs/spec/rebound.md (which to forget).
    """
    if length != STATE_BYTES or frame[0] != table.KIND_STATE or not are_fine(frame, MOTION, NUMBERS):
        return size(state)
    rob = get_u16(frame, ID)
    if rob in (0, rob_id):
        return size(state)
    at = _place_of(rob, state)
    if at == size(state) or get_u16(state, at) != rob:
        if get_u16(state, COUNT) == whole(params[flock_law.N_MAX]):
            _remove(_oldest(state), state)
            at = _place_of(rob, state)
        _make_room(at, state)
    put_u16(state, at, rob)
    put_u64(state, at + HEARD, t_ms)
    copy(state, at + PLACE, frame, MOTION, MOTION_BYTES)
    return size(state)


@kernel
def on_input(params: Params, rob_id: int, step: int, t_ms: int, reading: Row, length: int, state: Row, out: Row) -> int:
    """A command, and when it is due a broadcast, are in `out`; their length together.

    Due when (step + rob_id) mod 6 = 0, so that a fleet started at once does not speak at once.
    Source: RoboRebound Alg. 1, §4.
    """
    end = put_head(out, 0, table.ENTRY_ACMD, COMMAND_BYTES, table.KIND_ACCELERATION, rob_id, t_ms)
    known = length == SENSOR_BYTES and reading[0] == table.KIND_SENSOR and get_u16(reading, ID) == rob_id
    if not known or not are_fine(reading, MOTION, NUMBERS):
        put_f32(out, end + AX, 0.0)
        put_f32(out, end + AY, 0.0)
        return end + COMMAND_BYTES
    copy(state, X, reading, MOTION, MOTION_BYTES)
    _forget(whole(params[flock_law.FORGET_MS]), t_ms, state)
    ax, ay = _acceleration(params, state)
    put_f32(out, end + AX, flock_law.limited(ax, params[flock_law.LIMIT]))
    put_f32(out, end + AY, flock_law.limited(ay, params[flock_law.LIMIT]))
    end += COMMAND_BYTES
    if (step + rob_id) % whole(params[flock_law.STATE_EVERY]) == 0:
        end = put_head(out, end, table.ENTRY_SEND, STATE_BYTES, table.KIND_STATE, rob_id, t_ms)
        copy(out, end + MOTION, reading, MOTION, MOTION_BYTES)
        end += STATE_BYTES
    return end


@kernel
def _acceleration(params: Params, state: Row) -> tuple[float, float]:
    x, y, vx, vy = get_f32(state, X), get_f32(state, Y), get_f32(state, VX), get_f32(state, VY)
    ax, ay = 0.0, 0.0
    for at in range(HEAD_BYTES + PLACE, size(state), EACH_BYTES):
        push_x, push_y = flock_law.neighbour_push(
            params,
            get_f32(state, at + X) - x,  # a neighbour's motion lies as one's own
            get_f32(state, at + Y) - y,
            get_f32(state, at + VX) - vx,
            get_f32(state, at + VY) - vy,
        )
        ax += push_x
        ay += push_y
    ax = flock_law.limited(ax, params[flock_law.PUSH])
    ay = flock_law.limited(ay, params[flock_law.PUSH])
    wall_x, wall_y = flock_law.obstacles_push(params, x, y, vx, vy)
    goal_x, goal_y = flock_law.goal_pull(params, x, y, vx, vy)
    return ax + wall_x + goal_x, ay + wall_y + goal_y


@kernel
def _place_of(rob: int, state: Row) -> int:
    """Where `rob` is among the neighbours, or would be."""
    low, high = whole(0), get_u16(state, COUNT)
    while low < high:
        middle = (low + high) >> 1
        if get_u16(state, HEAD_BYTES + EACH_BYTES * middle) < rob:
            low = middle + 1
        else:
            high = middle
    return HEAD_BYTES + EACH_BYTES * low


@kernel
def _oldest(state: Row) -> int:
    """Where the neighbour is that was heard longest ago; of several, the lowest id."""
    found = HEAD_BYTES
    for at in range(HEAD_BYTES, size(state), EACH_BYTES):
        if get_u64(state, at + HEARD) < get_u64(state, found + HEARD):
            found = at
    return found


@kernel
def _remove(at: int, state: Row) -> None:
    copy(state, at, state, at + EACH_BYTES, size(state) - EACH_BYTES - at)
    put_u16(state, COUNT, get_u16(state, COUNT) - 1)


@kernel
def _make_room(at: int, state: Row) -> None:
    copy(state, at + EACH_BYTES, state, at, size(state) - at)
    put_u16(state, COUNT, get_u16(state, COUNT) + 1)


@kernel
def _forget(forget_ms: int, t_ms: int, state: Row) -> None:
    """Neighbours heard more than `forget_ms` before `t_ms` are gone; the rest keep their order."""
    end = size(state)
    kept = HEAD_BYTES
    for at in range(HEAD_BYTES, end, EACH_BYTES):
        if t_ms - get_u64(state, at + HEARD) <= forget_ms:
            if kept != at:
                copy(state, kept, state, at, EACH_BYTES)
            kept += EACH_BYTES
    put_u16(state, COUNT, (kept - HEAD_BYTES) // EACH_BYTES)
