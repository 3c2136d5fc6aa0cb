"""Small audited missions in the office: robots go from the entrance through the lobby's door to the store's."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from phalanx.attacks.missions.cheat import DriveDark
from phalanx.lab.scorecard import team_trial
from phalanx.lab.scorecard.team_trial import ELSEWHERE_M, LOBBY, STORE, STORE_WALL
from phalanx.mission import Action, BuildOptions, Draft, Position, Profile, Walker, build
from phalanx.mission.landmarks.lidar import Lidar
from phalanx.mission.walk.state import Keyring
from phalanx.robot.adversary.mission_cheat import CheatPlan, MissionCheat
from phalanx.robot.controllers.mission.controller import Assignment, Missions
from phalanx.robot.controllers.mission.readings import Sensors
from phalanx.world.building.floorplan import load_floorplan
from phalanx.world.building.odometry import OdometryNoise
from phalanx.world.missions.body import Building, MissionBody
from phalanx.world.missions.report import summary
from phalanx.world.missions.setup import MissionRun, Part
from phalanx.world.missions.world import MissionWorld
from phalanx.world.radio.channel import APP_BROADCAST, AUDIT_BROADCAST, BYTES
from worlds import CHEAP, built, draws

PLAN = load_floorplan("office_40x40")
POOL = (Action("inspect"), Action("pick", (("shelf", 3),)))
SENSORS = Sensors()
ROBOTS = 5


@cache
def errand(profile: Profile):
    """Built: start, lobby (inspect), store (pick; final)."""
    return built(team_trial.errand(PLAN, CHEAP if profile is Profile.SEALED else None, POOL), profile)


@cache
def two_halves(profile: Profile):
    """Built: b's store opens by the message that a sends when it has been in the lobby."""
    draft = Draft("two", coding=CHEAP if profile is Profile.SEALED else None)
    for part in "ab":
        draft.node(f"{part} start", Position(*PLAN.start[:2]), start=True, part=part)
        draft.node(f"{part} lobby", LOBBY, part=part, send=("seen",) if part == "a" else (), final=part == "a")
        draft.way(f"{part} start", f"{part} lobby")
    draft.node("b store", STORE, part="b", wait=("seen",), final=True)
    draft.way("b lobby", "b store")
    return build(draft.mission(), BuildOptions(profile=profile), draws())


def everybody(one, robots: int = ROBOTS) -> Missions:
    """The same mission for all, from the same place."""
    return Missions(dict.fromkeys(range(1, robots + 1), Assignment(one.mission, PLAN.start, POOL)))


def swarm(profile: Profile, defence: str = "hardened", **more) -> MissionWorld:
    one = errand(profile)
    parts = (Part(one.mission, one.key, PLAN.start),)
    return MissionWorld(MissionRun(plan=PLAN, parts=parts, robots=ROBOTS, pool=POOL, defence=defence, **more))


def told(run: MissionWorld) -> dict:
    """A run in figures so far."""
    return summary(run.run, run.finish()) | traffic(run)


def traffic(run: MissionWorld) -> dict:
    """What audits cost, and what robots say."""
    counts, robot = run.world.air.counts, run.world.fleet.robot

    def rate(first: int) -> float:
        return float(counts[:, first : first + 2, BYTES].sum()) / max(run.now_s, 1e-9) / len(run.robots)

    return {
        "bytes_per_s_per_robot": {"app": rate(APP_BROADCAST), "audit": rate(AUDIT_BROADCAST)},
        "log_bytes_max": int(robot["log_max"].max()),
        "checkpoint_bytes_max": int(robot["start_len"].max()),
        "audits": int(robot["audits_passed"].sum() + robot["audits_refused"].sum()),
    }


def imagined_store(pose) -> bytes:
    """What the lidar would say of the store's wall, were nothing before it."""
    return SENSORS.raw_of(Lidar(STORE_WALL, SENSORS.lidar).sweep(pose, np.random.default_rng(7)))


def all_gates(profile: Profile) -> Keyring:
    """The keyring of a colluding robot that has been everywhere."""
    return Recording.of(profile).controllers[-1].memory.walk.keys


def cheating(kind: type[MissionCheat], profile: Profile, defence: str, after_s: float) -> MissionWorld:
    """Robot 1 cheats."""
    plan = CheatPlan(
        after_ms=round(1000 * after_s),
        toward_m=ELSEWHERE_M if kind is DriveDark else (STORE.x_m, STORE.y_m),
        imagine=imagined_store,
        keys=all_gates(profile),
        node=1,
        onward=2,
    )
    return swarm(profile, defence, liars={0: partial(kind, plan=plan)})


@dataclass
class Step:
    step: int
    t_ms: int
    reading: bytes
    raw: bytes
    evidence: bytes
    outputs: list
    state: bytes


class Recording:
    """One robot alone, driven to the end of its mission; all that a log would hold, and more."""

    def __init__(self, profile: Profile, seconds: float = 60.0, seed: int = 0):
        self.one = errand(profile)
        self.missions = everybody(self.one, 2)
        walker = Walker(self.one.mission, self.one.key)
        self.replays = self.missions.controllers_of(2, walker)  # robot 2's: for robot 1 they hold no key
        live = self.missions.controllers_of(1, walker)(1)
        body = MissionBody(1, Building(PLAN, SENSORS.lidar), SENSORS, PLAN.start, OdometryNoise(), (seed, 1))
        self.steps: list[Step] = []
        self.boot = live.encode()
        for step in range(round(seconds * 4)):
            t_ms = 1000 + 250 * step
            body.advance(0.25 * step)
            reading, raw = body.sense(t_ms)
            evidence = live.keep(step, t_ms, reading, raw)
            outputs = live.on_evidence(step, t_ms, reading, evidence)
            for output in outputs:
                body.execute_command(output.payload)
            self.steps.append(Step(step, t_ms, reading, raw, evidence, outputs, live.encode()))
            if live.memory.walk.phase.name == "DONE":
                break
        self.body, self.controllers = body, [live]

    @classmethod
    @cache
    def of(cls, profile: Profile) -> Recording:
        return cls(profile)
