"""Missions under bounded-time interaction: honest robots complete them, and who cheats is stopped in time."""

from __future__ import annotations

import math
from collections import Counter
from functools import cache

import pytest

from audited import ELSEWHERE_M, PLAN, ROBOTS, STORE, cheating, errand, swarm, told, two_halves
from phalanx.attacks import ON_MISSIONS
from phalanx.bti.log import logged
from phalanx.bti.refusal import Refusal
from phalanx.errors import UsageError
from phalanx.mission import Experience, Phase, Profile
from phalanx.robot.adversary.mission_cheat import CheatPlan
from phalanx.world.missions.setup import MissionRun, Part
from phalanx.world.missions.world import MissionWorld
from worlds import BOTH

CHEATS = [name for name, attack in ON_MISSIONS.items() if attack.scene == "team"]
both = pytest.mark.parametrize("profile", BOTH)
# Each in one profile; in the other too when there is time.
CHEATED = pytest.mark.parametrize(
    ("name", "profile"),
    [
        pytest.param(name, profile, marks=() if profile is BOTH[i % 2] else pytest.mark.long)
        for i, name in enumerate(CHEATS)
        for profile in BOTH
    ],
)
AFTER_S = 13.0  # the lobby's door is decoded by then, and the store's is not
EARLY_S = 1.0
END_S = 30.0
REFUSED = {
    "skip-node": {Refusal.OUTPUT_WRONG},
    "drive-dark": {Refusal.OUTPUT_WRONG},
    "show-unsensed": {Refusal.EVIDENCE_WRONG},
    "forge-claim": {Refusal.EVIDENCE_WRONG},
}


def run_of(parts: tuple[Part, ...], **more) -> MissionWorld:
    return MissionWorld(MissionRun(**{"plan": PLAN, "parts": parts, "robots": ROBOTS, "defence": "hardened", **more}))


@cache
def honest(profile: Profile, defence: str = "hardened") -> MissionWorld:
    run = swarm(profile, defence)
    run.advance(END_S)
    return run


@cache
def cheated(name: str, profile: Profile, defence: str) -> MissionWorld:
    run = cheating(ON_MISSIONS[name].kind, profile, defence, EARLY_S if name == "skip-node" else AFTER_S)
    run.advance(END_S)
    return run


@both
def test_honest_robots_complete_their_mission_and_none_is_stopped(profile):
    run = honest(profile)
    summary = told(run)
    assert summary["completed"] == ROBOTS
    assert summary["in_safe_mode"] == []
    assert summary["false_fixes"] == 0
    assert Counter(why for *_, why in run.new_verdicts()).keys() == {Refusal.NONE}
    # Each has been in both doors, done both things there, and stands near the second.
    for body in (robot.body for robot in run.robots):
        assert len(body.actions) == 2
        assert math.dist(body.wheels.pose[:2], (STORE.x_m, STORE.y_m)) < 4.0


@both
def test_who_audits_holds_no_key(profile):
    run = honest(profile)
    for rob_id in range(1, ROBOTS + 1):
        make = run.robots[rob_id - 1].inner.make_controller
        other = make(rob_id % ROBOTS + 1)
        _, claim, _ = other.walker.look(other.memory.walk, Experience(1.0, *PLAN.start))
        assert (claim is None) == (profile is Profile.SEALED), "in the paper profile there are no keys"
    if profile is Profile.SEALED:
        with pytest.raises(UsageError, match="without its start key"):
            run_of((Part(errand(profile).mission, None, PLAN.start),))


@CHEATED
def test_a_cheat_is_stopped_within_the_bound_and_nobody_else_is(name, profile):
    run = cheated(name, profile, "hardened")
    liar = run.robots[0].inner
    assert liar.first_deviation_ms is not None
    began_s = liar.first_deviation_ms / 1000 - int(run.world.boot_us[0]) / 1e6
    bti = run.bti
    bound_ms = bti.t_val_ms + bti.p_check_ms + 1 + (bti.delta_ms + bti.skew_ms) * liar.output_missing
    assert began_s >= EARLY_S
    assert run.stopped_s(0) is not None
    assert 0 <= run.stopped_s(0) - began_s <= bound_ms / 1000
    assert told(run)["in_safe_mode"] == [1]
    reasons = {why for _, _, auditee, why in run.new_verdicts() if auditee == 1}
    assert reasons - {Refusal.NONE} == REFUSED[name]


@CHEATED
def test_without_audits_each_cheat_bites(name, profile):
    run, beside = cheated(name, profile, "none"), honest(profile, "none")
    assert told(run)["in_safe_mode"] == []
    body, twin = run.robots[0].body, beside.robots[0].body
    walk = run.robots[0].controller.memory.walk
    if name == "drive-dark":
        assert math.dist(body.wheels.pose[:2], ELSEWHERE_M) < 1.0
        assert math.dist(twin.wheels.pose[:2], ELSEWHERE_M) > 5.0
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
    assert told(run)["completed"] == ROBOTS
    assert told(run)["in_safe_mode"] == []
    lied = cheated("forge-claim", Profile.PAPER, "paper")
    assert told(lied)["in_safe_mode"] == [1]


@pytest.mark.parametrize("profile", [Profile.SEALED, pytest.param(Profile.PAPER, marks=pytest.mark.long)])
def test_two_robots_whose_halves_only_a_message_joins_complete_them_and_are_audited_by_all(profile):
    halves = two_halves(profile)
    run = run_of(tuple(Part(half.mission, half.key, PLAN.start) for half in halves))
    run.advance(END_S)
    summary = told(run)
    assert summary["completed"] == ROBOTS
    assert summary["in_safe_mode"] == []
    assert summary["bytes_per_s_per_robot"]["app"] > 0
    assert {why for *_, why in run.new_verdicts()} == {Refusal.NONE}


def test_storage_does_not_grow_once_a_mission_is_done():
    run = swarm(Profile.PAPER)
    run.advance(40.0)
    early = told(run)
    run.advance(65.0)
    late = told(run)
    assert late["log_bytes_max"] == early["log_bytes_max"]
    assert late["checkpoint_bytes_max"] <= run.bti.checkpoint_capacity_bytes
    assert late["in_safe_mode"] == []


def test_the_same_seed_gives_the_same_logs_to_the_byte_and_another_others():
    logs = []
    for seed in (4, 4, 5):
        run = swarm(Profile.PAPER, seed=seed)
        run.advance(8.0)
        logs.append([logged(run.world.fleet, i) for i in range(len(run.world.fleet.robot))])
    assert logs[0] == logs[1] != logs[2]


def test_too_few_robots_and_what_no_audit_can_show_are_refused():
    part = Part(errand(Profile.PAPER).mission, None, PLAN.start)
    with pytest.raises(UsageError, match="2 robots"):
        run_of((part,), robots=2)
    with pytest.raises(UsageError, match="33 robots"):
        run_of((part,), robots=33)
    with pytest.raises(UsageError, match="between robots that meet"):
        run_of((part,), meet_m=5.0)


def test_robots_that_set_out_later_wait_and_are_audited_meanwhile():
    run = swarm(Profile.PAPER, apart_s=5.0, begin_s=1.8e9)  # a clock that shows the year
    run.advance(4.5)
    assert [robot.report.decoded != [] for robot in run.robots] == [True, False, False, False, False]
    run.advance(60.0)
    assert told(run)["completed"] == ROBOTS
    assert told(run)["in_safe_mode"] == []
    assert {why for *_, why in run.new_verdicts()} == {Refusal.NONE}


def test_a_robot_that_is_taken_over_in_the_middle_drives_elsewhere_and_is_stopped():
    run = swarm(Profile.PAPER)
    run.advance(AFTER_S)
    run.compromise(1, ON_MISSIONS["drive-dark"], CheatPlan(after_ms=0, toward_m=ELSEWHERE_M))
    run.advance(END_S)
    assert told(run)["in_safe_mode"] == [2]
    assert AFTER_S < run.stopped_s(1) < AFTER_S + run.bti.t_val_ms / 1000 + 0.5
    assert {why for _, _, auditee, why in run.new_verdicts() if auditee == 2} == {Refusal.NONE, Refusal.OUTPUT_WRONG}


def test_a_station_in_the_middle_says_what_the_controller_says():
    halves = two_halves(Profile.PAPER)
    second = halves[1]
    said = (halves[0].mission.nodes[1].aliases[0].mark,)
    run = run_of((Part(second.mission, second.key, PLAN.start),), controller=said)
    run.advance(3.0)
    assert all(robot.controller.memory.walk.heard == said for robot in run.robots)
    run.advance(15.0)
    assert {why for *_, why in run.new_verdicts()} == {Refusal.NONE}
