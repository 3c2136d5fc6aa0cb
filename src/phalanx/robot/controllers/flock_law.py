"""The flocking law of Olfati-Saber: accelerations as numbers; bundled/flock.py encodes them.

Each term avoids division by zero, and has a fixed order of floating-point operations. Equation numbers are those of
Olfati-Saber 2006.
"""

from __future__ import annotations

import math

import numpy as np

from phalanx.arrays import Params
from phalanx.config.flock import FlockConfig
from phalanx.kernel import kernel
from phalanx.wire.fields import whole

from .sine import HALF_PI, sine

# Indices of the parameters; the obstacles follow, three numbers per disc, four per box.
N_MAX, FORGET_MS, STATE_EVERY, LIMIT, GOAL_X, GOAL_Y = 0, 1, 2, 3, 4, 5
EPSILON, A, B, C, H_ALPHA, H_BETA = 6, 7, 8, 9, 10, 11
R_SQUARED, R_NORM, D_NORM, D_BETA_NORM = 12, 13, 14, 15
C1_ALPHA, C2_ALPHA, C1_BETA, C2_BETA, C1_GAMMA, C2_GAMMA = 16, 17, 18, 19, 20, 21
PUSH, DISCS, BOXES, OBSTACLES = 22, 23, 24, 25
# Relative speed for the largest damping term of one neighbour, which limits the sum of neighbours' terms (`crowd`).
PACE_MPS = 1.0


def flock_params(config: FlockConfig) -> Params:
    """Return the mission's parameters for kernels: 25 numbers, then the obstacles. Source: Table 3; eq. 8, 15.

    An obstacle acts within d' = 0.5 kappa d, where its bump function ends: the paper's r' = kappa d' has no effect.
    Table 3 prints c = |a - b| / sqrt(4 a b) without bars: with a < b, robots at distance d would then exert a force.
    """
    radius = config.kappa * config.d_m
    head = (
        config.n_max,
        config.forget_ms,
        config.state_every,
        config.limit_mps2,
        *config.goal_m,
        config.epsilon,
        config.a,
        config.b,
        abs(config.a - config.b) / math.sqrt(4.0 * config.a * config.b),
        config.h_alpha,
        config.h_beta,
        radius * radius,
        _sigma_norm(radius, config.epsilon),
        _sigma_norm(config.d_m, config.epsilon),
        _sigma_norm(0.5 * radius, config.epsilon),
        config.c1_alpha,
        config.c2_alpha,
        config.c1_beta,
        config.c2_beta,
        config.c1_gamma,
        config.c2_gamma,
        config.crowd * max(config.c1_alpha * config.b / math.sqrt(config.epsilon), config.c2_alpha * PACE_MPS),
        len(config.discs),
        len(config.boxes),
    )
    discs = [number for disc in config.discs for number in (disc.x_m, disc.y_m, disc.radius_m)]
    boxes = [number for box in config.boxes for number in (box.left_m, box.bottom_m, box.right_m, box.top_m)]
    return np.array([*head, *discs, *boxes], dtype=np.float64)


def _sigma_norm(length: float, epsilon: float) -> float:
    return (math.sqrt(1.0 + epsilon * length * length) - 1.0) / epsilon


@kernel
def neighbour_push(params: Params, dx: float, dy: float, dvx: float, dvy: float) -> tuple[float, float]:
    """Return the acceleration by a neighbour at relative position and velocity. Source: eq. 9, 15, 59 (alpha)."""
    gap_squared = dx * dx + dy * dy
    if gap_squared >= params[R_SQUARED]:
        return 0.0, 0.0
    root = math.sqrt(1.0 + params[EPSILON] * gap_squared)
    norm = (root - 1.0) / params[EPSILON]
    weight = bump(norm / params[R_NORM], params[H_ALPHA])
    slack = norm - params[D_NORM] + params[C]
    a, b = params[A], params[B]
    action = 0.5 * ((a + b) * (slack / math.sqrt(1.0 + slack * slack)) + (a - b))
    spring = params[C1_ALPHA] * weight * action / root
    damper = params[C2_ALPHA] * weight
    return spring * dx + damper * dvx, spring * dy + damper * dvy


@kernel
def obstacles_push(params: Params, x: float, y: float, vx: float, vy: float) -> tuple[float, float]:
    """Return the acceleration by all obstacles; each acts as a robot at its nearest point, moving along (eq. 53).

    Inside an obstacle, which the paper does not define, the nearest point is mirrored, so that the force points out.
    """
    ax, ay = 0.0, 0.0
    at = OBSTACLES
    for _ in range(whole(params[DISCS])):
        from_x, from_y = x - params[at], y - params[at + 1]
        away = math.sqrt(from_x * from_x + from_y * from_y)
        if away > 0.0:
            ratio = params[at + 2] / away
            gap = -abs(1.0 - ratio)
            nx, ny = from_x / away, from_y / away
            sideways = ratio * (vy * nx - vx * ny)
            push_x, push_y = _wall_push(params, gap * from_x, gap * from_y, -sideways * ny - vx, sideways * nx - vy)
            ax += push_x
            ay += push_y
        at += 3
    for _ in range(whole(params[BOXES])):
        dx, dy = _to_box(x, y, params[at], params[at + 1], params[at + 2], params[at + 3])
        # Along a side the nearest point moves with the robot; at a corner (a disc of radius 0) it stands still.
        along_x = vx if dx == 0.0 else 0.0
        along_y = vy if dy == 0.0 else 0.0
        push_x, push_y = _wall_push(params, dx, dy, along_x - vx, along_y - vy)
        ax += push_x
        ay += push_y
        at += 4
    return ax, ay


@kernel
def _to_box(x: float, y: float, left: float, bottom: float, right: float, top: float) -> tuple[float, float]:
    """Return the vector from (x, y) to the nearest point of a box; from inside, the negated vector to that point."""
    dx = left - x if x < left else (right - x if x > right else 0.0)
    dy = bottom - y if y < bottom else (top - y if y > top else 0.0)
    if dx != 0.0 or dy != 0.0:
        return dx, dy
    in_x = x - left if x - left < right - x else x - right
    in_y = y - bottom if y - bottom < top - y else y - top
    if abs(in_x) < abs(in_y):
        return in_x, 0.0
    return 0.0, in_y


@kernel
def _wall_push(params: Params, dx: float, dy: float, dvx: float, dvy: float) -> tuple[float, float]:
    root = math.sqrt(1.0 + params[EPSILON] * (dx * dx + dy * dy))
    norm = (root - 1.0) / params[EPSILON]
    weight = bump(norm / params[D_BETA_NORM], params[H_BETA])
    if weight == 0.0:
        return 0.0, 0.0
    slack = norm - params[D_BETA_NORM]
    action = slack / math.sqrt(1.0 + slack * slack) - 1.0
    spring = params[C1_BETA] * weight * action / root
    damper = params[C2_BETA] * weight
    return spring * dx + damper * dvx, spring * dy + damper * dvy


@kernel
def goal_pull(params: Params, x: float, y: float, vx: float, vy: float) -> tuple[float, float]:
    """Return the acceleration to the goal. It is linear: a saturated one moves robots 2 m in 150 s. Source: Table 3."""
    spring, damper = params[C1_GAMMA], params[C2_GAMMA]
    return spring * (params[GOAL_X] - x) - damper * vx, spring * (params[GOAL_Y] - y) - damper * vy


@kernel
def bump(z: float, h: float) -> float:
    """Return the bump function, eq. 10: 1 up to h, 0 from 1 on, and sin(pi (1 - u) / 2)² between, u from 0 to 1."""
    if z < h:
        return 1.0
    if z >= 1.0:
        return 0.0
    root = sine(HALF_PI * ((1.0 - z) / (1.0 - h)))
    return root * root


@kernel
def limited(value: float, limit: float) -> float:
    """Return `value` clamped to +-limit. Source: RoboRebound §4."""
    if value > limit:
        return limit
    if value < -limit:
        return -limit
    return value
