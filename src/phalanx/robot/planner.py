"""Planners advise guarded robots, and the guard decides (docs/guard.md).

A planner is any program: it may use chance, a clock, a network, a learned policy. Nobody replays it; only its advice
is in the log.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from phalanx.wire.guarded import KIND_WISH, WISH
from phalanx.wire.record import LARGEST_F32
from phalanx.wire.table import KIND_STATE, SENSOR, STATE

from .controllers.python_controller import OwnMistake, kind_of

Pair = tuple[float, float]
MakePlanner = Callable[[int, Pair], "Planner"]


class Planner(ABC):
    """An adviser of one robot.

    Args:
        rob_id: 1..65535.
        goal_m: where the scenario would have it go, x and y.
    """

    def __init__(self, rob_id: int, goal_m: Pair) -> None:
        self.rob_id, self.goal_m = rob_id, goal_m

    @abstractmethod
    def advise(self, t_s: float, position_m: Pair, velocity_mps: Pair) -> Sequence[float] | None:
        """Return the velocity that it wants, m/s, x and y, or None; called at each reading, `t_s` its time.

        Two numbers are advice whatever they are: the guard shortens what is too fast, and ignores NaN and infinity.
        """

    def hear(self, t_s: float, rob_id: int, position_m: Pair, velocity_mps: Pair) -> None:  # noqa: B027 - may not care
        """Another robot says where it is and where it goes; it may lie."""


class ToGoal(Planner):
    """Straight to the goal, slower near it: an honest planner that does not look where it goes."""

    def advise(self, _t_s: float, position_m: Pair, _velocity_mps: Pair) -> Sequence[float]:
        """Return the way to the goal as a velocity; the guard knows how fast that may be."""
        return [to - at for to, at in zip(self.goal_m, position_m, strict=True)]


def advice_of(planner: Planner, t_ms: int, reading: bytes) -> bytes:
    """Return a planner's advice on a reading, as it is logged; b"" for nothing.

    Raises: OwnMistake: it returned something else. What the planner raises goes on to the caller.
    """
    if len(reading) != SENSOR.size:
        return b""
    _, _, _, x, y, vx, vy = SENSOR.form.unpack(reading)
    told = planner.advise(t_ms / 1000, (x, y), (vx, vy))
    if told is None:
        return b""
    try:
        wished = [float(number) for number in told]
    except (TypeError, ValueError):
        wished = []
    if len(wished) != 2:
        hint = "two numbers, m/s along x and y, or None"
        raise OwnMistake(f"advise returned {kind_of(told)}", hint, planner, "advise")
    return WISH.form.pack(KIND_WISH, *_as_f32(*wished))


def overheard(planner: Planner, t_ms: int, frame: bytes) -> None:
    """Pass a broadcast to a planner, if it is a robot's state."""
    if len(frame) == STATE.size and frame[0] == KIND_STATE:
        _, rob_id, _, x, y, vx, vy = STATE.form.unpack(frame)
        planner.hear(t_ms / 1000, rob_id, (x, y), (vx, vy))


def _as_f32(x: float, y: float) -> Pair:
    """Return the vector, or one in its direction if an f32 does not hold it: `struct` refuses that."""
    largest = max(abs(x), abs(y))
    if not LARGEST_F32 < largest < math.inf:
        return x, y
    return x / largest * LARGEST_F32, y / largest * LARGEST_F32
