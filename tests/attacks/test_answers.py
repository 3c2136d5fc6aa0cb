"""True tokens that are not what was asked for, true requests that are asked again, and logs that liars fill.

For each hole of "a second look" in docs/reference/attacks.md, at least one of these tests fails where it is opened again.
"""

from __future__ import annotations

import pytest
from asking import BOOT_MS, GRANT_MS, ROUND_MS, VICTIM, Asking
from caught import Judge
from trials import F_MAX, attacked, run, scenario

from phalanx.bti.fleet import PENDING, START
from phalanx.bti.refusal import Refusal
from phalanx.config import BtiConfig
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.fields import put_u32


def test_a_token_from_before_the_request_is_no_answer_to_it():
    """While the same checkpoint is pending, so that the token covers what was claimed."""
    asking = Asking()
    asking.round_begins(BOOT_MS)
    issued = {}
    for k in range(F_MAX):
        now_ms = BOOT_MS + (k + 1) * GRANT_MS
        auditor, q = asking.ask(now_ms)
        issued[auditor] = asking.token(auditor, q, PENDING)
        assert asking.gets(issued[auditor], now_ms) == k + 1
    later_ms = BOOT_MS + ROUND_MS
    asking.round_begins(later_ms)
    auditor, q = asking.ask(later_ms)
    assert asking.gets(issued[auditor], later_ms + 1) == 0
    assert asking.gets(asking.token(auditor, q, PENDING), later_ms + 2) == 1


def test_a_fresh_token_for_where_the_log_begins_is_no_answer():
    asking = Asking()
    asking.round_begins(BOOT_MS)
    for k in range(F_MAX + 1):
        now_ms = BOOT_MS + (k + 1) * GRANT_MS
        auditor, q = asking.ask(now_ms)
        asking.gets(asking.token(auditor, q, PENDING), now_ms)
    assert not asking.robot.booted
    asking.hears(now_ms)
    later_ms = BOOT_MS + ROUND_MS
    asking.round_begins(later_ms)
    auditor, q = asking.ask(later_ms)
    assert asking.gets(asking.token(auditor, q, START), later_ms + 1) == 0
    assert asking.gets(asking.token(auditor, q, PENDING), later_ms + 2) == 1


@pytest.mark.parametrize("name", ["stale-answers", "wrong-checkpoint", "drain", "long-frames"])
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_f_max_of_them_starve_nobody_on_the_paper_s_grid(name, seed):
    liars = tuple(AttackSpec(name=name, at_s=5.0) for _ in range(F_MAX))
    summary = run(Scenario(name="grid", robots=25, seed=seed, duration_s=45.0, attacks=liars)).summary()
    assert summary["correct_in_safe_mode"] == summary["without_quorum"] == []


def test_one_token_request_is_audited_once_however_often_it_is_sent():
    trial = attacked("drain", "hardened")
    made, sent = sum(len(liar.kept) for liar in trial.liars), sum(liar.gained for liar in trial.liars)
    assert 0 < trial.refusals[Refusal.AUTHENTICATOR_INVALID] <= made < sent / 5


@pytest.mark.parametrize("t_audit_ms", [5000, 6000])
def test_f_max_robots_that_say_all_they_may_do_not_fill_the_logs_of_five(t_audit_ms):
    """Rounds that are rare, and few to ask: the logs grow longest."""
    liars = tuple(AttackSpec(name="long-frames", at_s=5.0) for _ in range(F_MAX))
    bti = BtiConfig(t_audit_ms=t_audit_ms)
    made = Scenario(name="few", robots=8, grid_step_m=20.0, duration_s=40.0, bti=bti, attacks=liars)
    ended = run(made)
    summary = ended.summary()
    assert not ended.world.fleet.robot["log_full"].any()
    assert summary["correct_in_safe_mode"] == summary["without_quorum"] == []
    assert all(told["safe_mode_s"] is not None for told in summary["compromised"])


def test_a_mission_key_of_tomorrow_is_refused_even_with_an_empty_log():
    """Nothing heard yet that gives it away: such a log would have been vouched for, and no reading due for 49 days."""
    now_ms = BOOT_MS + GRANT_MS
    for t_key_ms, verdict in ((now_ms, Refusal.NONE), ((1 << 32) - (1 << 16), Refusal.OUT_OF_ORDER)):
        asking = Asking()
        asking.robot.t_key = t_key_ms
        put_u32(asking.fleet.checkpoint[VICTIM, START], 0, t_key_ms)
        asking.round_begins(now_ms)
        auditor, q = asking.ask(now_ms)
        refused, _ = Judge(asking.fleet, asking.config)(VICTIM, auditor - 1, q)
        assert Refusal(refused) == verdict


def test_a_key_of_tomorrow_claimed_from_boot_on_ends_with_the_time_of_grace():
    summary = run(scenario("hardened", AttackSpec(name="t-key", at_s=0.0), end_s=15)).summary()
    assert summary["compromised"][0]["safe_mode_s"] == pytest.approx(10.0, abs=0.2)
