"""What a mission says of a flock: the paper's Table 3, and what it leaves to the mission."""

from __future__ import annotations

import math
from dataclasses import dataclass

from phalanx.errors import UsageError

FARTHEST_M = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Disc:
    """A round obstacle."""

    x_m: float
    y_m: float
    radius_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """An obstacle with its sides along the axes; a thin one is a wall."""

    left_m: float
    bottom_m: float
    right_m: float
    top_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FlockConfig:
    """Parameters of Olfati-Saber flocking; the paper's values where it has one.

    Args:
        goal_m: where the flock goes, x and y.
        d_m: spacing that neighbours keep.
        kappa: r / d; neighbours farther than r do not act.
        epsilon: of the sigma-norm.
        a, b: of the action function, a <= b: with a > b robots at the right spacing would push each other.
        h_alpha, h_beta: where the bump begins to fall, for neighbours and for obstacles.
        c1_alpha, c2_alpha: spring and damper between neighbours.
        c1_beta, c2_beta: of obstacles; 0 in the paper, which evaluates without.
        c1_gamma, c2_gamma: of the goal. The paper prints them negative and adds; we subtract.
        limit_mps2: largest acceleration along each axis.
        n_max: neighbours that a robot remembers; rows of state are made for `BtiConfig.n_max`, so not more than that.
        forget_ms: a neighbour not heard for longer does not act; three broadcasts, so that two may be lost in a row.
        state_every: broadcast at each so manieth control step; the paper's 1.5 s over 0.25 s.
        discs, boxes: obstacles.
    Raises: UsageError: a value is out of range.
    Source: RoboRebound appendix A, Table 3; §4 (the limit, the periods).
    """

    goal_m: tuple[float, float] = (500.0, 500.0)
    d_m: float = 20.0
    kappa: float = 1.2
    epsilon: float = 0.1
    a: float = 5.0
    b: float = 5.0
    h_alpha: float = 0.2
    h_beta: float = 0.9
    c1_alpha: float = 0.005
    c2_alpha: float = 0.05
    c1_beta: float = 0.0
    c2_beta: float = 0.0
    c1_gamma: float = 0.001
    c2_gamma: float = 0.06
    limit_mps2: float = 5.0
    n_max: int = 24
    forget_ms: int = 4500
    state_every: int = 6
    discs: tuple[Disc, ...] = ()
    boxes: tuple[Box, ...] = ()

    def __post_init__(self) -> None:
        for name, value in (("goal_m", self.goal_m[0]), ("goal_m", self.goal_m[1])):
            _within(name, value, -FARTHEST_M, FARTHEST_M)
        _within("d_m", self.d_m, 0.01, 1e4)
        _within("kappa", self.kappa, 1.0, 100.0)
        _within("epsilon", self.epsilon, 1e-6, 1.0)
        _within("b", self.b, 1e-6, 1e6)
        _within("a", self.a, 1e-6, self.b)
        for name in ("h_alpha", "h_beta"):
            _within(name, getattr(self, name), 0.0, 0.999)
        for name in ("c1_alpha", "c2_alpha", "c1_beta", "c2_beta", "c1_gamma", "c2_gamma"):
            _within(name, getattr(self, name), 0.0, 1e3)
        _within("limit_mps2", self.limit_mps2, 0.0, 1e3)
        _within("n_max", self.n_max, 1, 1024)
        _within("forget_ms", self.forget_ms, 1, 86_400_000)
        _within("state_every", self.state_every, 1, 1000)
        for disc in self.discs:
            _within("disc's middle", max(abs(disc.x_m), abs(disc.y_m)), 0.0, FARTHEST_M)
            _within("radius_m", disc.radius_m, 0.0, FARTHEST_M)
        for box in self.boxes:
            _within("right_m", box.right_m, box.left_m, FARTHEST_M)
            _within("top_m", box.top_m, box.bottom_m, FARTHEST_M)
            _within("box's corner", max(abs(box.left_m), abs(box.bottom_m)), 0.0, FARTHEST_M)
        if (self.discs or self.boxes) and self.c1_beta == self.c2_beta == 0.0:
            raise UsageError("obstacles, but nobody avoids them", "set c1_beta and c2_beta above 0")


def _within(name: str, value: float, low: float, high: float) -> None:
    # Written so that NaN fails.
    if not (math.isfinite(value) and low <= value <= high):
        raise UsageError(f"{name} is {value:g}", f"{low:g} to {high:g}")
