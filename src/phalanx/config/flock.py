"""Parameters of a flock (the paper's Table 3), and of robots that visitors drive."""

from __future__ import annotations

from dataclasses import dataclass

from phalanx.errors import UsageError

from .parameter import check_limits, check_within, within

FARTHEST_M = 1e6
# As the paper's law has it: as hard as it comes.
NO_CROWD = 1e6
KEY_BYTES = 32  # of an Ed25519 public key


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

    Raises: UsageError: a value is out of range. Source: RoboRebound appendix A, Table 3; §4 (the limit, the periods).
    """

    goal_m: tuple[float, float] = (500.0, 500.0)  # where the flock goes, x and y
    d_m: float = within(20.0, 0.01, 1e4, "spacing that neighbours keep")
    kappa: float = within(1.2, 1.0, 100.0, "r / d; neighbours farther than r do not act")
    epsilon: float = within(0.1, 1e-6, 1.0, "of the sigma-norm")
    a: float = within(
        5.0, 1e-6, 1e6, "of the action function, at most b: else robots at the right spacing would push each other"
    )
    b: float = within(5.0, 1e-6, 1e6, "of the action function")
    h_alpha: float = within(0.2, 0.0, 0.999, "where the bump begins to fall, for neighbours")
    h_beta: float = within(0.9, 0.0, 0.999, "where the bump begins to fall, for obstacles")
    c1_alpha: float = within(0.005, 0.0, 1e3, "spring between neighbours")
    c2_alpha: float = within(0.05, 0.0, 1e3, "damper between neighbours")
    c1_beta: float = within(0.0, 0.0, 1e3, "spring of obstacles; 0 in the paper, which evaluates without")
    c2_beta: float = within(0.0, 0.0, 1e3, "damper of obstacles")
    c1_gamma: float = within(0.001, 0.0, 1e3, "spring of the goal. The paper prints it negative and adds; we subtract")
    c2_gamma: float = within(0.06, 0.0, 1e3, "damper of the goal, likewise")
    crowd: float = within(
        4.0,
        0.0,
        NO_CROWD,
        "all neighbours together push no harder than so many do, each at its hardest (`hardened`;"
        " less if T_val is above 10 s)",
    )
    limit_mps2: float = within(5.0, 0.0, 1e3, "largest acceleration along each axis")
    n_max: int = within(24, 1, 1024, "neighbours that a robot remembers: not more than BtiConfig.n_max, made as rows")
    forget_ms: int = within(
        4500, 1, 86_400_000, "a neighbour not heard for longer does not act; as three broadcasts, two may be lost"
    )
    state_every: int = within(6, 1, 1000, "broadcast at each so manieth control step; the paper's 1.5 s over 0.25 s")
    discs: tuple[Disc, ...] = ()  # obstacles
    boxes: tuple[Box, ...] = ()

    def __post_init__(self) -> None:
        for value in self.goal_m:
            check_within("goal_m", value, -FARTHEST_M, FARTHEST_M)
        check_limits(self)
        check_within("a", self.a, 1e-6, self.b)
        for disc in self.discs:
            check_within("disc's middle", max(abs(disc.x_m), abs(disc.y_m)), 0.0, FARTHEST_M)
            check_within("radius_m", disc.radius_m, 0.0, FARTHEST_M)
        for box in self.boxes:
            check_within("right_m", box.right_m, box.left_m, FARTHEST_M)
            check_within("top_m", box.top_m, box.bottom_m, FARTHEST_M)
            check_within("box's corner", max(abs(box.left_m), abs(box.bottom_m)), 0.0, FARTHEST_M)
        if (self.discs or self.boxes) and self.c1_beta == self.c2_beta == 0.0:
            raise UsageError("obstacles, but nobody avoids them", "set c1_beta and c2_beta above 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelsConfig:
    """Parameters of robots on two wheels that visitors drive.

    Raises: UsageError: a value is out of range.
    Source: docs/spec/vocabulary.md (300 ms); RoboRebound §4 (the periods); docs/spec/orders.md (whom they obey).
    """

    good_ms: int = within(300, 1, 60_000)  # a joystick's word is obeyed for so long, then the wheels stop
    state_every: int = within(6, 1, 1000)  # broadcast at each so manieth control step
    mission: int = within(1, 1, 2**32 - 1)  # its number, as the mission key has it: orders of another are not obeyed
    # Signatures looked at from one reading to the next: true ones are one or two. Of false ones a compromised robot's
    # a-node lets out two at once, and then not two a second (`hardened`).
    looks: int = within(16, 1, 255)
    gateway_key: bytes = b""  # Ed25519, public: who may give orders; empty for nobody
    operator_key: bytes = b""  # the same

    def __post_init__(self) -> None:
        check_limits(self)
        for name in ("gateway_key", "operator_key"):
            if len(getattr(self, name)) not in (0, KEY_BYTES):
                raise UsageError(f"{name} has {len(getattr(self, name))} bytes", f"an Ed25519 public key, {KEY_BYTES}")
