"""The simulated swarm that `phalanx up` runs: robots that audit each other, as far as their number allows."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from phalanx.errors import UsageError
from phalanx.mission.landmarks import FloorPlan
from phalanx.sim.missions.orders import Orders
from phalanx.sim.signals import handled_by
from phalanx.sim.swarms.dotbots import MAX_ROBOTS, Dotbots
from phalanx.sim.swarms.mission import MissionSwarm, ShieldedMissionSwarm
from phalanx.sim.swarms.protected import MOST_ROBOTS, ProtectedSwarm, SwarmKeys, least_robots
from phalanx.sim.swarms.work import check_work

from .rehearsal import is_compiled, rehearse, rehearse_elsewhere, rehearse_here

DEFAULT_F_MAX = 3
NO_SHIELDS_YET = "what audits need is being compiled, until then nothing stops a robot that lies"


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
    """Simulated robots, ready to run: whatever has to be compiled for them is, or they go on unprotected until it is.

    What people should know is told `talk`, in one line.
    """
    robots, protection, protocol = plan.robots, plan.protection, plan.protocol
    if protection.note:
        talk(protection.note)
    if protection.defence == "none":
        return Dotbots(robots, seed, time.time, unprotected=protection.note)
    if not is_compiled(protection.defence, protocol):
        # Before the code is shown: lines below would push it out of a small terminal.
        talk("compiling what audits need; it takes minutes, only the first time, and robots have no shields until then")
        return SoonProtected(plan, seed, keys)
    # An event loop hears of Ctrl-C when it has its turn.
    with handled_by(signal.default_int_handler, signal.SIGINT, signal.SIGTERM):
        rehearse(protection.defence, protocol)
    return ProtectedSwarm(
        robots, seed, time.time, defence=protection.defence, f_max=protection.f_max, keys=keys, protocol=protocol
    )


class SoonProtected(Dotbots):
    """Robots that can be driven at once, and will audit each other when what that needs is compiled."""

    def __init__(self, plan: Plan, seed: int, keys: SwarmKeys | None) -> None:
        self.preparing = "no shields yet"
        super().__init__(plan.robots, seed, time.time, unprotected=NO_SHIELDS_YET)
        self._plan, self._seed, self._keys = plan, seed, keys

    async def ready(self) -> ProtectedSwarm:
        """The same robots, where they are when all is compiled, auditing each other.

        Raises: Unavailable: it cannot be compiled.
        """
        protection, protocol = self._plan.protection, self._plan.protocol
        await rehearse_elsewhere(protection.defence, protocol, self._hear)
        await rehearse_here(protection.defence, protocol)
        return ProtectedSwarm(
            self._plan.robots,
            self._seed,
            time.time,
            defence=protection.defence,
            f_max=protection.f_max,
            now=self.robots(),
            keys=self._keys,
            protocol=protocol,
        )

    def _hear(self, how_far: str) -> None:
        self.preparing = f"no shields yet, {how_far}"


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
    """Simulated robots that live missions in a building, while the body runs; they begin with `orders` when all is
    compiled that they run.

    As `simulated_swarm`.
    Raises: UsageError: too many robots, or a building without walls or a start.
    """
    protection = choose_protection(robots, defence, f_max)
    if orders is not None:
        orders.run(robots=robots, defence=protection.defence, f_max=protection.f_max)  # before anything is compiled
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
