"""Run a team in which one robot cheats on its mission while the others audit it; report if and why it is stopped.

Four robots drive from the office's entrance to the lobby's door, where they inspect, and to the store's, where they
pick. The cheat knows the floor plan, and the nodes that an honest robot opened in an earlier run.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from phalanx.config.defence import Defence
from phalanx.config.mission import CodingConfig
from phalanx.mission import Action, BuildOptions, Built, Draft, Landmark, Mission, Position, Profile, build
from phalanx.mission.authoring.findable import mark_lookalikes_in
from phalanx.mission.landmarks import FloorPlan
from phalanx.mission.landmarks.lidar import Lidar
from phalanx.mission.walk.state import Keyring
from phalanx.robot.adversary.attack import Attack
from phalanx.robot.adversary.mission_cheat import CheatPlan, MissionCheat
from phalanx.robot.controllers.mission.readings import Sensors
from phalanx.robot.controllers.mission.surroundings import Pose
from phalanx.world.building.floorplan import load_floorplan
from phalanx.world.missions.orders import start_of
from phalanx.world.missions.setup import MissionRun, Part
from phalanx.world.missions.world import MissionWorld

ROBOTS, F_MAX = 4, 1
LOBBY = Landmark("doorway", 9.0, 12.0, math.pi / 2)
STORE = Landmark("doorway", 11.6, 10.0, 0.0)
# The store's wall on both sides of its door: the cheat pretends to be in this building.
STORE_WALL = np.array([[9.0, 10.0, 10.9, 10.0], [12.3, 10.0, 19.0, 10.0]])
ELSEWHERE_M = (2.0, 11.0)
POOL = (Action("inspect"), Action("pick"))
# Start of `skip-node`; start of the other attacks, when the lobby's door is decoded and the store's is not.
SKIPS_AT_S, BEGINS_AT_S = 1.0, 13.0
END_S, CHUNK_S = 40.0, 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamTrial:
    """Result of a cheat in a team."""

    attack: str
    defence: str
    declared: str  # verdict that the attack declares for this defence
    deviated_s: float | None  # first deviation from an honest robot's behaviour; None if there was none
    stopped_s: float | None  # start of Safe Mode, or None
    bound_s: float | None  # largest time from deviation to Safe Mode; None without audits
    refusals: dict[str, int]  # number of refused tokens by reason
    completed: int  # number of other robots that completed their mission, of `others`
    others: int
    in_safe_mode: tuple[int, ...]  # other robots that were stopped, by number

    @property
    def broken(self) -> bool:
        """Return whether a promise was broken."""
        if self.deviated_s is None or self.in_safe_mode:
            return True
        if self.declared != "stopped":
            return self.stopped_s is not None
        assert self.bound_s is not None, "a cheat that is to be stopped is audited"
        return self.stopped_s is None or self.stopped_s - self.deviated_s > self.bound_s


def try_in_team(
    attack: Attack, defence: Defence, seed: int = 0, on_progress: Callable[[float], None] = lambda _share: None
) -> TeamTrial:
    """Run a team with a cheat of scene `team`; `on_progress` receives the completed share of the work.

    Raises: UsageError: the seed is negative.
    """
    plan = load_floorplan()
    profile = Profile.SEALED if defence == "hardened" else Profile.PAPER
    plain = mark_lookalikes_in(plan, errand(plan, CodingConfig(delta_mm=400, kdf_log2_n=2)))
    (built,) = build(plain, BuildOptions(profile=profile), random.Random(seed).randbytes)  # noqa: S311  # simulated
    honest = _world(plan, built, defence, seed)
    _run(honest, lambda share: on_progress(share / 2))
    kind: Callable[..., MissionCheat] = attack.kind
    cheat = partial(kind, plan=_plan_of(attack, honest.robots[0].controller.memory.walk.keys, seed))
    world = _world(plan, built, defence, seed, {0: cheat})
    _run(world, lambda share: on_progress((1 + share) / 2))
    liar = world.robots[0].inner
    assert isinstance(liar, MissionCheat), "the first robot runs the cheat"
    bti, began_ms, refusals = world.bti, liar.first_deviation_ms, dict[str, int]()
    for _, _, auditee, why in world.new_verdicts():
        if auditee == 1 and why:
            reason = why.name.lower().replace("_", " ")
            refusals[reason] = refusals.get(reason, 0) + 1
    reports = world.finish()[1:]
    return TeamTrial(
        attack=attack.name,
        defence=defence,
        declared=attack.verdicts[defence],
        deviated_s=None if began_ms is None else began_ms / 1000 - int(world.world.boot_us[0]) / 1e6,
        stopped_s=world.stopped_s(0),
        bound_s=bti.stop_bound_ms(output_missing=liar.output_missing) / 1000 if world.run.audited else None,
        refusals=refusals,
        completed=sum(report.done for report in reports),
        others=len(reports),
        in_safe_mode=tuple(report.robot + 1 for report in reports if report.safe_mode_s is not None),
    )


def errand(plan: FloorPlan, coding: CodingConfig | None, pool: tuple[Action, Action] = POOL) -> Mission:
    """Return the mission: from the start pose to the lobby's door and the store's, with an action at each."""
    draft = Draft("errand", coding=coding)
    draft.node("start", Position(*start_of(plan)[:2]), start=True)
    draft.node("the lobby", LOBBY, do=pool[0])
    draft.node("the store", STORE, do=pool[1], final=True)
    draft.way("start", "the lobby")
    draft.way("the lobby", "the store")
    return draft.mission()


def _world(
    plan: FloorPlan, built: Built, defence: Defence, seed: int, liars: dict[int, partial[MissionCheat]] | None = None
) -> MissionWorld:
    part = Part(built.mission, built.key, start_of(plan))
    run = MissionRun(
        plan=plan,
        parts=(part,),
        robots=ROBOTS,
        defence=defence,
        f_max=F_MAX,
        seed=seed,
        pool=POOL,
        duration_s=END_S,
        liars=liars or {},
    )
    return MissionWorld(run, range(ROBOTS))


def _run(world: MissionWorld, on_progress: Callable[[float], None]) -> None:
    while world.now_s < END_S:
        world.advance(min(END_S, world.now_s + CHUNK_S))
        on_progress(world.now_s / END_S)


def _plan_of(attack: Attack, keys: Keyring, seed: int) -> CheatPlan:
    sensors = Sensors()
    chance = np.random.default_rng([seed, ROBOTS])

    def imagine(pose: Pose) -> bytes:
        return sensors.raw_of(Lidar(STORE_WALL, sensors.lidar).sweep(pose, chance))

    return CheatPlan(
        after_ms=round(1000 * (SKIPS_AT_S if attack.name == "skip-node" else BEGINS_AT_S)),
        toward_m=ELSEWHERE_M if attack.name == "drive-dark" else (STORE.x_m, STORE.y_m),
        imagine=imagine,
        keys=keys,
        node=1,
        onward=2,
    )
