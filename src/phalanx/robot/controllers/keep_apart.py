"""Collision avoidance of robots on wheels by the positions of robots nearby.

A reading ends with the relative positions of the nearest robots, as the s-node senses them. A robot never drives
towards one that is too near, even by joystick. On its own work or on a route, it drives around others. It can be
replayed bit for bit: only + - * / and sqrt on floats.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from phalanx.robot.follow import percent
from phalanx.wire.driven import ROBOT_NEARBY

SEEN = 4  # nearest robots in a reading
RANGE_MM = 450.0
NEAR_BYTES = SEEN * ROBOT_NEARBY.size
# Distances between centres. A body has 80 mm; in a control step of 0.1 s two robots approach by up to 60 mm.
STOP_MM, SLOW_MM = 130.0, 240.0
BESIDE_MM = 95.0  # lateral distance at which a robot can be passed
AROUND_MM = 320.0  # distance at which an autonomous robot begins to turn away

Offset = tuple[float, float]


def encode_near(at_m: tuple[float, float], others_m: Sequence[tuple[float, float]]) -> bytes:
    """Return the end of a reading: the nearest of `others_m` within range, nearest first."""
    offsets = [((x - at_m[0]) * 1000, (y - at_m[1]) * 1000) for x, y in others_m]
    near = sorted((dx * dx + dy * dy, dx, dy) for dx, dy in offsets)[:SEEN]
    seen = [ROBOT_NEARBY.form.pack(round(dx), round(dy)) for squared, dx, dy in near if squared <= RANGE_MM * RANGE_MM]
    return b"".join(seen).ljust(NEAR_BYTES, b"\0")


def decode_near(near: bytes) -> list[Offset]:
    """Return the relative positions of robots nearby, mm; [] for an invalid encoding."""
    if len(near) != NEAR_BYTES:
        return []
    return [(float(dx), float(dy)) for dx, dy in ROBOT_NEARBY.form.iter_unpack(near) if dx or dy]


def go_around(goal_mm: Offset, near_mm: Sequence[Offset]) -> Offset:
    """Return the direction towards a goal and around robots nearby; robots ahead are kept on the left.

    Two robots that meet turn to the same side, so that neither waits for the other.
    """
    length = math.sqrt(goal_mm[0] * goal_mm[0] + goal_mm[1] * goal_mm[1])
    if length < 1e-6:
        return goal_mm
    x, y = goal_mm[0] / length, goal_mm[1] / length
    for dx, dy, away in _within(near_mm, min(AROUND_MM, length + STOP_MM)):
        ahead = (dx * goal_mm[0] + dy * goal_mm[1]) / (length * away)
        push = (AROUND_MM - away) / (AROUND_MM - BESIDE_MM)
        turn = 1.5 * push * max(0.0, ahead)
        x += -0.6 * push * dx / away - turn * dy / away
        y += -0.6 * push * dy / away + turn * dx / away
    now = math.sqrt(x * x + y * y)
    return (x / now * length, y / now * length) if now > 1e-6 else (-goal_mm[1], goal_mm[0])


def restrain(left: int, right: int, sin: float, cos: float, near_mm: Sequence[Offset]) -> tuple[int, int]:
    """Return wheel speeds, percent, that do not drive towards a robot nearby; turning on the spot is unchanged.

    `sin` and `cos` are those of the direction; the robot's front points along (-sin, cos).
    """
    speed, turn = (left + right) / 2, (left - right) / 2
    if speed == 0.0:
        return left, right
    way, share = (1.0 if speed > 0.0 else -1.0), 1.0
    for dx, dy, away in _within(near_mm, SLOW_MM):
        ahead, aside = way * (dy * cos - dx * sin), dx * cos + dy * sin
        if ahead > 0.0 and (-BESIDE_MM < aside < BESIDE_MM or away < STOP_MM):
            share = min(share, max(0.0, (away - STOP_MM) / (SLOW_MM - STOP_MM)))
    speed *= share
    return percent(int(speed + turn)), percent(int(speed - turn))


def _within(near_mm: Sequence[Offset], range_mm: float) -> Iterator[tuple[float, float, float]]:
    for dx, dy in near_mm:
        away = math.sqrt(dx * dx + dy * dy)
        if 0.0 < away < range_mm:
            yield dx, dy, away
