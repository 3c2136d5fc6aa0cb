"""True tokens that are not what was asked for, true requests that are asked again, and logs that liars fill.

For each hole of "a second look" in docs/reference/attacks.md, at least one of these tests fails where it is opened again.
"""

from __future__ import annotations

import numpy as np
import pytest
from caught import Judge
from trials import F_MAX, attacked, run, scenario

from phalanx.bti import request, rounds, trusted
from phalanx.bti.fleet import HARDENED, PENDING, START, make_fleet
from phalanx.bti.nodes import limits_of
from phalanx.bti.refusal import Refusal
from phalanx.bti.work import make_work
from phalanx.config import BtiConfig, RadioConfig
from phalanx.config.flock import FlockConfig
from phalanx.robot import handlers
from phalanx.robot.adversary.liar import MOTION
from phalanx.robot.controllers.dispatch import NUMBERS
from phalanx.robot.controllers.flock_law import flock_params
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.fields import put_u32
from phalanx.wire.table import KIND_STATE
from phalanx.world.audited.setup import power_up

BOOT_MS = 1000
ROUND_MS = 4000
GRANT_MS = 600  # an a-node makes a token request each 571 ms
VICTIM = 0


class Asking:
    """A robot that asks for audits, and auditors that sign whatever they want to sign."""

    def __init__(self, profile=HARDENED, config=None, controller="flock", params=None):
        self.profile, self.config, n = profile, config or BtiConfig(), 8
        limits = limits_of(self.config, RadioConfig())
        nodes = power_up(n, profile, limits, np.full(n, BOOT_MS), np.random.default_rng(1), {})
        self.fleet = make_fleet(
            n,
            self.config,
            flock_params(FlockConfig(n_max=self.config.n_max)) if params is None else params,
            profile=profile,
            controller=NUMBERS[controller],
            mission_seed=5,
            snode=nodes.snode,
            anode=nodes.anode,
        )
        self.work, self.robot = make_work(self.config), self.fleet.robot[VICTIM]
        for i in range(n):
            handlers.on_boot(self.fleet, i, BOOT_MS)

    def round_begins(self, now_ms: int) -> None:
        for rob_id in range(2, 9):
            rounds.heard(self.fleet, VICTIM, rob_id, now_ms)
        rounds.begin_round(self.fleet, VICTIM, now_ms)

    def hears(self, now_ms: int) -> None:
        """So that its next checkpoint differs from its last."""
        state = bytearray(MOTION.pack(KIND_STATE, 3, now_ms, 0.0, 0.0, 0.0, 0.0))
        packet = np.frombuffer(state, np.uint8)
        assert handlers.on_packet(self.fleet, VICTIM, self.work, now_ms, packet, len(packet)) == handlers.HEARD

    def ask(self, now_ms: int) -> tuple[int, bytes]:
        """The auditor's id, and the request."""
        assert handlers.next_fragment(self.fleet, VICTIM, self.work, now_ms) > 0
        q = self.fleet.request.rows[self.robot.request_row, : int(self.robot.request_len)].tobytes()
        rounds.withdraw(self.fleet, VICTIM)
        return int(self.robot.request_to), q

    def token(self, auditor: int, q: bytes, which: int) -> tuple[int, int, np.ndarray]:
        """The auditor's, for one of the victim's checkpoints."""
        head, mac = np.frombuffer(bytearray(q), np.uint8), np.zeros(8, np.uint8)
        t = int.from_bytes(q[request.AT_T : request.AT_TOP_A], "little")
        top, treq = head[request.AT_TOP_A :][:20].copy(), head[request.AT_TREQ_MAC :][:8].copy()
        hckpt, anode = self.fleet.hckpt[VICTIM, which], self.fleet.anode[auditor - 1]
        assert trusted.anode_issue_token(self.profile, anode, VICTIM + 1, t, top, treq, hckpt, mac) >= 0
        return auditor, t, mac

    def gets(self, token: tuple[int, int, np.ndarray], now_ms: int) -> int:
        """The token is installed; how many robots have answered in this round by now."""
        assert rounds.on_token(self.fleet, VICTIM, *token, now_ms) == 0
        return int(self.robot.got)


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
