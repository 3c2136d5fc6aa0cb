"""Robots' bodies: their sensors, the effect of commands, their motion, and contacts.

There are two kinds: a point mass that accelerates (the paper's flocks), and two wheels with an LED (the demo's robots).
A controller's declaration selects the kind by its reading and its command. A body is moved only when its position is
needed. Contacts are counted and do not stop a robot, because the flocking law has no collision term.
"""

from __future__ import annotations

import math

from phalanx.arrays import F64x1, F64x2, I64x1
from phalanx.errors import UsageError
from phalanx.kernel import kernel
from phalanx.robot.controllers.declaration import Declaration
from phalanx.robot.controllers.sine import sine_cosine
from phalanx.wire import table
from phalanx.wire.fields import Row, get_f32, get_i8, put_f32, put_u16, put_u64
from phalanx.world.drive import AXLE_M, BODY_M, TOP_SPEED_MPS, turned_kernel
from phalanx.world.radio.reach import Reach, in_different_aisles

from .world import World

POINT_MASS, WHEELS = table.KIND_SENSOR, table.KIND_WHEELS_SENSOR  # a kind of body has the tag of its reading
COMMANDS = {POINT_MASS: table.ACCELERATION, WHEELS: table.WHEELS_COMMAND}
SENSOR_BYTES = table.SENSOR.size
COMMAND_BYTES = table.ACCELERATION.size
WHEELS_SENSOR_BYTES = table.WHEELS_SENSOR.size
WHEELS_COMMAND_BYTES = table.WHEELS_COMMAND.size
ID, TIME = map(table.SENSOR.at, ("id", "t"))  # the same in the other three records
X, Y, VX, VY = map(table.SENSOR.at, ("x_m", "y_m", "vx_mps", "vy_mps"))
AX, AY = map(table.ACCELERATION.at, ("ax_mps2", "ay_mps2"))
X_MM, Y_MM, DIRECTION = map(table.WHEELS_SENSOR.at, ("x_mm", "y_mm", "direction_deg"))
LEFT, RIGHT, RED = map(table.WHEELS_COMMAND.at, ("left", "right", "red"))
LED_BYTES = WHEELS_COMMAND_BYTES - RED
MOST_MPS2 = 5.0
DEG_PER_RAD = 57.29577951308232


def driven_by(controller: Declaration) -> int:
    """Return the kind of body that a controller drives: POINT_MASS or WHEELS.

    Raises: UsageError: there is no body with that sensor and those actuators.
    """
    kind = int(controller.reads.tag or 0)
    if COMMANDS.get(kind) is not controller.commands:
        raise UsageError(f"no body has readings {controller.reads.name} and commands {controller.commands.name}")
    return kind


@kernel
def advance(world: World, i: int) -> None:
    """Move robot i to its position at the current time under its last command. Source: RoboRebound §4."""
    now_us = world.clock[0].now_us
    if world.clock[0].body == POINT_MASS:
        accelerated(world.pos, world.vel, world.acc, world.moved_us, i, now_us)
        return
    # vel holds the direction in degrees; acc the wheels, each -1..1.
    dt = (now_us - world.moved_us[i]) * 1e-6
    world.moved_us[i] = now_us
    left, right = world.acc[i, 0] * TOP_SPEED_MPS, world.acc[i, 1] * TOP_SPEED_MPS
    if left == 0.0 and right == 0.0:
        return
    ahead, turn = turned_kernel(left, right, AXLE_M, dt)
    turn_deg = turn * DEG_PER_RAD
    sine, cosine = sine_cosine(world.vel[i, 0] + turn_deg / 2)
    world.pos[i, 0] = _inside(world.pos[i, 0] - ahead * sine, world.area[0])
    world.pos[i, 1] = _inside(world.pos[i, 1] + ahead * cosine, world.area[1])
    direction = world.vel[i, 0] + turn_deg
    if direction >= 360.0:
        direction -= 360.0
    elif direction < 0.0:
        direction += 360.0
    world.vel[i, 0] = direction


@kernel
def accelerated(pos: F64x2, vel: F64x2, acc: F64x2, at_us: I64x1, i: int, now_us: int) -> None:
    """Move robot i from at_us[i] to `now_us`: exactly, because its acceleration is constant in between.

    `pos`, `vel` and `acc`: (N, 2), m, m/s and m/s². `at_us`: (N,); at_us[i] is `now_us` afterwards.
    Source: RoboRebound §4 (double integrator).
    """
    dt = (now_us - at_us[i]) * 1e-6
    for axis in range(2):
        pos[i, axis] += dt * (vel[i, axis] + 0.5 * dt * acc[i, axis])
        vel[i, axis] += dt * acc[i, axis]
    at_us[i] = now_us


@kernel
def _inside(value: float, side: float) -> float:
    return min(max(value, BODY_M), side - BODY_M)


@kernel
def sensed(world: World, i: int, rob_id: int, now_ms: int) -> int:
    """Write robot i's reading to `world.reading`; return its length. Source: docs/spec/rebound.md (27 bytes)."""
    q: Row = world.reading
    put_u16(q, ID, rob_id)
    put_u64(q, TIME, now_ms)
    if world.clock[0].body == POINT_MASS:
        q[0] = table.KIND_SENSOR
        put_f32(q, X, world.pos[i, 0])
        put_f32(q, Y, world.pos[i, 1])
        put_f32(q, VX, world.vel[i, 0])
        put_f32(q, VY, world.vel[i, 1])
        return int(SENSOR_BYTES)
    q[0] = table.KIND_WHEELS_SENSOR
    put_f32(q, X_MM, world.pos[i, 0] * 1000.0)
    put_f32(q, Y_MM, world.pos[i, 1] * 1000.0)
    put_f32(q, DIRECTION, world.vel[i, 0])
    return int(WHEELS_SENSOR_BYTES)


@kernel
def actuate(world: World, i: int, command: Row, length: int) -> None:
    """Apply a command within the actuators' limits; ignore bytes that are not a command of this body.

    Source: RoboRebound §4; docs/spec/world.md.
    """
    point = world.clock[0].body == POINT_MASS
    size = COMMAND_BYTES if point else WHEELS_COMMAND_BYTES
    if length != size or command[0] != (table.KIND_ACCELERATION if point else table.KIND_WHEELS_COMMAND):
        return
    advance(world, i)
    if point:
        accelerate(world.acc, i, get_f32(command, AX), get_f32(command, AY), MOST_MPS2)
    else:
        world.acc[i, 0] = _share(get_i8(command, LEFT))
        world.acc[i, 1] = _share(get_i8(command, RIGHT))
        for k in range(LED_BYTES):
            world.led[i, k] = command[RED + k]


@kernel
def accelerate(acc: F64x2, i: int, ax: float, ay: float, most_mps2: float) -> None:
    """Set robot i's acceleration, each axis clipped to `most_mps2`, NaN taken as 0.

    The robot must have been advanced to now. `acc`: (N, 2), m/s².
    Source: RoboRebound §4.
    """
    acc[i, 0], acc[i, 1] = _clip(ax, most_mps2), _clip(ay, most_mps2)


@kernel
def _clip(value: float, most: float) -> float:
    if value >= most:
        return most
    if value <= -most:
        return -most
    return value if value == value else 0.0  # noqa: PLR0124 - false for NaN only


@kernel
def _share(percent: int) -> float:
    return min(1.0, max(-1.0, percent / 100.0))


@kernel
def halt(world: World, i: int) -> None:
    """Stop robot i where it is. Source: RoboRebound §3.1 (Safe Mode)."""
    advance(world, i)
    for axis in range(2):
        world.acc[i, axis] = 0.0
        if world.clock[0].body == POINT_MASS:  # with wheels, `vel` holds the direction
            world.vel[i, axis] = 0.0


# --- contacts ---


@kernel
def robot_contacts(pos: F64x2, last: F64x2, reach: Reach, contact_m: float) -> int:
    """Return how many pairs of robots came closer than `contact_m` since the last check; each contact counts once.

    Robots are assumed to move straight between two checks, so none passes through another unnoticed. Distances are
    between centres.

    Args:
        pos: (N, 2), m, for which `reach` was rebuilt, with a range of at least `contact_m`.
        last: (N, 2), m, `pos` at the last check; NaN at the first.
    """
    count = 0
    limit = contact_m * contact_m
    # Robots farther apart than this cannot have been in contact since the last check.
    far = contact_m + 2.0 * _longest_step(pos, last) + 0.01
    beyond = far * far
    for i in range(len(pos)):
        if reach.least_m[i] > far + reach.skin_m:  # since the rebuild two robots have approached by at most the skin
            continue
        for at in range(reach.near[i], reach.near[i + 1]):
            k = int(reach.candidate_ids[at])
            x, y = pos[k, 0] - pos[i, 0], pos[k, 1] - pos[i, 1]
            if k < i or x * x + y * y > beyond or in_different_aisles(reach, i, k):
                continue
            was_x, was_y = last[k, 0] - last[i, 0], last[k, 1] - last[i, 1]
            if was_x * was_x + was_y * was_y < limit:  # in contact already
                continue
            if _closest(was_x, was_y, x, y) < limit:
                count += 1
    return count


@kernel
def _longest_step(pos: F64x2, last: F64x2) -> float:
    """Return the longest distance moved by a robot since the last check, m; 0 for a robot without last position."""
    longest = 0.0
    for i in range(len(pos)):
        x, y = pos[i, 0] - last[i, 0], pos[i, 1] - last[i, 1]
        if x * x + y * y > longest:  # noqa: PLR1730 - compiled, `max` treats NaN differently
            longest = x * x + y * y
    return math.sqrt(longest)


@kernel
def _closest(from_x: float, from_y: float, to_x: float, to_y: float) -> float:
    """Return the least squared distance from the origin to a segment, or to its end if its start is NaN."""
    if math.isnan(from_x + from_y):
        return to_x * to_x + to_y * to_y
    step_x, step_y = to_x - from_x, to_y - from_y
    length = step_x * step_x + step_y * step_y
    share = -(from_x * step_x + from_y * step_y) / length if length > 0 else 0.0
    share = min(1.0, max(0.0, share))
    x, y = from_x + share * step_x, from_y + share * step_y
    return x * x + y * y


@kernel
def obstacle_contacts(pos: F64x2, last: F64x2, discs: F64x2, boxes: F64x2, contact_m: float) -> int:
    """Return how many robots came into contact with an obstacle since the last check; each contact counts once.

    A robot touches an obstacle if its centre is less than half of `contact_m` from the obstacle's edge. Only positions
    at checks count: at 10 m/s a robot moves half a metre in the 50 ms between them, and obstacles are larger.

    Args:
        pos, last: as for `robot_contacts`.
        discs: (D, 3), m: centre x, y, radius.
        boxes: (B, 4), m: least x, least y, greatest x, greatest y.
    """
    count = 0
    radius = 0.5 * contact_m
    for i in range(len(pos)):
        for n in range(len(discs)):
            if _in_disc(pos[i], discs[n], radius) and not _in_disc(last[i], discs[n], radius):
                count += 1
        for n in range(len(boxes)):
            if _in_box(pos[i], boxes[n], radius) and not _in_box(last[i], boxes[n], radius):
                count += 1
    return count


@kernel
def _in_disc(at: F64x1, disc: F64x1, radius: float) -> bool:
    x, y, reach = at[0] - disc[0], at[1] - disc[1], disc[2] + radius
    return x * x + y * y < reach * reach  # type: ignore[no-any-return]


@kernel
def _in_box(at: F64x1, box: F64x1, radius: float) -> bool:
    if not (math.isfinite(at[0]) and math.isfinite(at[1])):
        return False
    x = max(box[0] - at[0], 0.0, at[0] - box[2])
    y = max(box[1] - at[1], 0.0, at[1] - box[3])
    return x * x + y * y < radius * radius  # type: ignore[no-any-return]
