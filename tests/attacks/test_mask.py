"""`mask`: liars talk when others say HELLO. Who lacks tokens asks who is there, and each who hears it tells it alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from opened import Hole, run_with
from test_answers import BOOT_MS, ROUND_MS, VICTIM, Asking

from phalanx.bti import audit, log, request, rounds
from phalanx.bti.nodes import Limits
from phalanx.config import BtiConfig
from phalanx.robot import actions, handlers
from phalanx.robot.actions import Action, Transmit
from phalanx.robot.attacks.channel import Mask, talk
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.own import find_attacks
from phalanx.scenarios.scenario import Scenario
from phalanx.sim.scenarios.run import Run
from phalanx.wire.fields import row

DEAF = Hole(handlers, "hear_audit", "sub == request.SEEK", "False")
ASKER = 5


class Amplify(Mask):
    """What it says in the place of noise is SEEK: the answers of others are the noise."""

    SAYS = request.SEEK


class Echo(Mask):
    """Noise as ever, and at each SEEK one of its own: whoever is to answer has to answer all liars too."""

    def heard(self, now_ms: int, frame: bytes) -> list[Action]:
        asks = len(frame) == request.AUDIT_HEAD_BYTES and frame[request.AT_SUB] == request.SEEK
        return super().heard(now_ms, frame) + (talk(self, now_ms, 1, request.SEEK) if asks else [])


def star(f_max: int, seed: int, attack: str | type[Mask] = "mask") -> Scenario:
    """All 2 f_max + 2 in the middle are needed but f_max, who lie."""
    hub, (spec,) = 2 * f_max + 2, find_attacks([attack])
    return replace(
        find_scenario("star-25"),
        hub=hub,
        robots=max(25, hub + 8),
        seed=seed,
        duration_s=21.0,
        n_max=None,
        bti=BtiConfig(f_max=f_max),
        attacks=tuple(replace(spec, at_s=1.0, robot=k + 1) for k in range(f_max)),
    )


def stopped(ended: Run) -> int:
    told = ended.summary()
    assert all(liar["first_deviation_s"] is None for liar in told["compromised"]), "no log shows it"
    assert all(liar.gained > 0 for liar in ended.robots.values() if hasattr(liar, "gained")), "they talked"
    return len(told["correct_in_safe_mode"]) + len(told["without_quorum"])


@pytest.mark.parametrize("f_max", [1, 3, 5])
@pytest.mark.parametrize("seeds", [range(2), pytest.param(range(2, 20), marks=pytest.mark.long)], ids=str)
def test_liars_who_talk_whenever_others_say_hello_stop_nobody_in_a_hub(f_max, seeds):
    """Before, they stopped 598 of 1 320 correct robots in these 60 runs."""
    for seed in seeds:
        run = Run(star(f_max, seed))
        run.advance(run.scenario.duration_s)
        assert stopped(run) == 0, f"seed {seed}"


@pytest.mark.parametrize(
    "attack, seeds",
    [
        (Amplify, [2]),
        (Echo, [3]),
        pytest.param(Amplify, range(20), marks=pytest.mark.long),
        pytest.param(Echo, range(20), marks=pytest.mark.long),
    ],
)
def test_liars_who_have_others_answer_stop_nobody_either(attack, seeds):
    """Before, one robot of each of these seeds: it heard f_max + 1 others that were correct, and not all of them heard it."""
    for seed in seeds:
        run = Run(star(5, seed, attack))
        run.advance(run.scenario.duration_s)
        assert stopped(run) == 0, f"seed {seed}"


def test_where_nobody_answers_they_starve_most_of_a_hub(monkeypatch):
    made = star(2, 0)
    assert stopped(run_with(monkeypatch, replace(made, duration_s=11.0), DEAF)) >= 8
    nobody_lies = replace(made, attacks=(), duration_s=11.0)
    assert stopped(run_with(monkeypatch, nobody_lies, DEAF)) == 0, "it is not the hole alone"


class Seeking(Asking):
    """Its first round has given it nothing."""

    def __init__(self):
        super().__init__()
        rounds.begin_round(self.fleet, VICTIM)
        self.now_ms = BOOT_MS + ROUND_MS

    def senses(self, now_ms: int) -> None:
        """So that its s-chain is another."""
        handlers.take(self.fleet, VICTIM, self.work, audit.INPUT, now_ms, row(bytes(8)), 8)

    def listens_ms(self) -> int:
        """For how long, when its next round is due."""
        return int(request.listens(self.fleet, VICTIM, self.now_ms, self.work.small[1]))

    def begins(self) -> bytes:
        """What it says when that round begins."""
        rounds.begin_round(self.fleet, VICTIM)
        n = request.hello(self.fleet, VICTIM, self.now_ms, self.work.frame)
        return self.work.frame[:n].tobytes()

    def hears_seek(self, src: int, now_ms: int) -> bytes:
        """What it answers."""
        frame = row(bytes(request.AUDIT_HEAD_BYTES))
        request.audit_head(frame, src, 0, request.SEEK)
        assert handlers.on_packet(self.fleet, VICTIM, self.work, now_ms, frame, len(frame)) == handlers.NOTHING
        asked = actions.decode(self.work)
        if not asked:
            return b""
        (sent,) = asked
        assert sent == Transmit(sent.packet, src)
        return sent.packet


def audit_frame(src: int, dst: int, sub: int) -> bytes:
    frame = row(bytes(request.AUDIT_HEAD_BYTES))
    request.audit_head(frame, src, dst, sub)
    return frame.tobytes()


def test_who_lacks_tokens_seeks_and_asks_for_audits_when_it_was_answered():
    robot = Seeking()
    assert robot.listens_ms() > 0
    assert robot.begins() == audit_frame(VICTIM + 1, 0, request.SEEK)
    rounds.heard(robot.fleet, VICTIM, 3, robot.now_ms)
    assert handlers.next_fragment(robot.fleet, VICTIM, robot.work, robot.now_ms) == 0
    retry_ms = int(rounds.next_retry(robot.fleet, VICTIM, robot.now_ms))
    assert retry_ms == robot.now_ms + robot.config.retry_ms
    assert rounds.retry(robot.fleet, VICTIM) == robot.config.f_max + 1
    assert handlers.next_fragment(robot.fleet, VICTIM, robot.work, retry_ms) > 0
    assert robot.robot.request_to == 3


@pytest.mark.parametrize("others, seeks", [(7, True), (8, False)])
def test_who_lacks_tokens_and_hears_2_f_max_plus_2_others_only_listens(others, seeks):
    """f_max + 2 of them are correct: one more than it needs, which P2 wants where liars talk over it."""
    robot = Seeking()
    for rob_id in range(2, 2 + others):
        rounds.heard(robot.fleet, VICTIM, rob_id, robot.now_ms - ROUND_MS * 5 // 4)
    rounds.heard(robot.fleet, VICTIM, 100, robot.now_ms - ROUND_MS * 5 // 4 - 1)
    assert robot.listens_ms() > 0
    assert robot.begins() == audit_frame(VICTIM + 1, 0, request.SEEK if seeks else request.HELLO)
    assert (robot.robot.quota > 0) != seeks


@pytest.mark.parametrize("name, value", [("got", BtiConfig().f_max + 1), ("round_no", 0)])
def test_who_has_its_tokens_and_who_begins_its_first_round_say_hello_at_once(name, value):
    robot = Seeking()
    robot.robot[name] = value
    assert robot.listens_ms() == 0
    assert robot.begins() == audit_frame(VICTIM + 1, 0, request.HELLO)


def test_it_seeks_again_while_it_lacks_tokens_at_moments_that_nobody_can_foresee():
    moments = set()
    for k in range(8):
        robot = Seeking()
        robot.senses(BOOT_MS + k)
        at_ms = robot.now_ms + robot.listens_ms()
        assert request.LISTENS_MS <= at_ms - robot.now_ms < request.LISTENS_MS + ROUND_MS // 16
        assert log.logged(robot.fleet, VICTIM)[-1] == log.FLUSH_S
        robot.now_ms = at_ms
        robot.begins()
        said_ms = [now_ms for now_ms in range(at_ms, at_ms + ROUND_MS, 10) if robot_seeks(robot, now_ms)]
        gaps_ms = np.diff([at_ms, *said_ms])
        assert (gaps_ms >= ROUND_MS // 8).all()
        assert (gaps_ms <= ROUND_MS // 4 + 10).all()
        moments |= {at_ms, *said_ms}
        late_ms = at_ms + 10 * ROUND_MS
        robot.robot.got = robot.config.f_max + 1
        assert not robot_seeks(robot, late_ms)
        robot.robot.got = 0
        assert robot_seeks(robot, late_ms)
        for rob_id in range(2, 10):
            rounds.heard(robot.fleet, VICTIM, rob_id, late_ms)
        assert not robot_seeks(robot, late_ms + ROUND_MS // 2)
    assert len(moments) > 30, "another s-chain, other moments"


def robot_seeks(robot: Seeking, now_ms: int) -> bool:
    return bool(request.seek(robot.fleet, VICTIM, now_ms, robot.work.frame))


def test_each_who_hears_it_tells_it_alone_and_once_in_half_a_round():
    robot, half_ms = Seeking(), ROUND_MS // 2
    for after_ms, answered in ((0, True), (half_ms - 1, False), (half_ms, True), (half_ms + 1, False)):
        told = robot.hears_seek(ASKER, robot.now_ms + after_ms)
        assert told == (audit_frame(VICTIM + 1, ASKER, request.HELLO) if answered else b"")
        assert robot.hears_seek(ASKER + 1 + after_ms, robot.now_ms + after_ms) != b"", "another's share is its own"
    assert robot.hears_seek(VICTIM + 1, robot.now_ms) == b""


@pytest.mark.parametrize("seeks, first", [(0, 3), (1, 4)])
def test_who_seeks_asks_first_whom_it_never_asked_in_vain(seeks, first):
    """A liar's token counts for T_val; its a-node has few requests, and liars who gave one once would have them all."""
    robot = Seeking()
    robot.robot.seeks = seeks
    for rob_id in (3, 4):
        rounds.heard(robot.fleet, VICTIM, rob_id, robot.now_ms)
    gave_one = robot.fleet.peer[VICTIM, rounds.peer_at(robot.fleet, VICTIM, 3)]
    gave_one.token, gave_one.misses = robot.now_ms, 1
    assert rounds.next_candidate(robot.fleet, VICTIM, robot.now_ms) == first


def test_where_tokens_were_missing_a_lost_fragment_is_said_again_at_once():
    """Another request would cost one of the few that the a-node makes."""
    robot = Seeking()
    robot.listens_ms()
    robot.begins()
    for rob_id in range(2, 9):
        rounds.heard(robot.fleet, VICTIM, rob_id, robot.now_ms)
    now_ms = robot.now_ms + robot.config.retry_ms
    rounds.retry(robot.fleet, VICTIM)
    assert handlers.next_fragment(robot.fleet, VICTIM, robot.work, now_ms) > 0
    request.not_arrived(robot.fleet, VICTIM, now_ms)
    assert robot.robot.request_len > 0


@pytest.mark.parametrize("n_max", [4, 24, 100])
@pytest.mark.parametrize("f_max", [1, 3])
def test_an_a_node_lets_out_a_hello_to_each_neighbour_twice_in_a_round_beside_the_rest(n_max, f_max):
    bti = BtiConfig(n_max=n_max, f_max=f_max)
    limits = Limits.of(bti, 60, 1000, 200)
    short_us = 60 + 20 * 0.2
    a_request_us = (bti.t_audit_ms / 1000 * bti.log_bytes_per_s + bti.n_max * 26 + 366) * 0.2
    assert limits.audit_capacity_us >= (f_max + 1) * a_request_us + 4 * n_max * short_us
