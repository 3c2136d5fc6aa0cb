"""The simulated swarm that `phalanx up` runs: robots that audit each other, as far as their number allows."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from phalanx.errors import UsageError
from phalanx.mission.landmarks import FloorPlan
from phalanx.sim.missions.orders import Orders
from phalanx.sim.swarms.dotbots import MAX_ROBOTS, Dotbots
from phalanx.sim.swarms.mission import MissionSwarm, ShieldedMissionSwarm
from phalanx.sim.swarms.protected import MOST_ROBOTS, ProtectedSwarm, SwarmKeys, least_robots
from phalanx.sim.swarms.work import check_work

DEFAULT_F_MAX = 3


@dataclass(frozen=True, slots=True)
class Protection:
    """How a swarm is protected, and what people should know about it: "" if it is as they asked."""

    defence: str
    f_max: int
    note: str


def choose_protection(robots: int, defence: str | None, f_max: int | None) -> Protection:
    """The protection that so many robots can have; of no defence the best, of no f_max 3, or what so few robots allow.

    Raises: UsageError: not what was asked for. Source: docs/spec/rebound.md (P2).
    """
    f = DEFAULT_F_MAX if f_max is None else f_max
    if defence == "none" or (least_robots(f) <= robots <= MOST_ROBOTS):
        return Protection(defence or "bound", f, "")
    insists = defence is not None or f_max is not None
    fewer = (robots - 2) // 2
    if robots > MOST_ROBOTS:
        trouble, hint = f"{robots} robots in one radio range cannot audit each other in time", f"at most {MOST_ROBOTS}"
    elif fewer < 1:
        trouble, hint = f"{robots} robots are too few to audit each other", f"at least {least_robots(1)}"
    elif f_max is not None:
        trouble = f"{robots} robots cannot do without {f} of them and still audit each other"
        hint = f"at least {least_robots(f)}, or --f-max {fewer}"
    else:
        return Protection(defence or "bound", fewer, f"with {robots} robots f_max is {fewer}")
    if insists:
        raise UsageError(trouble, f"{hint}; or --defence none")
    return Protection("none", f, f"{trouble}: they run unprotected")


@dataclass(frozen=True, slots=True)
class Plan:
    """A swarm that can be: so many robots, so protected, with this work while nobody drives them, "" for none."""

    robots: int
    protection: Protection
    protocol: str


def plan_swarm(robots: int, defence: str | None, f_max: int | None, protocol: str = "") -> Plan:
    """What is asked for, if there can be such a swarm. For `defence` and `f_max` see `choose_protection`.

    Raises: UsageError: a number is out of range, or no wheels do that.
    """
    protection = choose_protection(robots, defence, f_max)
    if protocol:
        check_work(protocol, robots)
        if protection.defence == "none":
            raise UsageError(f"{protocol}, and robots that do not audit each other", "leave one out")
    if not 1 <= robots <= MAX_ROBOTS:
        raise UsageError(f"a swarm of {robots} robots", f"1 to {MAX_ROBOTS}")
    return Plan(robots, protection, protocol)


def simulated_swarm(
    plan: Plan, seed: int, talk: Callable[[str], None], keys: SwarmKeys | None = None
) -> Dotbots | ProtectedSwarm:
    """Return the simulated robots of a plan. `talk` gets a line of what people should know about them."""
    robots, protection = plan.robots, plan.protection
    if protection.note:
        talk(protection.note)
    if protection.defence == "none":
        return Dotbots(robots, seed, time.time, unprotected=protection.note)
    return ProtectedSwarm(
        robots, seed, time.time, defence=protection.defence, f_max=protection.f_max, keys=keys, protocol=plan.protocol
    )


@contextlib.contextmanager
def mission_swarm(
    plan: FloorPlan,
    orders: Orders | None,
    robots: int,
    seed: int,
    defence: str | None,
    f_max: int | None,
    talk: Callable[[str], None],
) -> Iterator[MissionSwarm]:
    """Yield simulated robots that live missions in a building; they begin with `orders`.

    As `simulated_swarm`.
    Raises: UsageError: too many robots, or a building without walls or a start.
    """
    protection = choose_protection(robots, defence, f_max)
    if orders is not None:
        orders.run(robots=robots, defence=protection.defence, f_max=protection.f_max)  # refuses, if they cannot
    if protection.note:
        talk(protection.note)
    if protection.defence == "none":
        swarm = MissionSwarm(plan, robots, seed, time.time)
    else:
        swarm = ShieldedMissionSwarm(plan, robots, seed, time.time, protection.defence, protection.f_max)
    with swarm:
        if orders is not None:
            swarm.begin(orders)
        yield swarm
