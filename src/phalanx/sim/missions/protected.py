"""Robots on encoded missions that audit each other: walls, lidars and wheels behind the events of the audited world.

Each robot's c-node runs in Python, with its own start key; the trusted nodes, the radio and the rounds of audits are
those of every protected swarm.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from phalanx.bti.audit import Work
from phalanx.bti.fleet import Fleet
from phalanx.bti.refusal import Refusal
from phalanx.config import BtiConfig
from phalanx.config.radio import RadioConfig
from phalanx.errors import UsageError
from phalanx.mission import Phase, StartKey
from phalanx.mission.landmarks import FloorPlan
from phalanx.robot.cnode import Actuate, CNode, Transmit
from phalanx.robot.controllers.mission.controller import MissionController, Missions, check_assignments
from phalanx.robot.controllers.python_controller import Controller
from phalanx.sim.audited import loop, pybot
from phalanx.sim.audited.body import POINT_MASS
from phalanx.sim.audited.events import refused
from phalanx.sim.audited.setup import PROFILES, Setup, make_world, start
from phalanx.sim.audited.watch import VerdictReader
from phalanx.sim.building.odometry import OdometryNoise
from phalanx.sim.radio.channel import APP_BROADCAST, AUDIT_BROADCAST, BYTES

from .protected_body import MissionBody

US_PER_S = 1e6
MOST_ROBOTS = 32  # in one radio range, each with a lidar of its own
NO_CONTACTS_M = 0.0

MakeCNode = Callable[[Fleet, int, Work, Callable[[int], Controller]], CNode]


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionSwarm:
    """All that decides a run.

    Args:
        plan: the building; its walls do not stop radio.
        missions: one for each robot, ids from 1.
        keys: start keys by robot id, of those missions that have one.
        bti: the audits' parameters, without what missions need beside.
        defence: "none", "paper" or "bound".
        noise: of odometry.
        seed: of all that is drawn.
        liars: what makes a compromised robot's c-node, by id.
    Raises: UsageError: a robot has no mission, or there are too many or too few.
    """

    plan: FloorPlan
    missions: Missions
    keys: Mapping[int, StartKey] = field(default_factory=dict)
    bti: BtiConfig = BtiConfig(f_max=1, n_max=8)  # noqa: RUF009  # frozen
    defence: str = "bound"
    noise: OdometryNoise = OdometryNoise()  # noqa: RUF009  # frozen
    seed: int = 0
    liars: Mapping[int, MakeCNode] = field(default_factory=dict)

    def __post_init__(self) -> None:
        least = 2 if self.defence == "none" else self.bti.f_max + 2
        if not least <= self.robots <= MOST_ROBOTS:
            raise UsageError(f"{self.robots} robots on missions that audit each other", f"{least} to {MOST_ROBOTS}")
        if self.defence not in PROFILES:
            raise UsageError(f"no defence {self.defence!r}", f"one of {', '.join(PROFILES)}")
        check_assignments(self.missions, self.robots)

    @property
    def robots(self) -> int:
        """How many."""
        return len(self.missions.assigned)


class ProtectedMission:
    """A swarm on missions, being run.

    Args:
        swarm: what runs.
    Raises: as `Walker`, for a start key that is missing or another mission's.
    """

    def __init__(self, swarm: MissionSwarm) -> None:
        self.swarm = swarm
        n, missions = swarm.robots, swarm.missions
        starts = [missions.assigned[rob_id].start for rob_id in range(1, n + 1)]
        self.bti = missions.audits(swarm.bti)
        self.world = make_world(
            Setup(
                robots=n,
                starts_m=np.array([pose[:2] for pose in starts], np.float64),
                profile=PROFILES[swarm.defence],
                controller=0,
                params=np.zeros(1),
                body=POINT_MASS,
                seed=swarm.seed,
                contact_m=NO_CONTACTS_M,
                bti=self.bti,
                radio=RadioConfig(),
            ),
            np.random.Generator(np.random.PCG64(np.random.SeedSequence([swarm.seed, 0x706D]))),
        )
        self.bodies = [
            MissionBody(i + 1, swarm.plan, missions.sensors, pose, swarm.noise, swarm.seed)
            for i, pose in enumerate(starts)
        ]
        self.robots: dict[int, CNode] = {}
        for i in range(n):
            make = missions.controllers_of(i + 1, swarm.keys.get(i + 1))
            cnode = swarm.liars.get(i + 1, CNode)
            self.robots[i] = cnode(self.world.fleet, i, self.world.work, make)
        self._verdicts = VerdictReader(self.world)
        start(self.world, self.robots)

    @property
    def now_s(self) -> float:
        """Simulated seconds so far."""
        return float(self.world.clock[0].now_us) / US_PER_S

    def advance(self, until_s: float) -> None:
        """The world at `until_s`."""
        while loop.run(self.world, round(until_s * US_PER_S)) == loop.FOR_PYTHON:
            clock = self.world.clock[0]
            if int(clock.kind) == loop.CONTROL:
                self._control(int(clock.robot))
            else:
                pybot.handle(self.world, self.robots)
        assert refused(self.world.queue) == 0, "the queue of events was too short"
        for i in range(len(self.bodies)):
            self._move(i)

    def _move(self, i: int) -> None:
        """The robot is where physics puts it now, and radio waves find it there."""
        body, safe_us = self.bodies[i], int(self.world.safe_us[i])
        if safe_us >= 0:
            body.advance(safe_us / US_PER_S)
            body.halt()
        body.advance(self.now_s)
        self.world.pos[i] = body.wheels.pose[:2]

    def _control(self, i: int) -> None:
        """A reading is due: the robot's sensors are read, its c-node acts on them. Source: RoboRebound Alg. 1."""
        self._move(i)
        cnode, now_ms = self.robots[i], loop.clock_ms(self.world, i)
        reading, cnode.raw = self.bodies[i].sense(now_ms)
        for action in cnode.on_sensor(now_ms, reading):
            if isinstance(action, Actuate):
                self.bodies[i].obey(action.command)
            elif isinstance(action, Transmit):
                pybot.perform(self.world, i, [action])

    # --- watching -----------------------------------------------------------------------------------------------------

    def controller(self, rob_id: int) -> MissionController:
        """The controller in a robot's c-node."""
        controller = self.robots[rob_id - 1].controller
        assert isinstance(controller, MissionController)
        return controller

    def stopped_s(self, rob_id: int) -> float | None:
        """When a robot was put in Safe Mode, None if it was not."""
        safe_us = int(self.world.safe_us[rob_id - 1])
        return None if safe_us < 0 else safe_us / US_PER_S

    def new_verdicts(self) -> list[tuple[float, int, int, Refusal]]:
        """Audits that ended since the last call: time s, auditor, auditee, why it got no token or NONE."""
        return self._verdicts.new()

    def summary(self) -> dict[str, Any]:
        """A run in figures."""
        counts, robot = self.world.air.counts, self.world.fleet.robot
        per_robot_s = max(self.now_s, 1e-9) * self.swarm.robots

        def rate(first: int) -> float:
            return float(counts[:, first : first + 2, BYTES].sum()) / per_robot_s

        walks = [self.controller(rob_id).memory.walk for rob_id in range(1, self.swarm.robots + 1)]
        return {
            "robots": self.swarm.robots,
            "duration_s": self.now_s,
            "defence": self.swarm.defence,
            "completed": sum(walk.phase is Phase.DONE for walk in walks),
            "decoded": [len(walk.opened) for walk in walks],
            "in_safe_mode": [i + 1 for i in np.flatnonzero(self.world.safe).tolist()],
            "bytes_per_s_per_robot": {"app": rate(APP_BROADCAST), "audit": rate(AUDIT_BROADCAST)},
            "log_bytes_max": int(robot["log_max"].max()),
            "checkpoint_bytes_max": int(robot["start_len"].max()),
            "audits": int(robot["audits_passed"].sum() + robot["audits_refused"].sum()),
        }
