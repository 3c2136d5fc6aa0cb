"""Parameters of flocks (RoboRebound, Table 3), and of robots that visitors drive."""

from __future__ import annotations

from dataclasses import dataclass

from phalanx.errors import UsageError

from .parameter import check_limits, check_within, within

FARTHEST_M = 1e6
# A `crowd` of no effect: the paper's law has no limit on the sum of neighbours' forces.
NO_CROWD = 1e6
KEY_BYTES = 32  # of an Ed25519 public key


@dataclass(frozen=True, slots=True, kw_only=True)
class Disc:
    """Round obstacle."""

    x_m: float
    y_m: float
    radius_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """Rectangular obstacle with sides parallel to the axes; a thin one is a wall."""

    left_m: float
    bottom_m: float
    right_m: float
    top_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FlockConfig:
    """Parameters of Olfati-Saber flocking; the defaults are the paper's where it gives one.

    Raises: UsageError: a value is out of range. Source: RoboRebound appendix A, Table 3; §4 (the limit, the periods).
    """

    goal_m: tuple[float, float] = (500.0, 500.0)  # where the flock goes, x and y
    d_m: float = within(20.0, 0.01, 1e4, "spacing that neighbours keep")
    kappa: float = within(1.2, 1.0, 100.0, "r / d; neighbours farther than r have no effect")
    epsilon: float = within(0.1, 1e-6, 1.0, "parameter of the sigma-norm")
    a: float = within(
        5.0, 1e-6, 1e6, "parameter of the action function, at most b: otherwise neighbours at distance d exert a force"
    )
    b: float = within(5.0, 1e-6, 1e6, "parameter of the action function")
    h_alpha: float = within(0.2, 0.0, 0.999, "where the bump function begins to fall, for neighbours")
    h_beta: float = within(0.9, 0.0, 0.999, "where the bump function begins to fall, for obstacles")
    c1_alpha: float = within(0.005, 0.0, 1e3, "spring constant between neighbours")
    c2_alpha: float = within(0.05, 0.0, 1e3, "damping between neighbours")
    c1_beta: float = within(0.0, 0.0, 1e3, "spring constant of obstacles; 0 in the paper, which evaluates without any")
    c2_beta: float = within(0.0, 0.0, 1e3, "damping of obstacles")
    c1_gamma: float = within(0.001, 0.0, 1e3, "spring constant of the goal; positive, where the paper prints minus")
    c2_gamma: float = within(0.06, 0.0, 1e3, "damping of the goal; positive, where the paper prints minus")
    crowd: float = within(
        4.0,
        0.0,
        NO_CROWD,
        "limit of the sum of neighbours' forces, in units of the largest force of one (`hardened`;"
        " smaller if T_val is above 10 s)",
    )
    limit_mps2: float = within(5.0, 0.0, 1e3, "largest acceleration along each axis")
    n_max: int = within(24, 1, 1024, "neighbours that a robot stores; at most BtiConfig.n_max")
    forget_ms: int = within(
        4500,
        1,
        86_400_000,
        "silence after which a neighbour is ignored; 4.5 s are three broadcasts, of which two may be lost",
    )
    state_every: int = within(6, 1, 1000, "control steps per state broadcast; 6 are the paper's 1.5 s over 0.25 s")
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
            raise UsageError("obstacles have no effect: c1_beta and c2_beta are 0", "set c1_beta and c2_beta above 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelsConfig:
    """Parameters of two-wheeled robots that visitors drive.

    Raises: UsageError: a value is out of range.
    Source: docs/spec/vocabulary.md (300 ms); RoboRebound §4 (the periods); docs/spec/orders.md (signed orders).
    """

    good_ms: int = within(300, 1, 60_000)  # lifetime of a joystick order, after which the wheels stop
    state_every: int = within(6, 1, 1000)  # control steps per state broadcast
    mission: int = within(1, 1, 2**32 - 1)  # number of the mission key; orders for other missions are ignored
    # Signatures verified per control period. Valid orders need one or two. The a-node of a compromised robot limits
    # forged ones to two at once and less than two per second (`hardened`).
    looks: int = within(16, 1, 255)
    gateway_key: bytes = b""  # public Ed25519 key of the gateway, whose orders are accepted; empty: none
    operator_key: bytes = b""  # public Ed25519 key of the operator, likewise

    def __post_init__(self) -> None:
        check_limits(self)
        for name in ("gateway_key", "operator_key"):
            if len(getattr(self, name)) not in (0, KEY_BYTES):
                raise UsageError(
                    f"{name} has {len(getattr(self, name))} bytes", f"an Ed25519 public key has {KEY_BYTES} bytes"
                )
