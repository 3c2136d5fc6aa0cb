"""The guard: a controller that follows a planner's advice as far as the mission's envelope allows.

Advice is a `wish`, a velocity. The velocity in the guard's broadcasts is a promise (promises.py). The state is a
`guard_memory` and the neighbours: 127 + 26 n bytes. The log has the advice, and auditors replay the guard with it, so
commands stay inside the envelope whatever a planner advises. The guard tries the wish, then smaller shares of it, and
brakes if none is safe.

The robot stands still if advice is missing, too old, not finite, or not signed by the mission's adviser. It also stands
for the first `forget_ms`, to discover its neighbours. The same holds for `forget_ms` after it has received states of
more robots than it can store, or a position that the sender cannot have reached: then the sender is forged. Invalid
readings change nothing: the robot coasts and broadcasts nothing.

Source: docs/guides/guard.md (the law and its safety argument); RoboRebound Alg. 1 (the structure).
"""

from __future__ import annotations

import math

from phalanx.arrays import Params
from phalanx.bti import trusted
from phalanx.config.guard import GuardConfig
from phalanx.kernel import kernel
from phalanx.robot.controllers import guard_law, neighbours, promises
from phalanx.robot.controllers.declaration import Declaration
from phalanx.wire import driven, guarded, table
from phalanx.wire.fields import (
    F32_BYTES,
    Row,
    are_fine,
    are_finite,
    copy,
    get_f32,
    get_u16,
    get_u32,
    get_u64,
    put_f32,
    put_head,
    put_u64,
    whole,
)

CONTROLLER = Declaration(
    reads=table.SENSOR,
    commands=table.ACCELERATION,
    says=table.STATE,
    remembers=(guarded.GUARD_MEMORY, table.NEIGHBOUR),
    advised=guarded.WISH,
    config=GuardConfig,
    params=guard_law.guard_params,
)
STATE_BYTES, MOTION = neighbours.STATE_BYTES, neighbours.MOTION
COMMAND_BYTES = table.ACCELERATION.size
WISH_BYTES = guarded.WISH.size
SENSED_X, SENSED_Y, SENSED_VX, SENSED_VY = map(table.SENSOR.at, ("x_m", "y_m", "vx_mps", "vy_mps"))
AX, AY = map(table.ACCELERATION.at, ("ax_mps2", "ay_mps2"))
WISH_X = guarded.WISH.at("vx_mps")
SIGNED_MISSION, SIGNED_ID, SIGNED_T, SIGNED_X = map(guarded.SIGNED_WISH.at, ("mission", "id", "t", "vx_mps"))
VELOCITY_X, VELOCITY_Y = map(table.STATE.at, ("vx_mps", "vy_mps"))  # in a broadcast: the promised velocity
PLACE_BYTES = VELOCITY_X - MOTION
OLD_X, OLD_Y, WISHED_X, WISHED_Y = map(guarded.GUARD_MEMORY.at, ("ax_mps2", "ay_mps2", "vx_mps", "vy_mps"))
FRESH, WISHED, STANDS = map(guarded.GUARD_MEMORY.at, ("fresh", "wished", "stands"))
HEAD_BYTES = guarded.GUARD_MEMORY.size
EACH_BYTES, HEARD = neighbours.EACH_BYTES, neighbours.HEARD
PLACE_X, PLACE_Y, SAID_X, SAID_Y = map(table.NEIGHBOUR.at, ("x_m", "y_m", "vx_mps", "vy_mps"))
REMEMBERED = (FRESH - OLD_X) // F32_BYTES  # numbers, from OLD_X on
WISH_NUMBERS = (WISH_BYTES - WISH_X) // F32_BYTES
# Tolerance of a claimed position for rounding to f32 at 10^6 m.
ROUNDED_M = 0.13


@kernel
def capacity(params: Params) -> int:
    """Return the length of a state's row: the longest state, then room for an adviser's key if there is one."""
    return _longest(params) + (driven.SIGNER_KEY_BYTES if guard_law.adviser_at(params) > 0 else 0)


@kernel
def _longest(params: Params) -> int:
    return HEAD_BYTES + EACH_BYTES * whole(params[guard_law.N_MAX])


@kernel
def size(state: Row) -> int:
    """Return the length of the encoding in `state`."""
    return neighbours.end(state, HEAD_BYTES)


@kernel
def begin(params: Params, _rob_id: int, state: Row) -> int:
    """Write the state at boot to `state`, with the envelope's hash and no neighbours; return its length."""
    state[:HEAD_BYTES] = 0
    for k in range(guarded.ENVELOPE_BYTES):
        state[k] = whole(params[guard_law.HASH + k])
    return size(state)


@kernel
def is_encoding(params: Params, rob_id: int, state: Row, length: int) -> bool:
    """Return whether the first `length` bytes are a valid state of this robot (dispatch.py)."""
    if length < HEAD_BYTES or length != size(state) or length > _longest(params):
        return False
    if not are_fine(state, OLD_X, REMEMBERED) or state[FRESH] > guarded.IS_FRESH:
        return False
    if get_u64(state, WISHED) < 0 or get_u64(state, STANDS) < 0:
        return False
    for at in range(promises.MADE_AT, promises.END, promises.EACH_BYTES):
        if get_u64(state, at + promises.UNTIL) < 0 or not are_fine(state, at + promises.PROMISED_X, promises.NUMBERS):
            return False
    for k in range(guarded.ENVELOPE_BYTES):
        if state[k] != whole(params[guard_law.HASH + k]):
            return False
    return neighbours.are_neighbours(state, HEAD_BYTES, rob_id)


@kernel
def on_advice(params: Params, rob_id: int, advice: Row, length: int, state: Row) -> int:
    """Store a wish and ignore anything else; return the new length of the encoding.

    A signed wish must be newer than the last, and the first since the last reading, which limits the signatures that
    auditors must verify.
    """
    at, adviser = WISH_X, guard_law.adviser_at(params)
    if adviser > 0:
        at = SIGNED_X
        if length != guarded.SIGNED_BYTES or not _is_signed(params, adviser, rob_id, advice, length, state):
            return size(state)
    elif length != WISH_BYTES or advice[0] != guarded.KIND_WISH:
        return size(state)
    if not are_finite(advice, at, WISH_NUMBERS):
        return size(state)
    x, y = guard_law.shortened(get_f32(advice, at), get_f32(advice, at + F32_BYTES), params[guard_law.WISHED])
    put_f32(state, WISHED_X, x)
    put_f32(state, WISHED_Y, y)
    if adviser > 0:
        put_u64(state, WISHED, get_u64(advice, SIGNED_T))
    else:
        state[FRESH] = guarded.IS_FRESH
    return size(state)


@kernel
def _is_signed(params: Params, adviser: int, rob_id: int, advice: Row, length: int, state: Row) -> bool:
    """Return whether advice is signed, new, for this robot and mission, and the first since the last reading."""
    if advice[0] != guarded.KIND_SIGNED_WISH or state[FRESH] == guarded.IS_FRESH:
        return False
    if get_u32(advice, SIGNED_MISSION) != whole(params[adviser]) or get_u16(advice, SIGNED_ID) != rob_id:
        return False
    if get_u64(advice, SIGNED_T) <= get_u64(state, WISHED):
        return False
    state[FRESH] = guarded.IS_FRESH
    key = _longest(params)  # the part of the row behind any state
    for k in range(driven.SIGNER_KEY_BYTES):
        state[key + k] = whole(params[adviser + 1 + k])
    return trusted.order_check(state[key : key + driven.SIGNER_KEY_BYTES], advice, length) == 0


@kernel
def on_recv(params: Params, rob_id: int, t_ms: int, packet: Row, length: int, state: Row) -> int:
    """Store a neighbour's state and ignore anything else; return the new length of the encoding."""
    rob = neighbours.sender(rob_id, packet, length)
    if rob == 0:
        return size(state)
    forget_ms, n_max = whole(params[guard_law.FORGET_MS]), whole(params[guard_law.N_MAX])
    at = neighbours.place_of(rob, state, HEAD_BYTES)
    stands = False
    if neighbours.is_at(rob, at, state, HEAD_BYTES):
        stands = not _can_be(params, t_ms, packet, at, state)
    elif neighbours.count(state, HEAD_BYTES) == n_max:
        stands = t_ms - get_u64(state, neighbours.oldest(state, HEAD_BYTES) + HEARD) <= forget_ms
    if stands:
        put_u64(state, STANDS, t_ms + forget_ms)
    neighbours.remember(rob, n_max, t_ms, packet, state, HEAD_BYTES)
    return size(state)


@kernel
def _can_be(params: Params, t_ms: int, packet: Row, at: int, state: Row) -> bool:
    """Return whether a robot can have moved from its last position to that in the packet."""
    dx = get_f32(packet, SENSED_X) - get_f32(state, at + PLACE_X)  # same offset in `state` and `sensor`
    dy = get_f32(packet, SENSED_Y) - get_f32(state, at + PLACE_Y)
    since_s = (t_ms - get_u64(state, at + HEARD) + params[guard_law.RADIO_MS]) * 1e-3
    most = params[guard_law.SPEED] * since_s + ROUNDED_M
    return bool(dx * dx + dy * dy <= most * most)


@kernel
def on_input(params: Params, rob_id: int, step: int, t_ms: int, reading: Row, length: int, state: Row, out: Row) -> int:
    """Write a command, and a broadcast if due, to `out`; return their length. Source: docs/guides/guard.md."""
    end = put_head(out, 0, table.ENTRY_ACMD, COMMAND_BYTES, table.KIND_ACCELERATION, rob_id, t_ms)
    forget_ms = whole(params[guard_law.FORGET_MS])
    if step == 0:
        put_u64(state, STANDS, t_ms + forget_ms)
    if state[FRESH] == guarded.IS_FRESH:
        state[FRESH] = 0
        if guard_law.adviser_at(params) == 0:
            put_u64(state, WISHED, t_ms)
    ax, ay, said = 0.0, 0.0, whole(0)
    if neighbours.is_reading(rob_id, reading, length):
        neighbours.forget(forget_ms, t_ms, state, HEAD_BYTES)
        now = _now(reading, state)
        if (step + rob_id) % whole(params[guard_law.STATE_EVERY]) == 0:
            at = put_head(out, end + COMMAND_BYTES, table.ENTRY_SEND, STATE_BYTES, table.KIND_STATE, rob_id, t_ms)
            copy(out, at + MOTION, reading, MOTION, PLACE_BYTES)
            _put_velocity(out, at, *_promised(params, t_ms, now, state))
            # As others will read it, after rounding to f32.
            said_x, said_y = get_f32(out, at + VELOCITY_X), get_f32(out, at + VELOCITY_Y)
            _put_velocity(out, at, *promises.make(params, t_ms, state, said_x, said_y))
            said = at + STATE_BYTES
        ax, ay = _command(params, t_ms, now, state)
    put_f32(out, end + AX, ax)
    put_f32(out, end + AY, ay)
    put_f32(state, OLD_X, ax)
    put_f32(state, OLD_Y, ay)
    return max(end + COMMAND_BYTES, said)


@kernel
def _put_velocity(out: Row, at: int, x: float, y: float) -> None:
    put_f32(out, at + VELOCITY_X, x)
    put_f32(out, at + VELOCITY_Y, y)


@kernel
def _wished(params: Params, t_ms: int, state: Row) -> tuple[float, float]:
    """Return the current wish; (0, 0) if there is none or it is too old."""
    wished = get_u64(state, WISHED)
    if wished == 0 or not 0 <= t_ms - wished <= whole(params[guard_law.ADVICE_MS]):
        return 0.0, 0.0
    return get_f32(state, WISHED_X), get_f32(state, WISHED_Y)


@kernel
def _now(reading: Row, state: Row) -> guard_law.Motion:
    x, y = get_f32(reading, SENSED_X), get_f32(reading, SENSED_Y)
    vx, vy = get_f32(reading, SENSED_VX), get_f32(reading, SENSED_VY)
    return x, y, vx, vy, get_f32(state, OLD_X), get_f32(state, OLD_Y)


@kernel
def _command(params: Params, t_ms: int, now: guard_law.Motion, state: Row) -> tuple[float, float]:
    vx, vy = now[2], now[3]
    wish_x, wish_y = _wished(params, t_ms, state)
    if (wish_x != 0.0 or wish_y != 0.0) and t_ms >= get_u64(state, STANDS):
        wish_x, wish_y = guard_law.shortened(wish_x, wish_y, promises.slowest_mps(params, t_ms, state))
        for share in guard_law.SHARES:
            ax, ay = guard_law.towards(params, vx, vy, share * wish_x, share * wish_y)
            ax, ay = guard_law.straightened(params, vx, vy, ax, ay)
            if _is_good(params, t_ms, now, state, ax, ay):
                return ax, ay
    return guard_law.towards(params, vx, vy, 0.0, 0.0)


@kernel
def _is_good(params: Params, t_ms: int, now: guard_law.Motion, state: Row, ax: float, ay: float) -> bool:
    """Return whether a command keeps the robot's promises, and lets it brake before all obstacles and neighbours."""
    x, y, vx, vy = now[0], now[1], now[2], now[3]
    period = params[guard_law.PERIOD_S]
    then = (vx + period * ax, vy + period * ay)
    off, rests = guard_law.off_mps(params, now, ax, ay), guard_law.late_mps(params, ax, ay)
    if not promises.keeps_promises(params, t_ms, state, then, off, rests):
        return False
    if not guard_law.clear_of_walls(params, now, ax, ay):
        return False
    next_x, next_y, last_x, last_y, spread, bulge, stands_s = guard_law.planned_path(params, now, ax, ay)
    for at in range(HEAD_BYTES, size(state), EACH_BYTES):
        there_x, there_y, near = _reach(params, t_ms, state, at, params[guard_law.HELD_S])
        near += bulge
        if guard_law.squared_distance_to_segment(there_x, there_y, x, y, next_x, next_y) < near * near:
            return False
        there_x, there_y, far = _reach(params, t_ms, state, at, stands_s)
        far += spread
        if guard_law.squared_distance_to_segment(there_x, there_y, next_x, next_y, last_x, last_y) < far * far:
            return False
    return True


@kernel
def _promised(params: Params, t_ms: int, now: guard_law.Motion, state: Row) -> tuple[float, float]:
    """Return the velocity to promise: the share of the wish that is fair to all neighbours, if it covers the motion.

    Otherwise it is a promise that covers braking, or else the envelope's speed.
    """
    speed = params[guard_law.SPEED]
    gx, gy = guard_law.shortened(*_wished(params, t_ms, state), promises.MEANT * speed)
    share, alone = 1.0, True
    for at in range(HEAD_BYTES, size(state), EACH_BYTES):
        there_x, there_y, _ = _reach(params, t_ms, state, at, 0.0)
        gap_x, gap_y = there_x - now[0], there_y - now[1]
        fair = promises.fair_mps(params, gap_x, gap_y)
        closing = promises.closing_mps(params, gx, gy, gap_x, gap_y)
        alone = alone and fair >= speed
        if closing > fair:
            share = min(share, fair / closing)
    if alone:
        return speed, 0.0
    g, v = (share * gx, share * gy), (now[2], now[3])
    late = guard_law.late_mps(
        params, now[4], now[5]
    )  # braking changes only the length of the velocity, except for this
    for _ in range(2):
        if promises.holds(params, g, v, late, late):
            return g
        fast = math.sqrt(v[0] * v[0] + v[1] * v[1])
        longer = promises.MEANT * (fast + late) / max(fast, guard_law.STILL_MPS)
        g = (longer * v[0], longer * v[1])
    return speed, 0.0


@kernel
def _reach(params: Params, t_ms: int, state: Row, at: int, later_s: float) -> tuple[float, float, float]:
    """Return the disc that the neighbour at `at` can reach in `later_s`: centre and radius."""
    place = (get_f32(state, at + PLACE_X), get_f32(state, at + PLACE_Y))
    said = (get_f32(state, at + SAID_X), get_f32(state, at + SAID_Y))
    known_s = (t_ms - get_u64(state, at + HEARD) + params[guard_law.RADIO_MS]) * 1e-3
    return promises.reach(params, place, said, known_s + later_s)
