"""Controller of robots that visitors drive: two wheels and an LED, by joystick or along a route.

It obeys signed orders (orders.py). The state is a `wheels_memory` and the route: 158 + 4 n bytes. It includes the
signers' keys and the last joystick order; reached points are removed from the route. A held robot stands still. Invalid
readings stop the wheels, and the robot broadcasts nothing.

Source: docs/spec/vocabulary.md (orders, lengths and directions); RoboRebound Alg. 1 (the structure).
"""

from __future__ import annotations

import math

import numpy as np

from phalanx.arrays import Params
from phalanx.config.flock import WheelsConfig
from phalanx.kernel import kernel
from phalanx.robot.controllers import orders
from phalanx.robot.controllers.declaration import Declaration
from phalanx.robot.controllers.sine import sine_cosine
from phalanx.robot.follow import FULL_PCT, percent, steer
from phalanx.wire import driven, table
from phalanx.wire.fields import (
    F32_BYTES,
    Row,
    are_fine,
    copy,
    get_f32,
    get_i8,
    get_u16,
    get_u64,
    put_head,
    put_u16,
    put_u64,
    whole,
)

GOOD_MS, STATE_EVERY, MISSION, LOOKS, KEYS = 0, 1, 2, 3, 4  # indices of the parameters; a key has one byte per number


def wheels_params(config: WheelsConfig) -> Params:
    """Return the mission's parameters for kernels."""
    keys = [key or bytes(driven.SIGNER_KEY_BYTES) for key in (config.gateway_key, config.operator_key)]
    numbers = [config.good_ms, config.state_every, config.mission, config.looks, *b"".join(keys)]
    return np.array(numbers, dtype=np.float64)


CONTROLLER = Declaration(
    reads=table.WHEELS_SENSOR,
    commands=table.WHEELS_COMMAND,
    says=table.WHEELS_STATE,
    remembers=(driven.WHEELS_MEMORY, driven.WAYPOINT),
    config=WheelsConfig,
    params=wheels_params,
)
READING_BYTES = table.WHEELS_SENSOR.size
COMMAND_BYTES = table.WHEELS_COMMAND.size
STATE_BYTES = table.WHEELS_STATE.size
ID = table.WHEELS_STATE.at("id")  # the same in readings and commands
BODY = table.WHEELS_STATE.at("x_mm")  # offset of the pose, also in readings, and of the wheels in commands
POSE_BYTES = table.WHEELS_STATE.at("red") - BODY
POSE_NUMBERS = POSE_BYTES // F32_BYTES

X, Y, DIRECTION, LEFT, RIGHT = map(driven.WHEELS_MEMORY.at, ("x_mm", "y_mm", "direction_deg", "left", "right"))
HEARD, LED, HELD, CHECKS = map(driven.WHEELS_MEMORY.at, ("heard", "red", "held", "checks"))
SIGNERS, THRESHOLD, COUNT, ROUTE = map(driven.WHEELS_MEMORY.at, ("signers", "threshold_mm", "count", "route"))
HELD_BY_ALL = (1 << driven.SIGNERS) - 1
TOLD_RIGHT = driven.ORDER_WHEELS.at("right")
COMMAND_RIGHT, COMMAND_LED = (table.WHEELS_COMMAND.at(name) - BODY for name in ("right", "red"))
CAPACITY_BYTES = ROUTE + orders.POINT_BYTES * orders.WAYPOINTS_MAX


@kernel
def capacity(_params: Params) -> int:
    """Return the length of the longest state, bytes."""
    return CAPACITY_BYTES


@kernel
def size(state: Row) -> int:
    """Return the length of the encoding in `state`."""
    return ROUTE + orders.POINT_BYTES * whole(state[COUNT])


@kernel
def begin(params: Params, _rob_id: int, state: Row) -> int:
    """Write the state at boot to `state`: the signers' keys, no orders, the LED off; return its length."""
    state[:ROUTE] = 0
    for signer in range(driven.SIGNERS):
        at = SIGNERS + orders.EACH_BYTES * signer
        for k in range(driven.SIGNER_KEY_BYTES):
            state[at + k] = whole(params[KEYS + driven.SIGNER_KEY_BYTES * signer + k])
        put_u64(state, at + orders.LEAST, orders.NEVER)
    return size(state)


@kernel
def is_encoding(params: Params, _rob_id: int, state: Row, length: int) -> bool:
    """Return whether the first `length` bytes are a valid state of this robot (dispatch.py)."""
    if not ROUTE <= length <= CAPACITY_BYTES or length != size(state) or not are_fine(state, X, POSE_NUMBERS):
        return False
    left, right = get_i8(state, LEFT), get_i8(state, RIGHT)
    if abs(left) > FULL_PCT or abs(right) > FULL_PCT or get_u64(state, HEARD) < 0:
        return False
    if state[HELD] > HELD_BY_ALL or state[CHECKS] > params[LOOKS] or not _are_signers(params, state):
        return False
    if state[HELD] > 0 and (left != 0 or right != 0 or state[COUNT] > 0):
        return False
    threshold = get_u16(state, THRESHOLD)
    if state[COUNT] > 0:
        return left == 0 and right == 0 and 1 <= threshold <= orders.THRESHOLD_MAX_MM
    return threshold <= orders.THRESHOLD_MAX_MM


@kernel
def _are_signers(params: Params, state: Row) -> bool:
    for signer in range(driven.SIGNERS):
        at = SIGNERS + orders.EACH_BYTES * signer
        for k in range(driven.SIGNER_KEY_BYTES):
            if state[at + k] != whole(params[KEYS + driven.SIGNER_KEY_BYTES * signer + k]):
                return False
        if not orders.is_signer(state, at):
            return False
    return True


@kernel
def on_recv(params: Params, rob_id: int, t_ms: int, packet: Row, length: int, state: Row) -> int:
    """Obey a packet if it is a valid order; return the new length of the encoding. Source: docs/spec/orders.md."""
    if not orders.is_order(whole(params[MISSION]), rob_id, packet, length):
        return size(state)
    signer = whole(packet[orders.WHO])
    at = SIGNERS + orders.EACH_BYTES * signer
    if not orders.is_new_order(t_ms, packet, state, at) or state[CHECKS] >= params[LOOKS]:
        return size(state)
    state[CHECKS] += 1
    if orders.is_signed(packet, length, state, at):
        orders.learn(t_ms, packet, state, at)
        _obey(signer, t_ms, packet, length - driven.SIGNATURE_BYTES, state)
    return size(state)


@kernel
def _obey(signer: int, t_ms: int, packet: Row, end: int, state: Row) -> None:
    """Carry out an order; while a signer holds the robot, ignore orders to move. Source: docs/spec/vocabulary.md."""
    action, body = int(packet[orders.ACTION]), orders.BODY
    if action == driven.TELL_STOP:
        state[HELD] |= 1 << signer
        state[LEFT] = 0
        state[RIGHT] = 0
        state[COUNT] = 0
    elif action == driven.TELL_GO:
        state[HELD] &= HELD_BY_ALL - (1 << signer)
    elif action == driven.TELL_LED:
        copy(state, LED, packet, body, orders.LED_BYTES)
    elif action == driven.TELL_WHEELS and state[HELD] == 0:
        state[LEFT] = percent(get_i8(packet, body)) & 255
        state[RIGHT] = percent(get_i8(packet, body + TOLD_RIGHT)) & 255
        put_u64(state, HEARD, t_ms)
        state[COUNT] = 0
    elif action == driven.TELL_ROUTE and state[HELD] == 0:
        state[LEFT] = 0
        state[RIGHT] = 0
        put_u16(state, THRESHOLD, get_u16(packet, orders.THRESHOLD))
        state[COUNT] = packet[orders.COUNT]
        copy(state, ROUTE, packet, orders.POINTS, end - orders.POINTS)


@kernel
def on_input(params: Params, rob_id: int, step: int, t_ms: int, reading: Row, length: int, state: Row, out: Row) -> int:
    """Write a command, and a broadcast if due, to `out`; return their length."""
    left, right = whole(0), whole(0)
    state[CHECKS] = 0
    is_valid = length == READING_BYTES and reading[0] == table.KIND_WHEELS_SENSOR and get_u16(reading, ID) == rob_id
    is_valid = is_valid and are_fine(reading, BODY, POSE_NUMBERS)
    if is_valid:
        copy(state, X, reading, BODY, POSE_BYTES)
        _drop_reached(state)
        if state[COUNT] > 0:
            left, right = _towards(state)
        elif t_ms - get_u64(state, HEARD) <= whole(params[GOOD_MS]):
            left, right = get_i8(state, LEFT), get_i8(state, RIGHT)
    end = BODY + put_head(out, 0, table.ENTRY_ACMD, COMMAND_BYTES, table.KIND_WHEELS_COMMAND, rob_id, t_ms)
    out[end] = left & 255
    out[end + COMMAND_RIGHT] = right & 255
    copy(out, end + COMMAND_LED, state, LED, orders.LED_BYTES)
    end += COMMAND_BYTES - BODY
    if is_valid and (step + rob_id) % whole(params[STATE_EVERY]) == 0:
        end = BODY + put_head(out, end, table.ENTRY_SEND, STATE_BYTES, table.KIND_WHEELS_STATE, rob_id, t_ms)
        copy(out, end, state, X, POSE_BYTES)
        copy(out, end + POSE_BYTES, state, LED, orders.LED_BYTES)
        end += POSE_BYTES + orders.LED_BYTES
    return end


@kernel
def _first(state: Row) -> tuple[float, float]:
    """Return the vector to the first point of the route, mm."""
    x_mm, y_mm = get_u16(state, ROUTE + orders.POINT_X), get_u16(state, ROUTE + orders.POINT_Y)
    return x_mm - get_f32(state, X), y_mm - get_f32(state, Y)


@kernel
def _drop_reached(state: Row) -> None:
    """Remove points from the start of the route as long as they are reached."""
    near = get_u16(state, THRESHOLD)
    while state[COUNT] > 0:
        dx, dy = _first(state)
        if dx * dx + dy * dy > near * near:
            break
        copy(state, ROUTE, state, ROUTE + orders.POINT_BYTES, size(state) - ROUTE - orders.POINT_BYTES)
        state[COUNT] -= 1


@kernel
def _towards(state: Row) -> tuple[int, int]:
    """Return the wheel speeds, left and right, towards the first point of the route, percent."""
    dx, dy = _first(state)
    sin, cos = sine_cosine(get_f32(state, DIRECTION))
    return steer(dy * cos - dx * sin, -dx * cos - dy * sin, math.sqrt(dx * dx + dy * dy))
