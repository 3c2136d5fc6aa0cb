"""The promises of a guarded robot's velocity, on which others may count; the law is in `guard_law.py`.

A broadcast's velocity g stands for a disc of velocities: around g/2, WIDE · |g| wide, so that standing still is in it.
For `promise_ms` from its reading on the sender's velocity stays in there. A g faster than MEANT of the envelope's speed
promises that speed alone. Robots that promise little may be approached. Source: docs/guides/guard.md ("Promises").
"""

from __future__ import annotations

import math

from phalanx.arrays import Params
from phalanx.kernel import kernel
from phalanx.wire import guarded
from phalanx.wire.fields import F32_BYTES, Row, get_f32, get_u64, put_f32, put_u64, whole

from . import guard_law

WIDE = 0.8
# A disc has speeds up to (1/2 + WIDE) |g|: a promise of more than so much of the envelope's speed would be none.
MEANT = 1.0 / (0.5 + WIDE)
# Of the envelope's speed: what a robot that stands may still creep.
STIRS = 0.01
# Two robots' promises together take so much of the room that is between them.
SHARED = 1.2
# By how much the clocks of two robots differ after the longest promise, ms.
CLOCKS_MS = 10

EACH_BYTES = guarded.PROMISE.size
MADE_AT = guarded.GUARD_MEMORY.at("promises")
END = MADE_AT + guarded.PROMISES * EACH_BYTES
UNTIL, PROMISED_X, PROMISED_Y = map(guarded.PROMISE.at, ("until", "vx_mps", "vy_mps"))
NUMBERS = (EACH_BYTES - PROMISED_X) // F32_BYTES


@kernel
def exceeds_envelope(params: Params, gx: float, gy: float) -> bool:
    """Return whether g promises more than the envelope's speed."""
    most = MEANT * params[guard_law.SPEED]
    return bool(gx * gx + gy * gy <= most * most)


@kernel
def disc(params: Params, gx: float, gy: float) -> tuple[float, float, float]:
    """The velocities that g stands for: their middle, x and y, and how far from it they are at most."""
    if not exceeds_envelope(params, gx, gy):
        return 0.0, 0.0, params[guard_law.SPEED]
    return 0.5 * gx, 0.5 * gy, WIDE * math.sqrt(gx * gx + gy * gy) + STIRS * params[guard_law.SPEED]


@kernel
def holds(params: Params, g: tuple[float, float], v: tuple[float, float], off_mps: float, rests_mps: float) -> bool:
    """Return whether a velocity with this error is in the disc, and so is its whole way to rest."""
    mx, my, wide = disc(params, g[0], g[1])
    room, at_rest = wide - off_mps, wide - rests_mps
    if room < 0.0 or at_rest < 0.0 or mx * mx + my * my > at_rest * at_rest:
        return False
    dx, dy = v[0] - mx, v[1] - my
    return bool(dx * dx + dy * dy <= room * room)


@kernel
def _said(state: Row, at: int) -> tuple[float, float]:
    return get_f32(state, at + PROMISED_X), get_f32(state, at + PROMISED_Y)


@kernel
def keeps_promises(
    params: Params, t_ms: int, state: Row, v: tuple[float, float], off_mps: float, rests_mps: float
) -> bool:
    """Return whether the velocity keeps all promises that still hold."""
    for at in range(MADE_AT, END, EACH_BYTES):
        if get_u64(state, at + UNTIL) > t_ms and not holds(params, _said(state, at), v, off_mps, rests_mps):
            return False
    return True


@kernel
def slowest_mps(params: Params, t_ms: int, state: Row) -> float:
    """The slowest velocity that was said and still holds; the envelope's for wishes if there is none."""
    slowest = params[guard_law.WISHED]
    for at in range(MADE_AT, END, EACH_BYTES):
        if get_u64(state, at + UNTIL) > t_ms:
            gx, gy = _said(state, at)
            slowest = min(slowest, math.sqrt(gx * gx + gy * gy))
    return float(slowest)


@kernel
def closing_mps(params: Params, gx: float, gy: float, gap_x: float, gap_y: float) -> float:
    """How fast who promises g may come nearer to a robot that is (gap_x, gap_y) away."""
    mx, my, wide = disc(params, gx, gy)
    far = math.sqrt(gap_x * gap_x + gap_y * gap_y)
    return float(wide + (mx * gap_x + my * gap_y) / far) if far > 0.0 else wide


@kernel
def fair_mps(params: Params, gap_x: float, gap_y: float) -> float:
    """How fast each of two robots may come nearer, so that in a promise's time both stay in their share of the room."""
    room = math.sqrt(gap_x * gap_x + gap_y * gap_y) - params[guard_law.APART]
    return float(0.5 * SHARED * max(0.0, room) / (params[guard_law.PROMISE_MS] * 1e-3))


@kernel
def reach(
    params: Params, place: tuple[float, float], said: tuple[float, float], known_s: float
) -> tuple[float, float, float]:
    """Return where a robot can be whose reading at `place` is `known_s` old at most: a middle, and how far from it, m.

    With its body's room and the creep of its brakes. A promise holds for `promise_ms`; then the envelope's speed does.
    """
    kept_s = min(known_s, params[guard_law.PROMISE_MS] * 1e-3)
    mx, my, wide = disc(params, said[0], said[1])
    creep = guard_law.CREEP * params[guard_law.ACCEL] * params[guard_law.HELD_S] * params[guard_law.HELD_S]
    far = params[guard_law.APART] + creep + wide * kept_s + params[guard_law.SPEED] * (known_s - kept_s)
    return place[0] + mx * kept_s, place[1] + my * kept_s, far


@kernel
def make(params: Params, t_ms: int, state: Row, gx: float, gy: float) -> tuple[float, float]:
    """Promise g and remember it, or extend the newest promise if too many still hold; return what is said."""
    if not exceeds_envelope(params, gx, gy):
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
    return _said(state, at)
