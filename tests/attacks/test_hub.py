"""Few auditors, many who need them: what an auditor takes follows its neighbours, and each has its own share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from phalanx.bti import request, rounds
from phalanx.bti.nodes import Limits
from phalanx.config import BtiConfig
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.scenario import Scenario
from phalanx.wire.table import AUDIT_FRAGMENT
from phalanx.world.scenarios.run import Run

LIAR = AttackSpec(name="refuse-to-audit", robot=1, at_s=5.0)


def star(**changes: object) -> Scenario:
    """Each in an aisle of its own hears the three where the aisles meet, of which one does not audit."""
    return replace(find_scenario("star-25"), **{"duration_s": 32.0, "attacks": (LIAR,), **changes})


def stopped(made: Scenario) -> int:
    run = Run(made)
    run.advance(made.duration_s)
    told = run.summary()
    return len(told["correct_in_safe_mode"]) + len(told["without_quorum"])


def test_two_auditors_keep_22_alive_whom_12_f_max_audits_do_not(monkeypatch):
    assert stopped(star()) == 0
    assert stopped(star(bti=BtiConfig(f_max=1, t_audit_ms=2000))) == 0
    monkeypatch.setattr(BtiConfig, "audits_taken", property(lambda bti: 12 * bti.f_max))
    assert stopped(star()) >= 20
    assert stopped(star(attacks=())) >= 15, "though nobody lies"


def test_two_that_speak_at_the_same_moment_of_each_round_hear_each_other_all_the_same():
    """Robot 17 needs both in the middle, and one of them says HELLO whenever it does itself; it was stopped."""
    made = star(hub=2, attacks=(), n_max=None, seed=195)
    moments = [rounds.mix_hash(made.seed + 1, rob_id) % made.bti.t_audit_ms for rob_id in range(1, 26)]
    assert moments[16] in moments[:2]
    assert stopped(made) == 0


class Auditor:
    """Robot 1 of a star that has just begun."""

    def __init__(self, f_max: int = 1):
        self.run = Run(star(attacks=(), bti=BtiConfig(f_max=f_max)))
        self.fleet, self.now_ms = self.run.world.fleet, 100_000

    def begins(self, src: int, no: int, now_ms: int) -> bool:
        """Whether a request is taken up; it is of two fragments, of which this is the first."""
        before = self.fleet.rx_info[0].copy()
        self.hears(src, no, 0, now_ms)
        return bool((self.fleet.rx_info[0] != before).any())

    def hears(self, src: int, no: int, index: int, now_ms: int) -> bool:
        """Whether a request of two fragments is whole now."""
        body = bytes(int(self.fleet.settings[0].packet_max) - request.FRAGMENT_HEAD_BYTES)
        packet = AUDIT_FRAGMENT.encode(src=src, dst=1, request=no, index=index, count=2, bytes=body)
        told = request.take_fragment(self.fleet, 0, np.frombuffer(bytearray(packet), np.uint8), len(packet), now_ms)
        return bool(told >= 0)


def test_a_neighbour_has_one_request_in_half_a_round_taken_up_whatever_others_do():
    auditor = Auditor()
    for k in range(8):
        now_ms = auditor.now_ms + 500 * k
        assert auditor.begins(7, k, now_ms) == (k % 4 == 0)
        assert auditor.begins(8 + k, 0, now_ms + 1), "another's is not touched"


@pytest.mark.parametrize("f_max", [1, 3, 8])
def test_f_max_liars_push_no_half_heard_request_out(f_max):
    """Nor do two honest robots that ask at the same moment; each of f_max liars had to begin one within 2 ms for that."""
    auditor, victim = Auditor(f_max), 2
    others = range(3, 5 + f_max)
    assert auditor.begins(victim, 0, auditor.now_ms)
    assert all(auditor.begins(src, 0, auditor.now_ms + 1) for src in others)
    assert auditor.hears(victim, 0, 1, auditor.now_ms + 2)


def test_liars_who_begin_requests_between_a_victims_fragments_stop_nobody():
    """`push-out`, of whom all but f_max + 2 of the middle are."""
    liars = tuple(AttackSpec(name="push-out", at_s=1.5, robot=k + 1) for k in range(8))
    made = star(hub=18, robots=27, attacks=liars, n_max=None, seed=2, duration_s=12.0, bti=BtiConfig(f_max=8))
    assert stopped(made) == 0


def test_all_neighbours_at_once_are_audited_and_no_more_than_that():
    auditor = Auditor()
    bti = auditor.run.scenario.bti
    shares = 2 * bti.t_val_ms // bti.t_audit_ms
    assert bti.n_max == 24
    taken = [
        request.admit(auditor.fleet, 0, src, share, auditor.now_ms + share)
        for share in range(1, shares + 2)
        for src in range(2, 26)
    ]
    assert sum(taken) == bti.audits_taken == 24 * shares, "its work is bounded"
    assert all(taken[: bti.audits_taken])
    assert request.admit(auditor.fleet, 0, 2, shares + 2, auditor.now_ms + bti.t_val_ms + 1), "and goes on"
    assert not request.admit(auditor.fleet, 0, 2, shares + 2, auditor.now_ms + 2 * bti.t_val_ms), "no request twice"


@pytest.mark.parametrize("n_max", [5, 24, 100])
@pytest.mark.parametrize("f_max", [1, 3])
@pytest.mark.parametrize("t_ms", [(500, 1000), (4000, 10_000)])
def test_an_a_node_lets_out_a_round_s_requests_and_the_replies_to_all_neighbours(n_max, f_max, t_ms):
    bti = BtiConfig(n_max=n_max, f_max=f_max, t_audit_ms=t_ms[0], t_val_ms=t_ms[1], packet_max_bytes=2048)
    replies = 2 * n_max
    bucket_us = Limits.of(bti, 60, 1000, 200).audit_capacity_us
    a_request_us = (bti.t_val_ms / 1000 * bti.log_bytes_per_s + bti.n_max * 26 + 366) * 0.2
    assert bucket_us >= (f_max + 1) * a_request_us + replies * 60
