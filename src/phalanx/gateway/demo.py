"""The simulated swarm of `phalanx up`: robots audit each other if there are enough of them."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from phalanx.config import BtiConfig
from phalanx.errors import UsageError
from phalanx.mission.landmarks import FloorPlan
from phalanx.world.missions.orders import Orders
from phalanx.world.swarms.dotbots import MAX_ROBOTS, Dotbots
from phalanx.world.swarms.mission import MissionSwarm, ShieldedMissionSwarm
from phalanx.world.swarms.protected import MOST_ROBOTS, ProtectedSwarm, SwarmKeys, fewest_robots
from phalanx.world.swarms.work import ON_WHEELS, check_work

DEFAULT_F_MAX = 3
IDLE, WAIT = "patrol", "none"  # default task of robots that nobody drives; and no task


@dataclass(frozen=True, slots=True)
class Plan:
    """A valid configuration of a simulated swarm: robots and protection."""

    robots: int
    defence: str
    f_max: int
    note: str  # deviation from the requested protection; "" if none
    protocol: str = ""  # task of robots that nobody drives


def choose_protection(robots: int, defence: str | None, f_max: int | None) -> Plan:
    """Return the strongest protection possible for a number of robots.

    Without `defence` use hardened if possible. Without `f_max` use 3, or the largest value for which P2 holds. A swarm
    with one robot too few for P2 is protected anyway, with a note.
    Raises: UsageError: the request cannot be met. Source: docs/promises.md (P2).
    """
    if defence == "none":
        return Plan(robots, defence, f_max or DEFAULT_F_MAX, "")
    largest = max(1, (robots - 3) // 2)  # for which P2 holds (BtiConfig.least_robots)
    f = f_max or min(DEFAULT_F_MAX, largest)
    if fewest_robots(f) <= robots <= MOST_ROBOTS:
        chosen = [f"with {robots} robots f_max is {f}"] if (f_max or DEFAULT_F_MAX) > f else []
        if robots < BtiConfig(f_max=f).least_robots:
            cause = f"{f} compromised of {robots} robots can cause others to be stopped"
            chosen.append(f"{cause}: P2 needs {robots + 1} robots")
        return Plan(robots, defence or "hardened", f, "; ".join(chosen))
    if robots > MOST_ROBOTS:
        trouble = f"{robots} robots in one radio range cannot audit each other in time"
        hint = f"use at most {MOST_ROBOTS}"
    elif robots < fewest_robots(1):
        trouble = f"{robots} robots are too few to audit each other"
        hint = f"use at least {BtiConfig(f_max=1).least_robots}"
    else:
        trouble = f"{robots} robots are too few to audit each other with f_max {f}"
        hint = f"use at least {BtiConfig(f_max=f).least_robots}, or --f-max {largest}"
    if defence or f_max:
        raise UsageError(trouble, f"{hint}; or --defence none")
    return Plan(robots, "none", DEFAULT_F_MAX, f"{trouble}: they run unprotected")


def plan_swarm(robots: int, defence: str | None, f_max: int | None, protocol: str = "") -> Plan:
    """Return the plan of a requested swarm; without a protocol, robots patrol if possible.

    Raises: UsageError: no such swarm is possible, or the protocol is not for robots on wheels.
    """
    plan = choose_protection(robots, defence, f_max)
    if not protocol and plan.defence != "none" and robots <= ON_WHEELS[IDLE][1]:
        protocol = IDLE
    if protocol == WAIT:
        protocol = ""
    if protocol:
        check_work(protocol, robots)
        if plan.defence == "none":
            raise UsageError(f"--scenario {protocol} without audits", "leave one out: the task needs audits")
    if not 1 <= robots <= MAX_ROBOTS:
        raise UsageError(f"a swarm of {robots} robots", f"use 1 to {MAX_ROBOTS}")
    return replace(plan, protocol=protocol)


def simulated_swarm(
    plan: Plan, seed: int, talk: Callable[[str], None], keys: SwarmKeys | None = None
) -> Dotbots | ProtectedSwarm:
    """Return the simulated robots of a plan. `talk` receives the plan's note."""
    if plan.note:
        talk(plan.note)
    if plan.defence == "none":
        return Dotbots(plan.robots, seed, time.time, unprotected=plan.note)
    return ProtectedSwarm(
        plan.robots,
        seed,
        time.time,
        defence=plan.defence,
        f_max=plan.f_max,
        keys=keys,
        protocol=plan.protocol,
        keeps_apart=True,
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
    """Yield simulated robots for missions. Raises: UsageError: too many, or no walls or start in the building."""
    protection = choose_protection(robots, defence, f_max)
    if orders is not None:
        orders.run(robots=robots, defence=protection.defence, f_max=protection.f_max)  # raises if impossible
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
