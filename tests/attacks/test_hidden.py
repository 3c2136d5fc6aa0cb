"""`talk-over`: liars whom a robot does not hear talk while it asks. What was lost is said again, at times of its own."""

from __future__ import annotations

import numpy as np
import pytest
from test_answers import BOOT_MS, F_MAX, GRANT_MS, VICTIM, Asking

from phalanx.bti import request, rounds
from phalanx.config import BtiConfig
from phalanx.robot import handlers
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from phalanx.sim.scenarios.run import Run

T_AUDIT_MS = 4000
# The longest pauses before a fragment is said again.
PAUSES_MS = [62, 125, 250, 500]


@pytest.mark.parametrize("seed", [0, 4])
def test_two_liars_in_other_aisles_stop_nobody_whom_three_auditors_hear(seed):
    """Before, robot 4 was stopped with either seed, as with four of ten."""
    liars = tuple(AttackSpec(name="talk-over", at_s=10.0, robot=rob_id) for rob_id in (11, 12))
    bti = BtiConfig(f_max=2)
    star = Scenario(
        robots=12, hub=3, grid_step_m=6, d_m=6, goal_m=(10, 10), duration_s=45, seed=seed, attacks=liars, bti=bti
    )
    run = Run(star)
    run.advance(star.duration_s)
    told = run.summary()
    assert told["correct_in_safe_mode"] == told["without_quorum"] == []
    assert [liar["first_deviation_s"] for liar in told["compromised"]] == [None, None]
    assert all(run.robots[rob_id - 1].gained > 1000 for rob_id in (11, 12)), "they talked"


class Unheard(Asking):
    """Its fragments are lost."""

    def says(self, now_ms: int) -> bytes:
        """The frame that goes out now, if one does."""
        n = handlers.next_fragment(self.fleet, VICTIM, self.work, now_ms)
        return self.work.frame[:n].tobytes()

    def passes_over(self, now_ms: int) -> int:
        """When it asks the first one that it waits for: f_max of whom nothing arrived it did not."""
        asked = set()
        for k in range(F_MAX):
            assert self.says(now_ms + k * GRANT_MS) != b""
            asked.add(int(self.robot.request_to))
            request.not_arrived(self.fleet, VICTIM, now_ms + k * GRANT_MS)
            assert self.robot.request_len == 0
        assert len(asked) == F_MAX
        return now_ms + F_MAX * GRANT_MS

    def pauses_ms(self, now_ms: int) -> list[int]:
        """How long it waits each time, until it gives up."""
        waited, frame = [], self.says(now_ms)
        while True:
            request.not_arrived(self.fleet, VICTIM, now_ms)
            if self.robot.request_len == 0:
                return waited
            pause_ms = int(rounds.next_retry(self.fleet, VICTIM, now_ms)) - now_ms
            assert self.says(now_ms + pause_ms - 1) == b""
            assert self.says(now_ms + pause_ms) == frame, "the same fragment, alone"
            waited.append(pause_ms)
            now_ms += pause_ms


def test_a_fragment_that_was_lost_is_said_again_after_ever_longer_pauses_that_nobody_can_foresee():
    seen = []
    for k in range(12):
        robot = Unheard()
        robot.round_begins(BOOT_MS + k)
        seen.append(robot.pauses_ms(robot.passes_over(BOOT_MS + GRANT_MS + k)))
    assert all(len(pauses) == len(PAUSES_MS) for pauses in seen)
    for nth, longest in zip(zip(*seen), PAUSES_MS):
        assert len(set(nth)) > 6
        assert 1 <= min(nth) < longest / 2 < max(nth) <= longest


def test_whoever_heard_nothing_of_a_request_may_be_asked_again_soon_and_whoever_did_after_half_a_round():
    again_ms = []
    for k in range(12):
        robot = Unheard()
        robot.round_begins(BOOT_MS)
        robot.pauses_ms(now_ms := robot.passes_over(BOOT_MS + GRANT_MS + k))
        to = rounds.peer_at(robot.fleet, VICTIM, int(robot.robot.request_to))
        again_ms.append(int(robot.fleet.peer[VICTIM, to].asked_ms) + int(rounds.again_after(robot.fleet)) - now_ms)
    assert len(set(again_ms)) > 6
    assert 0 < min(again_ms) <= max(again_ms) < sum(PAUSES_MS) + T_AUDIT_MS // 2
    robot = Unheard()
    robot.round_begins(BOOT_MS)
    for k in range(12):
        robot.hears(BOOT_MS + k)
    robot.fleet.settings[0].frame_max = 256
    robot.says(BOOT_MS + 600)
    robot.says(BOOT_MS + 601)
    to, now_ms = rounds.peer_at(robot.fleet, VICTIM, int(robot.robot.request_to)), BOOT_MS + 602
    assert robot.robot.request_next == 2
    for _ in PAUSES_MS:
        request.not_arrived(robot.fleet, VICTIM, now_ms)
        now_ms += max(PAUSES_MS)
        assert robot.says(now_ms) != b""
    request.not_arrived(robot.fleet, VICTIM, now_ms)
    assert robot.robot.request_len == 0
    assert robot.fleet.peer[VICTIM, to].asked_ms == BOOT_MS + 600, "an auditor takes one request in half a round"


@pytest.mark.parametrize("f_max, waits", [(5, True), (6, False)])
def test_of_many_that_may_lie_none_is_waited_for_that_falls_silent_amid_a_request(f_max, waits):
    """Else eight who acknowledged no more than first fragments cost a round and the next, and stopped others."""
    robot = Unheard(config=BtiConfig(f_max=f_max))
    robot.round_begins(BOOT_MS)
    for k in range(12):
        robot.hears(BOOT_MS + k)
    robot.fleet.settings[0].frame_max = 256
    for k in range(f_max):
        now_ms = BOOT_MS + (k + 1) * GRANT_MS
        robot.says(now_ms)
        assert robot.says(now_ms + 1) != b"" and robot.robot.request_next == 2
        request.not_arrived(robot.fleet, VICTIM, now_ms + 2)
        assert (robot.robot.request_len > 0) == waits
        if waits:
            break


def test_while_a_fragment_waits_nobody_else_is_asked():
    robot = Unheard()
    robot.round_begins(BOOT_MS)
    now_ms = robot.passes_over(BOOT_MS + GRANT_MS)
    robot.says(now_ms)
    to, number = int(robot.robot.request_to), int(robot.robot.request_no)
    request.not_arrived(robot.fleet, VICTIM, now_ms + 1)
    rounds.retry(robot.fleet, VICTIM)
    assert robot.says(now_ms + 1) == b""
    assert (int(robot.robot.request_to), int(robot.robot.request_no)) == (to, number)
    assert np.all(robot.fleet.robot[VICTIM].request_len > 0)


def test_who_has_asked_all_that_there_are_waits_for_the_first_of_whom_nothing_arrived():
    robot = Unheard()
    for rob_id in (2, 3):
        rounds.heard(robot.fleet, VICTIM, rob_id, BOOT_MS)
    rounds.begin_round(robot.fleet, VICTIM)
    robot.says(BOOT_MS + GRANT_MS)
    request.not_arrived(robot.fleet, VICTIM, BOOT_MS + GRANT_MS)
    assert robot.robot.request_len == 0, "one is left"
    robot.says(BOOT_MS + 2 * GRANT_MS)
    request.not_arrived(robot.fleet, VICTIM, BOOT_MS + 2 * GRANT_MS)
    assert robot.robot.request_len > 0, "none is"


def test_f_max_that_were_good_auditors_and_are_gone_at_once_stop_nobody():
    """Before, 15 of the 20 others were stopped: each of the gone cost who asked it half a second."""
    liars = tuple(AttackSpec(name="hijack", at_s=9.0) for _ in range(12))
    bti = BtiConfig(f_max=12)
    grid = Scenario(
        robots=32, grid_step_m=8, d_m=8, goal_m=(30, 30), duration_s=30, seed=0, defence="bound", attacks=liars, bti=bti
    )
    run = Run(grid)
    run.advance(grid.duration_s)
    told = run.summary()
    assert all(liar["safe_mode_s"] for liar in told["compromised"])
    assert told["correct_in_safe_mode"] == told["without_quorum"] == []
