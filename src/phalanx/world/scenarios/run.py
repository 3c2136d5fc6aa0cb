"""One seeded run of a scenario: create, advance, observe and summarise it."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phalanx.bti.elsewhere import raise_failed
from phalanx.bti.nodes import Limits, Nodes, TrustedNodes
from phalanx.errors import Unavailable, UsageError
from phalanx.robot.adversary.liar import Liar, lying
from phalanx.robot.controllers.senses import Senses
from phalanx.robot.planner import MakePlanner, Planner
from phalanx.robot.robot import Robot
from phalanx.scenarios.behaviour import (
    MakeController,
    declaration_of,
    number_of,
    params_of,
    plan_of,
    planner_factory,
    with_protocol,
    with_room,
)
from phalanx.scenarios.scenario import Scenario, in_scenarios
from phalanx.world.audited import loop, pybot
from phalanx.world.audited.around import Around
from phalanx.world.audited.body import driven_by
from phalanx.world.audited.events import refused
from phalanx.world.audited.quorum import Quorum
from phalanx.world.audited.setup import PROFILES, Setup, make_world, start
from phalanx.world.audited.world import TRACED, Verdict, VerdictReader, shields
from phalanx.world.radio.channel import AIRTIME_US, APP_BROADCAST, AUDIT_BROADCAST, AUDIT_UNICAST, BYTES, delivery


class Run:
    """One run of a scenario.

    Args:
        scenario: the scenario to run.
        controller: makes a user's controller from a robot's id; None for the scenario's.
        planner: makes the planner of a guarded robot from its id and the goal; None for `ToGoal`.
        plain: use the simplest computation everywhere, with the firmware's C where possible, as a reference for tests.
        make_nodes: makes the robots' trusted nodes, if they run outside this process.
    Raises: UsageError: a planner for robots without a guard. Unavailable: not enough memory for the robots.
    Source: docs/spec/world.md.
    """

    has_station = False  # whether the world has a station that sends orders

    def __init__(
        self,
        scenario: Scenario,
        controller: MakeController | None = None,
        planner: MakePlanner | None = None,
        *,
        plain: bool = False,
        make_nodes: Callable[[int, int, Limits], TrustedNodes] = Nodes,
    ) -> None:
        if not self.has_station:  # simulated planners do not sign advice
            scenario = replace(scenario, guard=replace(scenario.guard, adviser_key=""))
        scenario, controller, self.stage = with_protocol(scenario, controller)
        self.scenario = scenario = with_room(scenario, controller)
        n = scenario.robots
        chance = np.random.Generator(np.random.PCG64(np.random.SeedSequence([scenario.seed, 0x7068])))
        self.ids = np.arange(1, n + 1)
        drawn = scenario.drawn_attacks()
        bundled = declaration_of(scenario)
        if scenario.controller not in in_scenarios() and not self.has_station:
            raise UsageError(f"{scenario.controller} waits for orders, which scenarios lack", "use another controller")
        make_planner = planner_factory(scenario, controller, planner)
        setup = Setup(
            robots=n,
            starts_m=np.array(scenario.starts_m, np.float64),
            profile=PROFILES[scenario.defence],
            controller=number_of(scenario, controller),
            params=params_of(scenario),
            body=driven_by(bundled),
            seed=scenario.seed,
            contact_m=scenario.contact_m,
            obstacles=scenario.obstacles,
            area_m=scenario.area_m,
            hub=scenario.hub,
            plain=plain,
            bti=scenario.bti,
            radio=scenario.radio,
            before_key={int(spec.robot or 0) - 1: spec.attack.kind.before_key for spec in drawn},
            make_nodes=make_nodes,
        )
        try:
            self.world = make_world(setup, chance)
        except MemoryError as error:
            raise Unavailable(f"{n} robots do not fit into memory", "use fewer robots, or a smaller n_max") from error
        self.looks: pybot.ExtraSensors | None = self.stage
        self.sense(getattr(controller, "senses", None))
        self._verdicts = VerdictReader(self.world)
        self._wall_s = 0.0
        self._sampled_s = 0
        self._distances: list[tuple[float, float | None]] = []
        self._digest = hashlib.sha256()
        self._trace: pybot.Trace | None = None
        self.robots: dict[int, Robot] = {}
        for spec in drawn:
            i = int(spec.robot or 0) - 1
            plan = plan_of(scenario, spec, int(self.world.boot_us[i]) // 1000, chance)
            self.robots[i] = lying(spec.attack, self.world.fleet, i, self.world.work, plan, controller)
        self.planners: dict[int, Planner] = {}
        if make_planner:
            self.planners = {i: make_planner(i + 1, scenario.goal_m) for i in range(n)}
        if controller or make_planner:
            for i in range(n):
                self.robots.setdefault(i, Robot(self.world.fleet, i, self.world.work, controller))
        self._quorum = Quorum(self.world, scenario.bti, self._correct)
        start(self.world, self.robots)

    def sense(self, senses: Senses | None) -> None:
        """Equip all robots with these sensors, if any."""
        if senses:
            self.looks = Around(self.world, senses, self.scenario.contact_m)

    def trace(self, rob_id: int, echo: Callable[[str], None]) -> None:
        """Print a robot's events and actions from now on, one line each.

        Raises: UsageError: no such robot.
        """
        if rob_id not in self.ids:
            raise UsageError(f"there is no robot {rob_id} to trace", f"robots are 1 to {len(self.ids)}")
        i = rob_id - 1
        if i not in self.robots:
            self.robots[i] = Robot(self.world.fleet, i, self.world.work)
            self.world.runs[i] = TRACED
        self._trace = pybot.Trace(rob_id, echo)

    # --- advancing ----------------------------------------------------------------------------------------------------

    @property
    def now_s(self) -> float:
        """Return the simulated time so far, s."""
        return float(self.world.clock[0].now_us) / 1e6

    def advance(self, until_s: float) -> None:
        """Advance the world to `until_s`.

        Raises: UsageError: too many robots in range of each other. Unavailable: external trusted nodes failed.
        """
        began = time.perf_counter()
        until_us = round(until_s * 1e6)
        while self.world.clock[0].now_us < until_us:
            target_us = min(until_us, (self._sampled_s + 1) * 1_000_000)
            while loop.run(self.world, target_us) == loop.FOR_PYTHON:
                pybot.handle(self.world, self.robots, self.planners, self.looks, self._trace)
            raise_failed()
            if target_us == (self._sampled_s + 1) * 1_000_000:
                self._sample()
        assert refused(self.world.queue) == 0, "the event queue overflowed"
        if self.world.clock[0].crowded:
            raise UsageError(
                f"too crowded: more than {len(self.world.reach.candidate_ids) // len(self.ids)} in range of each",
                "use a wider spacing, fewer robots, or a greater n_max",
            )
        self._wall_s += time.perf_counter() - began

    def _sample(self) -> None:
        self._sampled_s += 1
        self._distances.append((float(self._sampled_s), self._mean_distance_m()))
        self._quorum.look()
        for part in (self.world.pos, self.world.vel, self.world.safe, self.world.fleet.hckpt):
            self._digest.update(part.tobytes())

    def _mean_distance_m(self) -> float | None:
        correct = self._correct
        distance = np.sqrt(((self.world.pos - np.array(self.scenario.goal_m)) ** 2).sum(axis=1))
        return float(distance[correct].mean()) if correct.any() else None

    # --- observation --------------------------------------------------------------------------------------------------

    @property
    def _correct(self) -> NDArray[np.bool_]:
        correct = np.ones(len(self.ids), bool)
        for i, robot in self.robots.items():
            correct[i] = not isinstance(robot, Liar)
        return correct

    @property
    def positions_m(self) -> NDArray[np.float64]:
        """Return positions, (N, 2), m, world frame. Like all arrays here it is a copy."""
        return self.world.pos.copy()

    @property
    def velocities_mps(self) -> NDArray[np.float64]:
        """Return velocities, (N, 2), m/s, world frame; a copy."""
        return self.world.vel.copy()

    @property
    def airtime_s(self) -> NDArray[np.float64]:
        """Return the airtime used by each robot, (N,), s; a copy."""
        used: NDArray[np.float64] = self.world.air.counts[: len(self.ids), :, AIRTIME_US].sum(axis=1) / 1e6
        return used

    @property
    def in_safe_mode(self) -> NDArray[np.bool_]:
        """Return the Safe Mode flags, (N,); a copy."""
        return self.world.safe.astype(bool)

    @property
    def compromised(self) -> dict[int, str]:
        """Return the attack of each compromised robot, by robot id."""
        return {i + 1: robot.attack.name for i, robot in self.robots.items() if isinstance(robot, Liar)}

    def shields(self) -> list[list[tuple[int, float]]]:
        """Return for each robot the auditors whose tokens it holds, with seconds left, longest first. Source: §3.5."""
        return [shields(self.world, i) for i in range(len(self.ids))]

    def new_verdicts(self) -> list[Verdict]:
        """Return the audits that ended since the last call: time s, auditor, auditee, refusal or NONE."""
        return self._verdicts.new()

    def summary(self) -> dict[str, Any]:
        """Return the summary that `phalanx sim run --json` prints. Source: RoboRebound §5.2, §5.3."""
        world, counts = self.world, self.world.air.counts
        n, seconds = len(self.ids), max(self.now_s, 1e-9)
        alone = self._quorum.stopped_without()
        wronged = self._correct & self.in_safe_mode & ~alone

        def each(count: NDArray[np.int64]) -> dict[str, float]:
            """Return the mean per robot and second, for the application's and for audit packets."""
            kinds = {"app": APP_BROADCAST, "audit": AUDIT_BROADCAST}
            return {name: float(count[:, first : first + 2].sum()) / n / seconds for name, first in kinds.items()}

        digest = self._digest.copy()
        digest.update(f"{world.clock[0].now_us} {world.clock[0].contacts}".encode())
        for part in (world.pos, world.vel, world.safe, counts, world.verdicts):
            digest.update(part.tobytes())
        return {
            "robots": n,
            "duration_s": self.now_s,
            "seed": self.scenario.seed,
            "defence": self.scenario.defence,
            "digest": digest.hexdigest(),
            "mean_distance_to_goal_m": self._mean_distance_m(),
            "distance_series": list(self._distances),
            "compromised": [self._summed(i, liar) for i, liar in sorted(self.robots.items()) if isinstance(liar, Liar)],
            "correct_in_safe_mode": [int(each) for each in self.ids[wronged]],
            "without_quorum": [int(each) for each in self.ids[alone]],
            "contacts": int(world.clock[0].contacts),
            "bytes_per_s_per_robot": each(counts[:, :, BYTES]),
            "tried_bytes_per_s_per_robot": each(world.air.tried),
            "airtime_pct_per_robot": {name: us / 1e4 for name, us in each(counts[:, :, AIRTIME_US]).items()},
            "log_bytes_max": int(world.fleet.robot["log_max"].max()),
            "broadcast_delivery": _known(delivery(world.air, APP_BROADCAST)),
            "unicast_delivery": _known(delivery(world.air, AUDIT_UNICAST)),
            **({"task": {self.stage.counts: self.stage.score_so_far(self.compromised)}} if self.stage else {}),
            "real_time_factor": seconds / self._wall_s if self._wall_s else None,
        }

    def _summed(self, i: int, liar: Liar) -> dict[str, Any]:
        boot_ms = int(self.world.boot_us[i]) // 1000
        deviated, safe_us = liar.first_deviation_ms, int(self.world.safe_us[i])
        return {
            "robot": i + 1,
            "attack": liar.attack.name,
            "first_deviation_s": None if deviated is None else (deviated - boot_ms) / 1000,
            "safe_mode_s": None if safe_us < 0 else safe_us / 1e6,
        }


def _known(share: float) -> float | None:
    """Return a share, or None for NaN, which JSON cannot represent."""
    return None if math.isnan(share) else share
