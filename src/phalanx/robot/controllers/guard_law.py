"""The guard's law as numbers: whether a robot can still brake after a command; bundled/guard.py encodes it.

A command is good if the path until the next command is in force, and the braking after it, keep clear of all walls and
of all places where a neighbour can be by then (promises.py). A robot that always chooses a good command, or else
continues to brake, never collides. docs/guides/guard.md has the proof; tests/test_guarded_search.py searches for
counterexamples.
"""

from __future__ import annotations

import hashlib
import math
from typing import TypeAlias

import numpy as np

from phalanx.arrays import Params
from phalanx.config.guard import GuardConfig
from phalanx.kernel import kernel
from phalanx.wire.fields import whole
from phalanx.wire.guarded import ENVELOPE_BYTES

# State of a robot at a reading, x and y of each: position, m; velocity, m/s; the command still in force, m/s².
Motion: TypeAlias = tuple[float, float, float, float, float, float]
# Indices of the parameters. Then follow the envelope's hash, one byte per number, walls of four numbers, and discs of
# three. If the mission names an adviser, the mission's number and the bytes of the key are the last.
N_MAX, FORGET_MS, STATE_EVERY, ADVICE_MS, RADIO_MS = 0, 1, 2, 3, 4
SPEED, WISHED, ACCEL, APART, CLEAR = 5, 6, 7, 8, 9
PERIOD_S, LATE_S, HELD_S, PROMISE_MS, TURN, WALLS, DISCS = 10, 11, 12, 13, 14, 15, 16
HASH = 17
OBSTACLES = HASH + ENVELOPE_BYTES
LITTLE_ENDIAN = np.dtype(np.float64).newbyteorder("<")  # the same on any machine, because it is hashed
# Shares of the wish that are tried in turn.
SHARES = (1.0, 0.75, 0.5, 0.25, 0.125)
# Distance that a braked robot may still creep, in units of accel · held²; see `rest_s`.
CREEP = 0.14
# Share of the envelope's speed below which the turn rate is not limited.
ON_THE_SPOT = 0.05
# Speeds below this count as zero, because of rounding to f32.
STILL_MPS = 1e-3


def guard_params(config: GuardConfig) -> Params:
    """Return the mission's parameters for kernels: 17 numbers, the SHA-1 of all the others, walls, discs, adviser.

    A command is in force until the next one: both readings may be off their due time by δ, and the next command may be
    late by δ. The speed limit of wishes is lower than the envelope's by what a late command can add.
    """
    period_s, late_s = config.period_ms / 1000, config.delta_ms / 1000
    head = [
        config.n_max,
        config.forget_ms,
        config.state_every,
        config.advice_ms,
        config.radio_ms,
        config.speed_mps,
        config.speed_mps - 2.0 * config.accel_mps2 * late_s,
        config.accel_mps2,
        config.apart_m,
        config.clear_m,
        period_s,
        late_s,
        period_s + 3.0 * late_s,
        config.promise_ms,
        config.turn_radps,
    ]
    walls = config.walls()
    head += [len(walls), len(config.discs)]
    rest = [number for wall in walls for number in wall]
    rest += [number for disc in config.discs for number in (disc.x_m, disc.y_m, disc.radius_m)]
    if config.adviser_key:
        rest += [config.mission, *bytes.fromhex(config.adviser_key)]
    digest = hashlib.sha1(np.array([*head, *rest], LITTLE_ENDIAN).tobytes(), usedforsecurity=False).digest()
    return np.array([*head, *digest, *rest], dtype=np.float64)


@kernel
def adviser_at(params: Params) -> int:
    """Return the adviser's offset in the parameters: mission number, then key; 0 if none is named."""
    at = OBSTACLES + 4 * whole(params[WALLS]) + 3 * whole(params[DISCS])
    return at if at < params.size else whole(0)


@kernel
def towards(params: Params, vx: float, vy: float, to_x: float, to_y: float) -> tuple[float, float]:
    """Return the command that reaches a velocity as soon as possible without overshoot, m/s²; (0, 0) brakes."""
    ax, ay = (to_x - vx) / params[HELD_S], (to_y - vy) / params[HELD_S]
    return shortened(ax, ay, params[ACCEL])


@kernel
def straightened(params: Params, vx: float, vy: float, ax: float, ay: float) -> tuple[float, float]:
    """Return the command with its part across the velocity limited by the envelope's turn rate, m/s².

    The turn rate is that part divided by the lowest speed before the next command. Braking is unchanged, and no speed
    increases: docs/guides/guard.md.
    """
    turn, speed = params[TURN], math.sqrt(vx * vx + vy * vy)
    if turn == 0.0 or speed <= ON_THE_SPOT * params[SPEED]:
        return ax, ay
    along, across = (ax * vx + ay * vy) / speed, (ay * vx - ax * vy) / speed
    slowest = max(0.0, speed + params[HELD_S] * min(0.0, along))
    most = turn * slowest * slowest / speed
    kept = min(most, max(-most, across))
    if kept == across:
        return ax, ay
    return (along * vx - kept * vy) / speed, (along * vy + kept * vx) / speed


@kernel
def shortened(x: float, y: float, longest: float) -> tuple[float, float]:
    """Return the vector, scaled down to length `longest` if it is longer."""
    squared = x * x + y * y
    if squared <= longest * longest:
        return x, y
    share = longest / math.sqrt(squared)
    return x * share, y * share


@kernel
def brake_m(params: Params, speed: float) -> float:
    """Return the longest braking distance, from the reading at which braking begins. Source: docs/guides/guard.md."""
    accel, held = params[ACCEL], params[HELD_S]
    if speed < accel * held:
        return float(speed * (params[LATE_S] + held))
    return float(speed * params[LATE_S] + 0.5 * speed * speed / accel + 0.5 * accel * held * held)


@kernel
def rest_s(params: Params, speed: float) -> float:
    """Return the time after which a braking robot stands still, except for CREEP. Source: docs/guides/guard.md."""
    return float(params[LATE_S] + speed / params[ACCEL] + 2.0 * params[HELD_S])


@kernel
def late_mps(params: Params, ax: float, ay: float) -> float:
    """Return the velocity that a command adds during the delay of the next one."""
    return float(math.sqrt(ax * ax + ay * ay) * params[LATE_S])


@kernel
def off_mps(params: Params, now: Motion, ax: float, ay: float) -> float:
    """Return the largest velocity error due to timing: late commands and brakes, and a next reading early or late."""
    return late_mps(params, ax - now[4], ay - now[5]) + 3.0 * late_mps(params, ax, ay)


@kernel
def planned_path(
    params: Params, now: Motion, ax: float, ay: float
) -> tuple[float, float, float, float, float, float, float]:
    """Return the path of a robot that executes the command (ax, ay) and brakes from its next reading on.

    Source: docs/guides/guard.md.
    Returns: its position at the next reading; its final position; its largest distance from the line between these;
        its largest distance from the line to the first; and the time until it stands, s.
    """
    x, y, vx, vy = now[0], now[1], now[2], now[3]
    period, late = params[PERIOD_S], params[LATE_S]
    next_x, next_y = x + period * (vx + 0.5 * period * ax), y + period * (vy + 0.5 * period * ay)
    then_x, then_y = vx + period * ax, vy + period * ay
    push, off = math.sqrt(ax * ax + ay * ay), off_mps(params, now, ax, ay)
    speed = math.sqrt(then_x * then_x + then_y * then_y)
    stands_s = rest_s(params, speed + off)
    # Add the distance by which a late reading delays braking.
    brake = brake_m(params, speed + off) + 2.0 * late * (speed + off)
    share = brake / speed if speed > 0.0 else 0.0
    last_x, last_y = next_x + share * then_x, next_y + share * then_y
    bulge = 0.125 * push * period * period + off * params[HELD_S]
    spread = off * (params[HELD_S] + stands_s)
    return next_x, next_y, last_x, last_y, spread, bulge, params[HELD_S] + stands_s


@kernel
def squared_distance_to_segment(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the squared distance of a point from the segment from a to b."""
    long_x, long_y = bx - ax, by - ay
    length = long_x * long_x + long_y * long_y
    share = 0.0
    if length > 0.0:
        share = ((x - ax) * long_x + (y - ay) * long_y) / length
        share = min(1.0, max(0.0, share))
    dx, dy = ax + share * long_x - x, ay + share * long_y - y
    return dx * dx + dy * dy


@kernel
def _side(ax: float, ay: float, bx: float, by: float, x: float, y: float) -> float:
    return (bx - ax) * (y - ay) - (by - ay) * (x - ax)


@kernel
def squared_distance_of_segments(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float
) -> float:
    """Return the squared distance of the segments from a to b and from c to d."""
    crossed = _side(ax, ay, bx, by, cx, cy) * _side(ax, ay, bx, by, dx, dy) < 0.0
    if crossed and _side(cx, cy, dx, dy, ax, ay) * _side(cx, cy, dx, dy, bx, by) < 0.0:
        return 0.0
    one = min(squared_distance_to_segment(ax, ay, cx, cy, dx, dy), squared_distance_to_segment(bx, by, cx, cy, dx, dy))
    return min(
        one, squared_distance_to_segment(cx, cy, ax, ay, bx, by), squared_distance_to_segment(dx, dy, ax, ay, bx, by)
    )


@kernel
def retreats(params: Params, now: Motion, out_x: float, out_y: float, ax: float, ay: float) -> bool:
    """Return whether the motion has no component against (out_x, out_y), so that it only moves away from a wall."""
    _, _, vx, vy, old_x, old_y = now
    late, period = params[LATE_S], params[PERIOD_S]
    length = math.sqrt(out_x * out_x + out_y * out_y)
    if length == 0.0:
        return False
    speed = (out_x * vx + out_y * vy) / length
    later = speed + late * (out_x * old_x + out_y * old_y) / length
    push = (out_x * ax + out_y * ay) / length
    return speed >= -STILL_MPS and later >= -STILL_MPS and push >= 0.0 and later + period * push >= 0.0


@kernel
def clear_of_walls(params: Params, now: Motion, ax: float, ay: float) -> bool:
    """Return whether the path keeps `clear_m` from each wall and disc, or leads away. Source: docs/guides/guard.md."""
    next_x, next_y, last_x, last_y, spread, bulge, _ = planned_path(params, now, ax, ay)
    x, y = now[0], now[1]
    first, then = params[CLEAR] + bulge, params[CLEAR] + spread
    at = OBSTACLES
    for _ in range(whole(params[WALLS])):
        cx, cy, dx, dy = params[at], params[at + 1], params[at + 2], params[at + 3]
        at += 4
        clear = squared_distance_of_segments(x, y, next_x, next_y, cx, cy, dx, dy) >= first * first
        if clear and squared_distance_of_segments(next_x, next_y, last_x, last_y, cx, cy, dx, dy) >= then * then:
            continue
        long_x, long_y = dx - cx, dy - cy
        length = long_x * long_x + long_y * long_y
        share = ((x - cx) * long_x + (y - cy) * long_y) / length if length > 0.0 else 0.0
        share = min(1.0, max(0.0, share))
        if not retreats(params, now, x - cx - share * long_x, y - cy - share * long_y, ax, ay):
            return False
    for _ in range(whole(params[DISCS])):
        cx, cy, radius = params[at], params[at + 1], params[at + 2]
        at += 3
        near, far = radius + first, radius + then
        clear = squared_distance_to_segment(cx, cy, x, y, next_x, next_y) >= near * near
        if clear and squared_distance_to_segment(cx, cy, next_x, next_y, last_x, last_y) >= far * far:
            continue
        if not retreats(params, now, x - cx, y - cy, ax, ay):
            return False
    return True
