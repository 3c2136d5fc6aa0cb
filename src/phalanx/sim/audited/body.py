"""Robots' bodies: what their sensors say, what their commands do, and where they are.

Two kinds: a point mass that accelerates (the paper's flocks), and two wheels with an LED (the demo's robots). Which one
a controller drives is in its declaration: what it reads, and what it commands.
"""

from __future__ import annotations

from phalanx.errors import UsageError
from phalanx.kernel import kernel
from phalanx.robot.controllers.declaration import Declaration
from phalanx.robot.controllers.sine import sine_cosine
from phalanx.sim.drive import AXLE_M, BODY_M, TOP_SPEED_MPS, turned_kernel
from phalanx.wire import table
from phalanx.wire.fields import Row, get_f32, get_i8, put_f32, put_u16, put_u64

from . import motion
from .world import World

POINT_MASS, WHEELS = table.KIND_SENSOR, table.KIND_WHEELS_SENSOR  # bodies go by what their sensors say
COMMANDS = {POINT_MASS: table.ACCELERATION, WHEELS: table.WHEELS_COMMAND}
SENSOR_BYTES = table.SENSOR.size
COMMAND_BYTES = table.ACCELERATION.size
WHEELS_SENSOR_BYTES = table.WHEELS_SENSOR.size
WHEELS_COMMAND_BYTES = table.WHEELS_COMMAND.size
ID, TIME = map(table.SENSOR.at, ("id", "t"))  # as in the other three
X, Y, VX, VY = map(table.SENSOR.at, ("x_m", "y_m", "vx_mps", "vy_mps"))
AX, AY = map(table.ACCELERATION.at, ("ax_mps2", "ay_mps2"))
X_MM, Y_MM, DIRECTION = map(table.WHEELS_SENSOR.at, ("x_mm", "y_mm", "direction_deg"))
LEFT, RIGHT, RED = map(table.WHEELS_COMMAND.at, ("left", "right", "red"))
LED_BYTES = WHEELS_COMMAND_BYTES - RED
MOST_MPS2 = 5.0
DEG_PER_RAD = 57.29577951308232


def driven_by(controller: Declaration) -> int:
    """POINT_MASS or WHEELS.

    Raises: UsageError: there is no body with that sensor and those actuators.
    """
    kind = int(controller.reads.tag or 0)
    if COMMANDS.get(kind) is not controller.commands:
        raise UsageError(f"no body says {controller.reads.name} and obeys {controller.commands.name}")
    return kind


@kernel
def advance(world: World, i: int) -> None:
    """Robot i is where its last command has brought it by now. Source: RoboRebound §4."""
    now_us = world.clock[0].now_us
    if world.clock[0].body == POINT_MASS:
        motion.advance(world.pos, world.vel, world.acc, world.moved_us, i, now_us)
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
def _inside(value: float, side: float) -> float:
    return min(max(value, BODY_M), side - BODY_M)


@kernel
def sensed(world: World, i: int, rob_id: int, now_ms: int) -> int:
    """What the robot's sensors say is in `world.reading`; its length. Source: docs/spec/rebound.md (27 bytes)."""
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
    """The actuators do what a command says, as far as they can; what is no command of theirs does nothing.

    Source: RoboRebound §4; docs/spec/world.md.
    """
    point = world.clock[0].body == POINT_MASS
    size = COMMAND_BYTES if point else WHEELS_COMMAND_BYTES
    if length != size or command[0] != (table.KIND_ACCELERATION if point else table.KIND_WHEELS_COMMAND):
        return
    advance(world, i)
    if point:
        motion.command(world.acc, i, get_f32(command, AX), get_f32(command, AY), MOST_MPS2)
    else:
        world.acc[i, 0] = _share(get_i8(command, LEFT))
        world.acc[i, 1] = _share(get_i8(command, RIGHT))
        for k in range(LED_BYTES):
            world.led[i, k] = command[RED + k]


@kernel
def _share(percent: int) -> float:
    return min(1.0, max(-1.0, percent / 100.0))


@kernel
def halt(world: World, i: int) -> None:
    """Robot i stands where it is. Source: RoboRebound §3.1 (Safe Mode)."""
    advance(world, i)
    for axis in range(2):
        world.acc[i, axis] = 0.0
        if world.clock[0].body == POINT_MASS:  # of wheels it is the direction
            world.vel[i, axis] = 0.0
