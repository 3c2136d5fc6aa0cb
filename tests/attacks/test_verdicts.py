"""Each attack does what it says under no defence, under the paper's and under ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from trials import AT_S, F_MAX, MOST_TAKEN, attacked, check, honest, run, scenario

from phalanx.attacks import IN_FLOCKS
from phalanx.bti.refusal import Refusal
from phalanx.config.defence import DEFENCES
from phalanx.lab.scorecard.flock_trial import stop_bound_s
from phalanx.robot.adversary.liar import Plan, lying
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.world.audited.world import PYTHON, clock_ms
from phalanx.world.scenarios.run import Run

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "attacks.md"
# Why auditors refuse, where the attack is about what they are shown.
REFUSED_FOR = {
    "spoof": Refusal.OUTPUT_UNCALLED,
    "false-state": Refusal.OUTPUT_UNCALLED,
    "seize-orders": Refusal.OUTPUT_UNCALLED,
    "omit-sends": Refusal.OUTPUT_LATE,
    "hijack": Refusal.OUTPUT_WRONG,
    "drop-entries": Refusal.A_CHAIN,
    "alter-entries": Refusal.S_CHAIN,
    "reorder-entries": Refusal.A_CHAIN,
    "insert-entries": Refusal.A_CHAIN,
    "truncate-log": Refusal.S_CHAIN,
    "forge-checkpoint": Refusal.TOKEN_INVALID,
    "swap-nodes": Refusal.REQUEST_INVALID,
    "stale-log": Refusal.REQUEST_INVALID,
    "starve-sensors": Refusal.INPUT_MISSING,
    "t-key": Refusal.OUT_OF_ORDER,
    "long-frames": Refusal.OUTPUT_UNCALLED,
    "request-flood": Refusal.MALFORMED,
}
HOLES_OF_THE_PAPER = {
    "stale-log", "zero-key", "request-flood", "frame-flood", "covert-talk", "ghost-auditors", "interleave",
    "starve-sensors", "log-flood", "long-frames", "expel",
}  # fmt: skip


# Each against ours; a hole of the paper against that too. An attack that does nothing would not be stopped, but it would
# be harmless: what ours does not stop runs in turn against one of the others. The rest when there is time.
def needed(i: int, name: str) -> set[str]:
    if name in HOLES_OF_THE_PAPER:
        return {"hardened", "paper"}
    stopped = IN_FLOCKS[name].verdicts["hardened"] == "stopped"
    return {"hardened"} if stopped else {"hardened", "paper" if i % 2 else "none"}


TRIED = [
    pytest.param(name, defence, marks=() if defence in needed(i, name) else pytest.mark.long)
    for i, name in enumerate(IN_FLOCKS)
    for defence in DEFENCES
]


@pytest.mark.parametrize(("name", "defence"), TRIED)
def test_the_attack_comes_to_what_it_declares(name, defence):
    trial = attacked(name, defence)
    check(trial, IN_FLOCKS[name].verdicts[defence])
    if defence == "hardened" and name in REFUSED_FOR:
        assert trial.refusals[REFUSED_FOR[name]] > 0
    if defence == "hardened" and name == "interleave":  # which of them depends on when others spoke
        assert trial.refusals[Refusal.INPUT_OFF_GRID] + trial.refusals[Refusal.OUT_OF_ORDER] > 0


def test_the_holes_of_the_printed_protocol_are_open_in_it_and_closed_in_ours():
    for name in HOLES_OF_THE_PAPER:
        assert IN_FLOCKS[name].verdicts["paper"] == "bites"
        assert IN_FLOCKS[name].verdicts["hardened"] in ("stopped", "limited")
    assert {name for name, kind in IN_FLOCKS.items() if kind.verdicts["paper"] == "bites"} == HOLES_OF_THE_PAPER


def test_the_strong_spoof_holds_the_flock_further_away_than_the_plain_one():
    plain, strong = attacked("spoof", "none"), attacked("spoof", "none", strong=1)
    assert strong.harm > 1.1 * plain.harm


@pytest.mark.parametrize("defence", ["paper", "hardened"])
def test_with_an_a_node_nobody_can_be_addressed_alone(defence):
    plain, strong = attacked("spoof", defence), attacked("spoof", defence, strong=1)
    np.testing.assert_array_equal(strong.run.positions_m, plain.run.positions_m)
    trial = attacked("equivocate", defence)
    assert trial.run.world.air.counts[trial.liars[0].i, 1].sum() == 0, "no unicast but of AUDIT packets"


@pytest.mark.parametrize("name", ["forge-tokens", "share-tokens", "self-issue"])
@pytest.mark.parametrize("defence", ["paper", "hardened"])
def test_no_token_comes_of_guessing_sharing_or_asking_oneself(name, defence):
    assert attacked(name, defence).liars[0].gained == 0


def test_an_old_token_is_taken_and_does_not_help():
    assert attacked("replay-tokens", "hardened").liars[0].gained > 0


def test_requests_to_one_that_refuses_are_in_vain():
    assert attacked("refuse-to-audit", "hardened").liars[0].gained > 0


def test_f_max_plus_two_compromised_robots_keep_each_other_alive():
    """Each gets f_max + 1 tokens from the others; so the bound is not met for another reason."""
    crowd = [AttackSpec(name="collude", at_s=AT_S, robot=rob_id) for rob_id in range(1, F_MAX + 3)]
    many, few = scenario("hardened", *crowd), scenario("hardened", *crowd[:F_MAX])
    assert all(told["safe_mode_s"] is None for told in run(many).summary()["compromised"])
    assert all(told["safe_mode_s"] is not None for told in run(few).summary()["compromised"])
    assert stop_bound_s(few, output_missing=False) == 10.101
    assert stop_bound_s(many, output_missing=False) is None, "nothing is promised"


@pytest.mark.parametrize("name", ["frame-flood", "covert-talk"])
def test_a_flood_pours_what_its_bucket_has_for_ever_and_where_there_is_none_many_times_that(name):
    (limited,), (free,) = attacked(name, "hardened").airtime, attacked(name, "paper").airtime
    assert 0.85 * limited.bucket_s < limited.used_s <= limited.bucket_s
    assert free.used_s > 10 * limited.bucket_s


def test_auditors_look_at_as_many_requests_of_one_robot_as_they_take_and_at_more_where_names_are_free():
    limited, free = attacked("request-flood", "hardened").taken_up, attacked("request-flood", "paper").taken_up
    assert len(free) == 11
    assert len(limited) >= 11 - (F_MAX + 1), "those that it asks for its own audits take no other of it"
    assert all(MOST_TAKEN / 2 < taken <= MOST_TAKEN for taken in limited.values())
    assert max(free.values()) > 2 * MOST_TAKEN


@pytest.mark.parametrize(
    "name", ["request-flood", "frame-flood", "covert-talk", "slot-squat", "log-flood", "refuse-to-audit"]
)
@pytest.mark.parametrize("seeds", [range(1), pytest.param(range(1, 3), marks=pytest.mark.long)])
def test_f_max_of_them_starve_nobody(name, seeds):
    """Three flooders once used up what auditors take, and three squatters all places for requests under way."""
    for seed in seeds:
        liars = [AttackSpec(name=name, at_s=AT_S) for _ in range(F_MAX)]
        summary = run(scenario("hardened", *liars, robots=25, seed=seed)).summary()
        assert summary["correct_in_safe_mode"] == summary["without_quorum"] == []
        if IN_FLOCKS[name].verdicts["hardened"] == "limited":
            assert all(told["safe_mode_s"] is None for told in summary["compromised"])


def test_a_robot_that_polls_no_sensor_from_boot_on_is_stopped_too():
    summary = run(scenario("hardened", AttackSpec(name="starve-sensors", at_s=0.0), end_s=15)).summary()
    assert summary["compromised"][0]["safe_mode_s"] == pytest.approx(10.0, abs=0.2)


def test_misbehaviour_in_the_time_of_grace_ends_with_it():
    summary = run(scenario("hardened", AttackSpec(name="hijack", at_s=0.0), end_s=15)).summary()
    assert summary["compromised"][0]["safe_mode_s"] == pytest.approx(10.0, abs=0.2)


def test_an_attack_that_is_over_before_an_audit_is_found_all_the_same():
    brief = AttackSpec(name="hijack", at_s=AT_S, until_s=AT_S + 0.3)
    summary = run(scenario("hardened", brief)).summary()
    assert summary["compromised"][0]["safe_mode_s"] is not None


@pytest.mark.parametrize("defence", DEFENCES)
def test_before_it_lies_a_liar_is_an_honest_robot(defence):
    """Python events and compiled ones give the same bytes."""
    never = run(scenario(defence, AttackSpec(name="hijack", at_s=1000.0)))
    assert never.summary()["compromised"][0]["first_deviation_s"] is None
    np.testing.assert_array_equal(never.positions_m, honest(defence).positions_m)


def test_a_robot_taken_over_on_its_way_is_honest_until_it_lies():
    made = scenario("hardened")
    running = Run(made)
    running.advance(7.3)
    start_ms = clock_ms(running.world, 3) + 2000
    plan = Plan(tuple(range(1, 13)), made.goal_m, (), start_ms, 1 << 40, np.random.default_rng(0))
    liar = running.robots[3] = lying(IN_FLOCKS["hijack"], running.world.fleet, 3, running.world.work, plan)
    running.world.runs[3] = PYTHON
    running.advance(9.2)
    assert liar.first_deviation_ms is None
    running.advance(20)
    assert start_ms <= liar.first_deviation_ms <= start_ms + 250
    assert running.in_safe_mode.nonzero()[0].tolist() == [3]
    places = running.positions_m.copy()
    running.advance(running.now_s + 2)
    stands = (running.positions_m == places).all(axis=1)
    assert stands.nonzero()[0].tolist() == [3]  # and the others fly on


def test_the_page_about_attacks_has_each_with_its_verdicts():
    rows = {}
    for line in PAGE.read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 6 and cells[0].startswith("`"):
            rows[cells[0].strip("`")] = cells[1:]
    assert list(rows) == list(IN_FLOCKS)
    for name, (_, *verdicts, _) in rows.items():
        for defence, words in zip(DEFENCES, verdicts):
            assert words.startswith(IN_FLOCKS[name].verdicts[defence])
