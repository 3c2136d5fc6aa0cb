"""The simulated swarm that `phalanx up` runs: robots that audit each other, as far as their number allows."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from phalanx.errors import UsageError
from phalanx.mission.landmarks import FloorPlan
from phalanx.robot import Led, Point
from phalanx.sim import Dotbots
from phalanx.sim.signals import handled_by
from phalanx.sim.swarms.mission import MissionSwarm
from phalanx.sim.swarms.protected import MOST_ROBOTS, ProtectedSwarm, least_robots

DEFAULT_F_MAX = 3
# Long enough for a round of audits, for attacks to be refused, and for the robots to be stopped.
REHEARSAL_S = 12.0
PATIENCE_S = 1.0
MISSION_PATIENCE_S = 10.0  # a process of their own takes a few seconds at any time


@dataclass(frozen=True, slots=True)
class Protection:
    """How a swarm is protected, and what people should know about it: "" if it is as they asked."""

    defence: str
    f_max: int
    note: str


def choose_protection(robots: int, defence: str | None, f_max: int | None) -> Protection:
    """The protection that so many robots can have.

    Args:
        robots: how many.
        defence: none, paper or bound; None for the best there is.
        f_max: compromised robots to be tolerated; None for 3, or what so few robots allow.
    Raises: UsageError: not what was asked for.
    Source: docs/spec/rebound.md (P2).
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


def simulated_swarm(
    robots: int, seed: int, defence: str | None, f_max: int | None, talk: Callable[[str], None]
) -> Dotbots | ProtectedSwarm:
    """Simulated robots, ready to run: whatever has to be compiled for them is.

    Args:
        robots: how many.
        seed: of their places.
        defence: see `choose_protection`.
        f_max: the same.
        talk: told what people should know, in one line.
    Raises: UsageError: a number is out of range.
    """
    protection = choose_protection(robots, defence, f_max)
    swarm = _make(robots, seed, protection, talk)
    if protection.note:
        talk(protection.note)
    return swarm


def _make(robots: int, seed: int, protection: Protection, talk: Callable[[str], None]) -> Dotbots | ProtectedSwarm:
    if protection.defence == "none":
        return Dotbots(robots, seed, time.time, unprotected=protection.note)
    with _patiently(talk):
        # An event loop hears of Ctrl-C when it has its turn, which may be in minutes.
        with handled_by(signal.default_int_handler, signal.SIGINT, signal.SIGTERM):
            _rehearse(protection.defence)
        return ProtectedSwarm(robots, seed, time.time, defence=protection.defence, f_max=protection.f_max)


@contextlib.contextmanager
def mission_swarm(plan: FloorPlan, robots: int, seed: int, talk: Callable[[str], None]) -> Iterator[MissionSwarm]:
    """Simulated robots that live missions in a building, ready to run, while the body does.

    Args:
        plan: the building.
        robots: how many.
        seed: of their odometry.
        talk: told what people should know, in one line.
    Raises: UsageError: too many robots, or a building without walls or a start. Unavailable: they do not come up.
    """
    with contextlib.ExitStack() as stack:
        with _patiently(talk, MISSION_PATIENCE_S):
            swarm = stack.enter_context(MissionSwarm(plan, robots, seed, time.time))
        yield swarm


@contextlib.contextmanager
def _patiently(talk: Callable[[str], None], patience_s: float = PATIENCE_S) -> Iterator[None]:
    slow = threading.Timer(patience_s, talk, ["preparing what robots run; the first time, this takes minutes"])
    slow.daemon = True
    slow.start()
    try:
        yield
    finally:
        slow.cancel()


def _rehearse(defence: str) -> None:
    # In a swarm of its own each order is given and each attack is run: none of it is compiled while visitors wait.
    swarm = ProtectedSwarm(30, 0, lambda: 0.0, defence=defence)
    addresses = [robot.address for robot in swarm.robots()]
    swarm.drive(addresses[0], 50, 50)
    swarm.set_led(addresses[1], Led(1, 2, 3))
    swarm.follow(addresses[2], [Point(1000.0, 1000.0)], 60.0)
    swarm.step(1.0)
    for address, attack in zip(addresses, swarm.attacks(), strict=False):
        swarm.compromise(address, attack.name)
    swarm.step(REHEARSAL_S)
