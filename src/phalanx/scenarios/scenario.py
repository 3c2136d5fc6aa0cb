"""A scenario: all settings of a simulated run. Together with the seed they determine every byte of it."""

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

PROTOCOLS = tuple(protocols())  # controllers in plain Python
CONTROLLERS = (*bundled(), *PROTOCOLS)
GUARD = "guard"  # the controller that planners advise
WHEELS = "wheels"  # the controller that executes signed orders
Formation = Literal["grid", "line", "ring", "islands"]
MOST_ROBOTS = 65_535
# The log of more neighbours does not fit into an audit request. The radio channel is full at 130 already.
MOST_NEIGHBOURS = 340
# A flock gets denser than its start grid: n_max is CLOSER times the grid's number of neighbours, plus SPARE.
CLOSER, SPARE = 1.5, 4
_Obstacle = TypeVar("_Obstacle", Disc, Box)
ROWS = ("line", "ring")  # formations of a single row
# Room for orders in the log of a robot on wheels, in units of the bytes that a neighbour broadcasts.
ORDERS_AS_NEIGHBOURS = 40
MOST_AREA_M = 65.0  # a waypoint is 16 bits of millimetres


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """A swarm: start positions, task, compromised robots, and defence; `flock`, `bti` and `guard` are adapted to them.

    Raises: UsageError: a value is out of range, or two values contradict each other.
    Source: RoboRebound §4, §5.2, §5.3; docs/reference/scenarios.md.
    """

    name: str = described("", "name of the scenario")
    about: str = described("", "description in one line")
    robots: int = described(25, "number of robots; ids count from 1, row by row from the corner at the origin")
    formation: Formation = described(  # noqa: RUF009 - made a field
        "grid", "a square grid, a line, a ring, or islands: two grids out of radio range of each other by one step"
    )
    grid_step_m: float = within(25.0, 0.01, 1e4, "distance of adjacent robots in the formation")
    d_m: float = described(20.0, "spacing that the flock keeps")
    goal_m: tuple[float, float] = described((500.0, 500.0), "goal of the swarm")
    duration_s: float = within(150.0, 0.1, LONGEST_S, "simulated time")
    defence: Defence = described(  # noqa: RUF009 - made a field
        "hardened",
        "none: nothing stops compromised robots; paper: RoboRebound as published; hardened: with Phalanx's additions",
    )
    controller: str = described("flock", "controller of honest robots")
    seed: int = described(0, "chooses phases of broadcasts, back-offs, and the robots to compromise")
    attacks: tuple[AttackSpec, ...] = described((), "attacks, at most one per robot")
    obstacles: tuple[Disc | Box, ...] = described(
        (), "obstacles on the ground; the flock avoids them only if c1_beta and c2_beta are set"
    )
    area_m: tuple[float, float] = described((2.0, 2.0), "area that robots on wheels stay in")
    gateway_key: str = described(
        "", "public Ed25519 key, 64 hexadecimal digits: robots on wheels execute orders signed with it"
    )
    operator_key: str = described("", "public Ed25519 key: robots on wheels stop at an order signed with it")
    order_looks: int = within(16, 1, 255, "most signatures that a robot on wheels checks between two readings")
    contact_m: float = within(1.0, 0.0, 1e3, "distance at which two robots collide")
    n_max: int | None = described(None, "neighbours provided for; None: derived from formation and radio range")
    hub: int = described(
        0,
        "the first so many robots stand where aisles meet; the others, each in its aisle, receive packets only from "
        "them; 0: every robot receives all packets in range",
    )
    bti: BtiConfig = field(default_factory=BtiConfig, metadata=description("parameters of the audits"))
    flock: FlockConfig = field(default_factory=FlockConfig, metadata=description("parameters of the controller"))
    guard: GuardConfig = field(default_factory=GuardConfig, metadata=description("envelope of the controller guard"))
    radio: RadioConfig = field(default_factory=RadioConfig, metadata=description("parameters of the radio"))

    def __post_init__(self) -> None:
        for name in ("robots", "seed", "hub"):
            if not isinstance(getattr(self, name), Integral):
                raise UsageError(f"{name} is {getattr(self, name)!r}", "use a whole number")
        if not all(isinstance(each, AttackSpec) for each in self.attacks):
            raise UsageError(f"attacks are {self.attacks!r}", "use a tuple of AttackSpec")
        if not 1 <= self.robots <= MOST_ROBOTS:
            raise UsageError(f"{self.robots} robots", f"use 1 to {MOST_ROBOTS}")
        if not 0 <= self.hub <= self.robots:
            raise UsageError(f"hub is {self.hub}", f"use 0 to {self.robots}, the number of robots")
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
            raise UsageError(f"seed is {self.seed}", "use 0 to 4294967295")
        self._check_driven()
        self._check_attacks()
        self._derive()

    def _derive(self) -> None:
        """Set `bti`, `flock` and `guard` to agree with the other fields."""
        n_max = self._neighbours() if self.n_max is None else self.n_max
        guarded = self.controller == GUARD
        advised = OWN[self.controller].advised if self.controller in OWN else None
        sizes = {"advice_bytes": advised.size if advised else 0}
        if guarded:
            signed = bool(self.guard.adviser_key)
            key_bytes = SIGNER_KEY_BYTES * signed  # after the guard's memory in its state
            sizes["advice_bytes"] = SIGNED_BYTES if signed else WISH.size
            sizes["state_bytes"] = GUARD_MEMORY.size + NEIGHBOUR_BYTES * n_max + key_bytes
        bti = replace(self.bti, n_max=n_max, **sizes)
        object.__setattr__(self, "bti", bti)
        object.__setattr__(self, "flock", self._flock(bti))
        if guarded:
            object.__setattr__(self, "guard", self._guard(bti))

    @property
    def robots_per_edge(self) -> int:
        """Return the robots in a row of the grid, or of the larger of two grids; the last row may be shorter."""
        return math.isqrt(self.grids[0] - 1) + 1

    @property
    def starts_m(self) -> list[tuple[float, float]]:
        """Return the N start positions. Raises: UsageError: robots on wheels do not fit into `area_m`."""
        n, step_m, row = self.robots, self.grid_step_m, self.robots_per_edge
        if self.controller == WHEELS:
            corner_m = [(side_m - step_m * (row - 1)) / 2 for side_m in self.area_m]
            if min(corner_m) <= 0:
                raise UsageError(f"area_m has no room for {n} robots", "use a larger area_m or a smaller grid_step_m")
            return [(corner_m[0] + i % row * step_m, corner_m[1] + i // row * step_m) for i in range(n)]
        if self.formation == "ring":
            radius_m, turn = step_m / 2 / math.sin(math.pi / max(n, 2)), math.tau / n
            around = [(math.cos(i * turn), math.sin(i * turn)) for i in range(n)]
            # Rounded to the millimetre: the last bit of a cosine differs between machines.
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
        """Return the task for the robots of a protocol."""
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
        """Return the number of robots on each grid."""
        half = self.robots // 2
        return (self.robots - half, half) if self.formation == "islands" else (self.robots,)

    @property
    def robots_in_range(self) -> float:
        """Return the estimated robots in radio range of one in the middle of the formation, itself included."""
        steps = self.radio.range_m / self.grid_step_m
        return min(1 + 2 * steps if self.formation in ROWS else math.pi * steps**2, self.robots)

    def drawn_attacks(self) -> tuple[AttackSpec, ...]:
        """Return the attacks, each with a different robot; unset robots are drawn by SHA-256 of seed and id."""
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
        """Return the scenario with other values; None keeps a value. Raises: UsageError: as for the scenario.

        `spacing_m` sets both `grid_step_m` and `d_m`; `attacks` replaces the attacks of the scenario.
        """
        audits = _given(f_max=f_max)
        for name, value in (("t_audit", t_audit_s), ("t_val", t_val_s)):
            if value is not None:
                low_ms, high_ms = limits_in(BtiConfig, f"{name}_ms")
                check_within(f"{name}_s", value, low_ms / 1000, high_ms / 1000)  # messages in seconds, as given
                audits[f"{name}_ms"] = round(1000 * value)
        # `_derive` set n_max in `bti` for the former f_max: raise it, or `bti` would reject a larger f_max.
        quorum = quorum_of(self.bti.f_max if f_max is None else f_max)
        bti = replace(self.bti, **audits, n_max=max(self.bti.n_max, quorum))
        plain = _given(robots=robots, duration_s=duration_s, defence=defence, attacks=attacks, seed=seed)
        return replace(self, bti=bti, **plain, **_given(grid_step_m=spacing_m, d_m=spacing_m))

    def _check_driven(self) -> None:
        """Check the fields of robots on wheels."""
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
                raise UsageError(f"attack {attack.name} has no effect on controller {self.controller}", hint)
            if attack.robot is not None:
                if not 1 <= attack.robot <= self.robots:
                    raise UsageError(f"{attack.name} in robot {attack.robot}", f"use a robot from 1 to {self.robots}")
                if attack.robot in seen:
                    raise UsageError(f"two attacks in robot {attack.robot}", "use at most one attack per robot")
                seen.add(attack.robot)
        if len(self.attacks) > self.robots:
            message = f"{len(self.attacks)} attacks for {self.robots} robots"
            raise UsageError(message, "use at most one attack per robot")

    def _neighbours(self) -> int:
        """Return the number of neighbours to provide for, with room for orders."""
        provided = min(self.robots - 1, math.ceil(CLOSER * self.robots_in_range) + SPARE, MOST_NEIGHBOURS)
        orders = ORDERS_AS_NEIGHBOURS if self.controller == WHEELS else 0
        return max(provided, self.bti.quorum) + orders

    def _flock(self, bti: BtiConfig) -> FlockConfig:
        obstacles = (
            () if self.controller in PROTOCOLS else self.obstacles
        )  # protocols have their own obstacle avoidance
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
            raise UsageError(f"grid_step_m is {self.grid_step_m:g}", f"use at least apart_m, {guard.apart_m:g}")
        return guard


def in_scenarios() -> list[str]:
    """Return the names of the controllers that a scenario can run alone; the others need orders."""
    from phalanx.robot.controllers.dispatch import BUNDLED  # noqa: PLC0415 - it takes long to import

    return [name for name, each in BUNDLED.items() if each.config in (FlockConfig, GuardConfig)] + [*PROTOCOLS]


def for_robots(scenario: Scenario) -> Scenario:
    """Return the scenario unchanged. Raises: UsageError: `area_m` has no room for its robots."""
    _ = scenario.starts_m
    return scenario


def _of_kind(kind: type[_Obstacle], obstacles: Sequence[Disc | Box]) -> tuple[_Obstacle, ...]:
    return tuple(obstacle for obstacle in obstacles if isinstance(obstacle, kind))


def _given(**options: Any) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _no_controller(name: str) -> UsageError:
    if ".py" in name:
        hint = f"a scenario cannot name a file: use the option --controller {name}"
        return UsageError(f"no controller {name!r} in a scenario", hint)
    return _none_such("controller", name, in_scenarios())


def _none_such(kind: str, name: str, known: Sequence[str]) -> UsageError:
    return UsageError(f"no {kind} {name!r}", f"{did_you_mean(name, known)}use one of {', '.join(known)}")
