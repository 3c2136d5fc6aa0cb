"""The simulated swarm that `phalanx up` runs: robots that audit each other, as far as their number allows."""

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
IDLE, WAIT = "patrol", "none"  # what robots do that nobody drives, if nothing else is asked for; and standing still


@dataclass(frozen=True, slots=True)
class Plan:
    """A swarm that can be: so many robots, so protected."""

    robots: int
    defence: str
    f_max: int
    note: str  # what people should know about its protection; "" if it is as they asked
    protocol: str = ""  # the work of robots that nobody drives


def choose_protection(robots: int, defence: str | None, f_max: int | None) -> Plan:
    """Return the protection that so many robots can have.

    Without `defence` it is the best. Without `f_max` it is 3, or the largest for which P2 holds in so small a swarm.
    A swarm of one robot too few for P2 is protected all the same, with a note.
    Raises: UsageError: not what was asked for. Source: docs/promises.md (P2).
    """
    if defence == "none":
        return Plan(robots, defence, f_max or DEFAULT_F_MAX, "")
    largest = max(1, (robots - 3) // 2)  # for which P2 holds: see BtiConfig.least_robots
    f = f_max or min(DEFAULT_F_MAX, largest)
    if fewest_robots(f) <= robots <= MOST_ROBOTS:
        chosen = [f"with {robots} robots f_max is {f}"] if (f_max or DEFAULT_F_MAX) > f else []
        if robots < BtiConfig(f_max=f).least_robots:
            chosen.append(f"if {f} of {robots} robots lie, they may have others stopped: P2 takes {robots + 1} robots")
        return Plan(robots, defence or "hardened", f, "; ".join(chosen))
    if robots > MOST_ROBOTS:
        trouble, hint = f"{robots} robots in one radio range cannot audit each other in time", f"at most {MOST_ROBOTS}"
    elif robots < fewest_robots(1):
        trouble = f"{robots} robots are too few to audit each other"
        hint = f"at least {BtiConfig(f_max=1).least_robots}"
    else:
        trouble = f"{robots} robots cannot do without {f} of them and still audit each other"
        hint = f"at least {BtiConfig(f_max=f).least_robots}, or --f-max {largest}"
    if defence or f_max:
        raise UsageError(trouble, f"{hint}; or --defence none")
    return Plan(robots, "none", DEFAULT_F_MAX, f"{trouble}: they run unprotected")


def plan_swarm(robots: int, defence: str | None, f_max: int | None, protocol: str = "") -> Plan:
    """Return what is asked for; without a protocol, robots patrol as far as that can be.

    Raises: UsageError: there can be no such swarm; no wheels do that.
    """
    plan = choose_protection(robots, defence, f_max)
    if not protocol and plan.defence != "none" and robots <= ON_WHEELS[IDLE][1]:
        protocol = IDLE
    if protocol == WAIT:
        protocol = ""
    if protocol:
        check_work(protocol, robots)
        if plan.defence == "none":
            raise UsageError(f"{protocol}, and robots that do not audit each other", "leave one out")
    if not 1 <= robots <= MAX_ROBOTS:
        raise UsageError(f"a swarm of {robots} robots", f"1 to {MAX_ROBOTS}")
    return replace(plan, protocol=protocol)


def simulated_swarm(
    plan: Plan, seed: int, talk: Callable[[str], None], keys: SwarmKeys | None = None
) -> Dotbots | ProtectedSwarm:
    """Return the simulated robots of a plan. `talk` gets a line of what people should know about them."""
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
    """Yield simulated robots that live missions. Raises: UsageError: too many, or no walls or start in the building."""
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
