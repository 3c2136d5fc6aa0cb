"""A scenario: the settings of a run, which decide every byte of a simulation, with the seed."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from numbers import Integral
from typing import Any, Literal, TypeVar, get_args

from phalanx.config import BtiConfig
from phalanx.config.bti import NEIGHBOUR_BYTES, quorum_of
from phalanx.config.defence import DEFENCES, Defence
from phalanx.config.flock import FARTHEST_M, Box, Disc, FlockConfig
from phalanx.config.guard import GuardConfig
from phalanx.config.parameter import check_key, check_limits, check_within, described, description, limits_in, within
from phalanx.config.radio import RadioConfig
from phalanx.errors import UsageError, did_you_mean
from phalanx.robot.adversary.registry import swarm_attacks
from phalanx.robot.controllers.declaration import OWN, bundled
from phalanx.robot.controllers.protocol import Task, protocols
from phalanx.wire.driven import SIGNER_KEY_BYTES
from phalanx.wire.guarded import GUARD_MEMORY, SIGNED_BYTES, WISH

from .attack_spec import LONGEST_S, AttackSpec

PROTOCOLS = tuple(protocols())  # in plain Python
CONTROLLERS = (*bundled(), *PROTOCOLS)
GUARD = "guard"  # the one that planners advise
WHEELS = "wheels"  # the one that obeys orders
Formation = Literal["grid", "line", "ring", "islands"]
MOST_ROBOTS = 65_535
# A log of more neighbours does not fit into a request. The channel is full at 130 already.
MOST_NEIGHBOURS = 340
# A flock that closes up has more neighbours than its grid: n_max is so many times as large, and a few more.
CLOSER, SPARE = 1.5, 4
_Obstacle = TypeVar("_Obstacle", Disc, Box)
ROWS = ("line", "ring")  # formations of a single row
# Room for orders in the log of a robot on wheels, as many bytes as so many neighbours broadcast.
ORDERS_AS_NEIGHBOURS = 40
MOST_AREA_M = 65.0  # a waypoint is 16 bits of millimetres


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """A swarm: where it starts, its task, which robots lie, and its defence; `flock` and `bti` are adapted to these.

    Raises: UsageError: a value is out of range, or two contradict each other.
    Source: RoboRebound §4, §5.2, §5.3; docs/reference/scenarios.md.
    """

    name: str = described("", "what it is called")
    about: str = described("", "what it shows, in a line")
    robots: int = described(25, "on a square grid, ids 1.. row by row from the corner at the origin")
    formation: Formation = described(  # noqa: RUF009 - made a field
        "grid", "or in a line, in a ring, or on two grids, the second a step out of the first one's hearing"
    )
    grid_step_m: float = within(25.0, 0.01, 1e4, "between two robots of the grid, the line or the ring")
    d_m: float = described(20.0, "spacing that the flock keeps")
    goal_m: tuple[float, float] = described((500.0, 500.0), "where it goes")
    duration_s: float = within(150.0, 0.1, LONGEST_S, "simulated time")
    defence: Defence = described(  # noqa: RUF009 - made a field
        "hardened",
        "none: nothing stops compromised robots; paper: RoboRebound as printed; hardened: ours",
    )
    controller: str = described("flock", "what honest robots run")
    seed: int = described(0, "chooses broadcasts' phases, back-offs, and robots to compromise")
    attacks: tuple[AttackSpec, ...] = described((), "at most one a robot")
    obstacles: tuple[Disc | Box, ...] = described(
        (), "on the ground; the flock must be told to avoid them (c1_beta, c2_beta)"
    )
    area_m: tuple[float, float] = described((2.0, 2.0), "what robots on wheels stay within")
    gateway_key: str = described("", "whose orders robots on wheels obey: Ed25519, public, 64 hexadecimal digits")
    operator_key: str = described("", "whose stop they obey, the same")
    order_looks: int = within(16, 1, 255, "so many orders' signatures they look at from one reading to the next")
    contact_m: float = within(1.0, 0.0, 1e3, "two robots as near as that touch")
    n_max: int | None = described(None, "neighbours provided for; None for what grid and radio's range come to")
    hub: int = described(
        0,
        "so many robots, the first, stand where aisles meet: the others, each in its aisle, hear them alone; "
        "0: all hear all in range",
    )
    bti: BtiConfig = field(default_factory=BtiConfig, metadata=description("parameters of the audits"))
    flock: FlockConfig = field(default_factory=FlockConfig, metadata=description("parameters of the controller"))
    guard: GuardConfig = field(default_factory=GuardConfig, metadata=description("envelope of the controller guard"))
    radio: RadioConfig = field(default_factory=RadioConfig, metadata=description("parameters of the radio"))

    def __post_init__(self) -> None:
        for name in ("robots", "seed", "hub"):
            if not isinstance(getattr(self, name), Integral):
                raise UsageError(f"{name} is {getattr(self, name)!r}", "a whole number")
        if not all(isinstance(each, AttackSpec) for each in self.attacks):
            raise UsageError(f"attacks are {self.attacks!r}", "a tuple of AttackSpec")
        if not 1 <= self.robots <= MOST_ROBOTS:
            raise UsageError(f"{self.robots} robots", f"1 to {MOST_ROBOTS}")
        if not 0 <= self.hub <= self.robots:
            raise UsageError(f"hub is {self.hub}", f"0 to {self.robots}, as there are robots")
        check_limits(self)
        if self.formation not in get_args(Formation):
            raise _none_such("formation", self.formation, get_args(Formation))
        row = self.robots if self.formation in ROWS else self.robots_per_edge
        check_within("the grid's edge", self.grid_step_m * (row - 1), 0.0, FARTHEST_M)
        if self.defence not in DEFENCES:
            raise _none_such("defence", self.defence, DEFENCES)
        if self.controller not in CONTROLLERS and self.controller not in OWN:
            raise _no_controller(self.controller)
        if not 0 <= self.seed < 1 << 32:
            raise UsageError(f"seed is {self.seed}", "0 to 4294967295")
        self._check_driven()
        self._check_attacks()
        self._agree()

    def _agree(self) -> None:
        n_max = self._neighbours() if self.n_max is None else self.n_max
        guarded = self.controller == GUARD
        advised = OWN[self.controller].advised if self.controller in OWN else None
        sizes = {"advice_bytes": advised.size if advised else 0}
        if guarded:
            signed = bool(self.guard.adviser_key)
            key_bytes = SIGNER_KEY_BYTES * signed  # behind what a guard remembers
            sizes["advice_bytes"] = SIGNED_BYTES if signed else WISH.size
            sizes["state_bytes"] = GUARD_MEMORY.size + NEIGHBOUR_BYTES * n_max + key_bytes
        bti = replace(self.bti, n_max=n_max, **sizes)
        object.__setattr__(self, "bti", bti)
        object.__setattr__(self, "flock", self._flock(bti))
        if guarded:
            object.__setattr__(self, "guard", self._guard(bti))

    @property
    def robots_per_edge(self) -> int:
        """Return how many robots a row of the grid has, or of the larger of two grids; the last may be shorter."""
        return math.isqrt(self.grids[0] - 1) + 1

    @property
    def starts_m(self) -> list[tuple[float, float]]:
        """Return N places, where the robots stand at first. Raises: UsageError: wheels do not fit into their area."""
        n, step_m, row = self.robots, self.grid_step_m, self.robots_per_edge
        if self.controller == WHEELS:
            corner_m = [(side_m - step_m * (row - 1)) / 2 for side_m in self.area_m]
            if min(corner_m) <= 0:
                raise UsageError(f"area_m has no room for {n} robots", "a larger one, or a smaller grid_step_m")
            return [(corner_m[0] + i % row * step_m, corner_m[1] + i // row * step_m) for i in range(n)]
        if self.formation == "ring":
            radius_m, turn = step_m / 2 / math.sin(math.pi / max(n, 2)), math.tau / n
            around = [(math.cos(i * turn), math.sin(i * turn)) for i in range(n)]
            # To the millimetre: a cosine's last bit differs between machines.
            return [(round(radius_m * (1 + x), 3), round(radius_m * (1 + y), 3)) for x, y in around]
        edge = n if self.formation == "line" else row
        apart_m = edge * step_m + math.ceil(self.radio.range_m)
        return [
            (i % edge * step_m + nth * apart_m, i // edge * step_m)
            for nth, robots in enumerate(self.grids)
            for i in range(robots)
        ]

    @property
    def task(self) -> Task:
        """Return the task of a protocol's robots."""
        return Task(
            starts_m=tuple(self.starts_m),
            step_m=self.grid_step_m,
            boxes=_of_kind(Box, self.obstacles),
            seed=self.seed,
            control_ms=self.bti.t_control_ms,
            state_every=self.bti.steps_per_state,
            doubt_ms=self.bti.stop_bound_ms(output_missing=True),
        )

    @property
    def grids(self) -> tuple[int, ...]:
        """Return how many robots stand on each grid."""
        half = self.robots // 2
        return (self.robots - half, half) if self.formation == "islands" else (self.robots,)

    @property
    def robots_in_range(self) -> float:
        """Return how many robots a robot in the middle can hear, itself included, while the grid keeps its step."""
        steps = self.radio.range_m / self.grid_step_m
        return min(1 + 2 * steps if self.formation in ROWS else math.pi * steps**2, self.robots)

    def drawn_attacks(self) -> tuple[AttackSpec, ...]:
        """Return the attacks with their robots, no two the same: ranked by SHA-256, the same with any library."""
        named = {attack.robot for attack in self.attacks}

        def rank(robot: int) -> bytes:
            return hashlib.sha256(f"compromised {self.seed} {robot}".encode()).digest()

        drawn = iter(sorted((robot for robot in range(1, self.robots + 1) if robot not in named), key=rank))
        return tuple(
            attack if attack.robot is not None else replace(attack, robot=next(drawn)) for attack in self.attacks
        )

    def with_options(
        self,
        *,
        robots: int | None = None,
        spacing_m: float | None = None,
        duration_s: float | None = None,
        defence: Defence | None = None,
        attacks: tuple[AttackSpec, ...] | None = None,
        f_max: int | None = None,
        t_audit_s: float | None = None,
        t_val_s: float | None = None,
        seed: int | None = None,
    ) -> Scenario:
        """Return the scenario with other values; None leaves one as it is. Raises: UsageError: as for the scenario.

        `spacing_m` is both the grid's step and the spacing that the flock keeps; `attacks` replace the scenario's own.
        """
        audits = _given(f_max=f_max)
        for name, value in (("t_audit", t_audit_s), ("t_val", t_val_s)):
            if value is not None:
                low_ms, high_ms = limits_in(BtiConfig, f"{name}_ms")
                check_within(f"{name}_s", value, low_ms / 1000, high_ms / 1000)  # in seconds, as they are given
                audits[f"{name}_ms"] = round(1000 * value)
        # The n_max that `_agree` gave `bti` before must not refuse a larger f_max.
        quorum = quorum_of(self.bti.f_max if f_max is None else f_max)
        bti = replace(self.bti, **audits, n_max=max(self.bti.n_max, quorum))
        plain = _given(robots=robots, duration_s=duration_s, defence=defence, attacks=attacks, seed=seed)
        return replace(self, bti=bti, **plain, **_given(grid_step_m=spacing_m, d_m=spacing_m))

    def _check_driven(self) -> None:
        for name in ("gateway_key", "operator_key"):
            check_key(name, getattr(self, name))
        for side_m in self.area_m:
            check_within("area_m", side_m, 0.2, MOST_AREA_M)

    def _check_attacks(self) -> None:
        seen = set()
        for attack in self.attacks:
            if not attack.own and attack.name not in swarm_attacks():
                raise _none_such("attack", attack.name, sorted(swarm_attacks()))
            against = attack.attack.against if attack.attack.scene == "protocol" else ""
            if against not in ("", self.controller):
                hint = f"controller: {against}"
                raise UsageError(f"{attack.name} says nothing that robots of {self.controller} hear", hint)
            if attack.robot is not None:
                if not 1 <= attack.robot <= self.robots:
                    raise UsageError(f"{attack.name} in robot {attack.robot}", f"robots are 1 to {self.robots}")
                if attack.robot in seen:
                    raise UsageError(f"two attacks in robot {attack.robot}", "one a robot")
                seen.add(attack.robot)
        if len(self.attacks) > self.robots:
            raise UsageError(f"{len(self.attacks)} attacks and {self.robots} robots", "one a robot")

    def _neighbours(self) -> int:
        provided = min(self.robots - 1, math.ceil(CLOSER * self.robots_in_range) + SPARE, MOST_NEIGHBOURS)
        orders = ORDERS_AS_NEIGHBOURS if self.controller == WHEELS else 0
        return max(provided, self.bti.quorum) + orders

    def _flock(self, bti: BtiConfig) -> FlockConfig:
        obstacles = (
            () if self.controller in PROTOCOLS else self.obstacles
        )  # protocols avoid obstacles by rules of their own
        return replace(
            self.flock,
            goal_m=self.goal_m,
            d_m=self.d_m,
            n_max=bti.n_max,
            state_every=bti.steps_per_state,
            discs=_of_kind(Disc, obstacles),
            boxes=_of_kind(Box, obstacles),
        )

    def _guard(self, bti: BtiConfig) -> GuardConfig:
        guard = replace(
            self.guard,
            n_max=bti.n_max,
            state_every=bti.steps_per_state,
            period_ms=bti.t_control_ms,
            delta_ms=bti.delta_ms,
            discs=_of_kind(Disc, self.obstacles),
            boxes=_of_kind(Box, self.obstacles),
        )
        for start_m in self.starts_m:
            guard.check_start(start_m)
        if self.robots > 1 and self.grid_step_m < guard.apart_m:
            raise UsageError(f"grid_step_m is {self.grid_step_m:g}", f"at least apart_m, which is {guard.apart_m:g}")
        return guard


def in_scenarios() -> list[str]:
    """Return the names of the controllers that a scenario can run; the others wait for orders."""
    from phalanx.robot.controllers.dispatch import BUNDLED  # noqa: PLC0415 - it takes long to import

    return [name for name, each in BUNDLED.items() if each.config in (FlockConfig, GuardConfig)] + [*PROTOCOLS]


def for_robots(scenario: Scenario) -> Scenario:
    """Return the scenario unchanged. Raises: UsageError: its robots have no room to start."""
    _ = scenario.starts_m
    return scenario


def _of_kind(kind: type[_Obstacle], obstacles: Sequence[Disc | Box]) -> tuple[_Obstacle, ...]:
    return tuple(obstacle for obstacle in obstacles if isinstance(obstacle, kind))


def _given(**options: Any) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _no_controller(name: str) -> UsageError:
    if ".py" in name:
        hint = f"a scenario names no file; a controller of your own is an option: --controller {name}"
        return UsageError(f"no controller {name!r} in a scenario", hint)
    return _none_such("controller", name, in_scenarios())


def _none_such(what: str, name: str, known: Sequence[str]) -> UsageError:
    return UsageError(f"no {what} {name!r}", f"{did_you_mean(name, known)}one of {', '.join(known)}")
