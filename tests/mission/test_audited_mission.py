"""Missions under bounded-time interaction: honest robots complete them, and who cheats is stopped in time."""

from __future__ import annotations

import math
from collections import Counter
from functools import cache

import pytest
from audited import ELSEWHERE, PLAN, ROBOTS, STORE, cheating, errand, everybody, swarm, two_halves
from worlds import BOTH

from phalanx.bti.refusal import Refusal
from phalanx.errors import UsageError
from phalanx.mission import Experience, Phase, Profile
from phalanx.robot.attacks import ON_MISSIONS
from phalanx.robot.controllers.mission.controller import Assignment, Missions
from phalanx.sim.missions.protected import MissionSwarm, ProtectedMission

CHEATS = [name for name, attack in ON_MISSIONS.items() if attack.scene == "team"]
both = pytest.mark.parametrize("profile", BOTH)
AFTER_S = 13.0  # the lobby's door is decoded by then, and the store's is not
EARLY_S = 1.0
END_S = 30.0
REFUSED = {
    "skip-node": {Refusal.OUTPUT_WRONG},
    "drive-dark": {Refusal.OUTPUT_WRONG},
    "show-unsensed": {Refusal.EVIDENCE_WRONG},
    "forge-claim": {Refusal.EVIDENCE_WRONG},
}


@cache
def honest(profile: Profile, defence: str = "bound") -> ProtectedMission:
    run = swarm(profile, defence)
    run.advance(END_S)
    return run


@cache
def cheated(name: str, profile: Profile, defence: str) -> ProtectedMission:
    run = cheating(ON_MISSIONS[name].kind, profile, defence, EARLY_S if name == "skip-node" else AFTER_S)
    run.advance(END_S)
    return run


@both
def test_honest_robots_complete_their_mission_and_none_is_stopped(profile):
    run = honest(profile)
    summary = run.summary()
    assert summary["completed"] == ROBOTS
    assert summary["in_safe_mode"] == []
    assert Counter(why for *_, why in run.new_verdicts()).keys() == {Refusal.NONE}
    # Each has been in both doors, done both things there, and stands near the second.
    for body in run.bodies:
        assert len(body.actions) == 2
        assert math.dist(body.wheels.pose[:2], (STORE.x_m, STORE.y_m)) < 4.0


@both
def test_who_audits_holds_no_key(profile):
    run = honest(profile)
    for rob_id in range(1, ROBOTS + 1):
        make = run.robots[rob_id - 1].make_controller
        other = make(rob_id % ROBOTS + 1)
        _, claims = other.walker.look(other.memory.walk, Experience(1.0, *PLAN.start))
        assert (claims == ()) == (profile is Profile.SEALED), "in the paper profile there are no keys"
    if profile is Profile.SEALED:
        with pytest.raises(UsageError, match="without its start key"):
            everybody(errand(profile)).controllers_of(1, None)


@pytest.mark.parametrize("profile", BOTH)
@pytest.mark.parametrize("name", CHEATS)
def test_a_cheat_is_stopped_within_the_bound_and_nobody_else_is(name, profile):
    run = cheated(name, profile, "bound")
    liar = run.robots[0]
    assert liar.first_deviation_ms is not None
    began_s = liar.first_deviation_ms / 1000 - int(run.world.boot_us[0]) / 1e6
    bti = run.bti
    bound_ms = bti.t_val_ms + bti.p_check_ms + 1 + (bti.delta_ms + bti.skew_ms) * liar.output_missing
    assert began_s >= EARLY_S
    assert run.stopped_s(1) is not None
    assert 0 <= run.stopped_s(1) - began_s <= bound_ms / 1000
    assert run.summary()["in_safe_mode"] == [1]
    reasons = {why for _, _, tee, why in run.new_verdicts() if tee == 1}
    assert reasons - {Refusal.NONE} == REFUSED[name]


@pytest.mark.parametrize("profile", BOTH)
@pytest.mark.parametrize("name", CHEATS)
def test_without_audits_each_cheat_bites(name, profile):
    run, beside = cheated(name, profile, "none"), honest(profile, "none")
    assert run.summary()["in_safe_mode"] == []
    body, twin = run.bodies[0], beside.bodies[0]
    walk = run.controller(1).memory.walk
    if name == "drive-dark":
        assert math.dist(body.wheels.pose[:2], ELSEWHERE) < 1.0
        assert math.dist(twin.wheels.pose[:2], ELSEWHERE) > 5.0
        return
    assert walk.phase is Phase.DONE
    done = [action[11:] for action in body.actions]
    if name == "skip-node":
        assert done == [twin.actions[1][11:]], "it has never inspected the lobby"
    else:
        assert done == [action[11:] for action in twin.actions]
        assert math.dist(body.wheels.pose[:2], twin.wheels.pose[:2]) > 1.0, "it picked from where there is no shelf"


def test_the_protocol_as_printed_carries_missions_too():
    run = honest(Profile.PAPER, "paper")
    assert run.summary()["completed"] == ROBOTS
    assert run.summary()["in_safe_mode"] == []
    lied = cheated("forge-claim", Profile.PAPER, "paper")
    assert lied.summary()["in_safe_mode"] == [1]


@both
def test_two_robots_whose_halves_only_a_message_joins_complete_them_and_are_audited_by_all(profile):
    halves = two_halves(profile)
    assigned = {i: Assignment(halves[i % 2].mission, PLAN.start) for i in range(1, ROBOTS + 1)}
    keys = {i: halves[i % 2].key for i in assigned}
    run = ProtectedMission(MissionSwarm(plan=PLAN, missions=Missions(assigned), keys=keys))
    run.advance(END_S)
    summary = run.summary()
    assert summary["completed"] == ROBOTS
    assert summary["in_safe_mode"] == []
    assert summary["bytes_per_s_per_robot"]["app"] > 0
    assert {why for *_, why in run.new_verdicts()} == {Refusal.NONE}


def test_storage_does_not_grow_once_a_mission_is_done():
    run = swarm(Profile.PAPER)
    run.advance(40.0)
    early = run.summary()
    run.advance(90.0)
    late = run.summary()
    assert late["log_bytes_max"] == early["log_bytes_max"]
    assert late["checkpoint_bytes_max"] <= run.bti.checkpoint_capacity_bytes
    assert late["in_safe_mode"] == []


def test_the_same_seed_gives_the_same_logs_to_the_byte_and_another_others():
    logs = []
    for seed in (4, 4, 5):
        run = swarm(Profile.PAPER, seed=seed)
        run.advance(12.0)
        logs.append(run.world.fleet.log.tobytes())
    assert logs[0] == logs[1] != logs[2]


def test_robots_without_a_mission_or_too_few_of_them_are_refused():
    missions = everybody(errand(Profile.PAPER), 2)
    with pytest.raises(UsageError, match="2 robots"):
        MissionSwarm(plan=PLAN, missions=missions)
    gap = Missions({1: missions.assigned[1], 3: missions.assigned[1], 4: missions.assigned[1]})
    with pytest.raises(UsageError, match="robot 2"):
        MissionSwarm(plan=PLAN, missions=gap)
