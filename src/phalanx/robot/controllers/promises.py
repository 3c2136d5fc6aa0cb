"""Promises of guarded robots about their velocity, on which other robots rely; see also `guard_law.py`.

The velocity g of a broadcast promises a disc of velocities with centre g/2 and radius WIDE · |g|, which contains
standing still. For `promise_ms` from the reading on, the sender's velocity stays in the disc. A g faster than MEANT
times the envelope's speed promises only that speed. Others may come closer to robots that promise low speeds.
Source: docs/guides/guard.md ("Promises").
"""

from __future__ import annotations

import math

from phalanx.arrays import Params
from phalanx.kernel import kernel
from phalanx.wire import guarded
from phalanx.wire.fields import F32_BYTES, Row, get_f32, get_u64, put_f32, put_u64, whole

from . import guard_law

WIDE = 0.8
# A disc contains speeds up to (1/2 + WIDE) |g|: with a larger |g| than this share of the envelope's speed, its promise
# would be weaker than the envelope.
MEANT = 1.0 / (0.5 + WIDE)
# Residual speed of a robot that stands still, as a share of the envelope's speed.
STIRS = 0.01
# Share of the space between two robots that their promises together may use.
SHARED = 1.2
# Largest difference of two robots' clocks after the longest promise, ms.
CLOCKS_MS = 10

EACH_BYTES = guarded.PROMISE.size
MADE_AT = guarded.GUARD_MEMORY.at("promises")
END = MADE_AT + guarded.PROMISES * EACH_BYTES
UNTIL, PROMISED_X, PROMISED_Y = map(guarded.PROMISE.at, ("until", "vx_mps", "vy_mps"))
NUMBERS = (EACH_BYTES - PROMISED_X) // F32_BYTES


@kernel
def is_within_envelope(params: Params, gx: float, gy: float) -> bool:
    """Return whether the disc of g is within the envelope's speed."""
    most = MEANT * params[guard_law.SPEED]
    return bool(gx * gx + gy * gy <= most * most)


@kernel
def disc(params: Params, gx: float, gy: float) -> tuple[float, float, float]:
    """Return the disc of velocities that g promises: centre, x and y, and radius."""
    if not is_within_envelope(params, gx, gy):
        return 0.0, 0.0, params[guard_law.SPEED]
    return 0.5 * gx, 0.5 * gy, WIDE * math.sqrt(gx * gx + gy * gy) + STIRS * params[guard_law.SPEED]


@kernel
def holds(params: Params, g: tuple[float, float], v: tuple[float, float], off_mps: float, rests_mps: float) -> bool:
    """Return whether the promise g covers velocity v with its error, and all velocities from v to rest."""
    mx, my, wide = disc(params, g[0], g[1])
    room, at_rest = wide - off_mps, wide - rests_mps
    if room < 0.0 or at_rest < 0.0 or mx * mx + my * my > at_rest * at_rest:
        return False
    dx, dy = v[0] - mx, v[1] - my
    return bool(dx * dx + dy * dy <= room * room)


@kernel
def _promise_at(state: Row, at: int) -> tuple[float, float]:
    return get_f32(state, at + PROMISED_X), get_f32(state, at + PROMISED_Y)


@kernel
def keeps_promises(
    params: Params, t_ms: int, state: Row, v: tuple[float, float], off_mps: float, rests_mps: float
) -> bool:
    """Return whether a velocity keeps all promises that are still in force."""
    for at in range(MADE_AT, END, EACH_BYTES):
        if get_u64(state, at + UNTIL) > t_ms and not holds(params, _promise_at(state, at), v, off_mps, rests_mps):
            return False
    return True


@kernel
def slowest_mps(params: Params, t_ms: int, state: Row) -> float:
    """Return the slowest promised speed that is still in force; without one, the envelope's limit for wishes."""
    slowest = params[guard_law.WISHED]
    for at in range(MADE_AT, END, EACH_BYTES):
        if get_u64(state, at + UNTIL) > t_ms:
            gx, gy = _promise_at(state, at)
            slowest = min(slowest, math.sqrt(gx * gx + gy * gy))
    return float(slowest)


@kernel
def closing_mps(params: Params, gx: float, gy: float, gap_x: float, gap_y: float) -> float:
    """Return the largest closing speed of a robot that promises g, towards one at (gap_x, gap_y) from it."""
    mx, my, wide = disc(params, gx, gy)
    far = math.sqrt(gap_x * gap_x + gap_y * gap_y)
    return float(wide + (mx * gap_x + my * gap_y) / far) if far > 0.0 else wide


@kernel
def fair_mps(params: Params, gap_x: float, gap_y: float) -> float:
    """Return the closing speed for each of two robots at which both stay in their share of the gap for `promise_ms`."""
    room = math.sqrt(gap_x * gap_x + gap_y * gap_y) - params[guard_law.APART]
    return float(0.5 * SHARED * max(0.0, room) / (params[guard_law.PROMISE_MS] * 1e-3))


@kernel
def reach(
    params: Params, place: tuple[float, float], said: tuple[float, float], known_s: float
) -> tuple[float, float, float]:
    """Return the disc in which a robot can be whose reading at `place` is at most `known_s` old: centre and radius, m.

    It includes the distance between bodies, and the creep while braking. The promise `said` holds for `promise_ms`;
    after that the limit is the envelope's speed.
    """
    kept_s = min(known_s, params[guard_law.PROMISE_MS] * 1e-3)
    mx, my, wide = disc(params, said[0], said[1])
    creep = guard_law.CREEP * params[guard_law.ACCEL] * params[guard_law.HELD_S] * params[guard_law.HELD_S]
    far = params[guard_law.APART] + creep + wide * kept_s + params[guard_law.SPEED] * (known_s - kept_s)
    return place[0] + mx * kept_s, place[1] + my * kept_s, far


@kernel
def make(params: Params, t_ms: int, state: Row, gx: float, gy: float) -> tuple[float, float]:
    """Store the promise g, or extend the newest one if too many are in force; return the promise to broadcast."""
    if not is_within_envelope(params, gx, gy):
        return gx, gy
    oldest, newest = MADE_AT, MADE_AT
    for at in range(MADE_AT, END, EACH_BYTES):
        if get_u64(state, at + UNTIL) < get_u64(state, oldest + UNTIL):
            oldest = at
        if get_u64(state, at + UNTIL) > get_u64(state, newest + UNTIL):
            newest = at
    at = newest
    if get_u64(state, oldest + UNTIL) <= t_ms:
        at = oldest
        put_f32(state, at + PROMISED_X, gx)
        put_f32(state, at + PROMISED_Y, gy)
    put_u64(state, at + UNTIL, t_ms + whole(params[guard_law.PROMISE_MS]) + CLOCKS_MS)
    return _promise_at(state, at)
