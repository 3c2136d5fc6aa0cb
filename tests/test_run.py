"""A seeded run as a whole: the same bytes compiled and not, what its digest is of, its end, and who lacked a quorum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from commands import uncompiled
from phalanx.config import BtiConfig
from phalanx.errors import Unavailable
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from phalanx.world.audited.setup import audits_share
from phalanx.world.scenarios import run as run_module
from phalanx.world.scenarios.run import Run


def ran(until_s: float, **said) -> Run:
    run = Run(Scenario(duration_s=until_s, **said))
    run.advance(until_s)
    return run


def stopped_liar() -> str:
    """Nine robots until one that lied from 1 s on is stopped: what happened, in one hash."""
    liar = AttackSpec(name="spoof", robot=5, at_s=1.0)
    summary = ran(14.0, robots=9, bti=BtiConfig(f_max=1), attacks=(liar,)).summary()
    assert summary["compromised"][0]["safe_mode_s"] is not None
    assert summary["correct_in_safe_mode"] == summary["without_quorum"] == []
    return summary["digest"]


def test_the_world_has_the_same_bytes_compiled_and_not():
    script = "from phalanx import kernel; import test_run; print(int(kernel.PURE), test_run.stopped_liar())"
    assert uncompiled(script) == ["1", stopped_liar()]


class TestDigest:
    LIAR = AttackSpec(name="spoof", robot=2, at_s=1.0, options={"strong": 0.0})
    WORLD = Scenario(name="one", robots=4, duration_s=3.0, attacks=(LIAR,))

    def digest(self, scenario: Scenario) -> str:
        run = Run(scenario)
        run.advance(scenario.duration_s)
        return run.summary()["digest"]

    def test_it_is_of_what_happened_and_not_of_what_was_said(self):
        renamed = replace(self.WORLD, name="two", about="in other words", attacks=(replace(self.LIAR, options={}),))
        assert self.digest(renamed) == self.digest(self.WORLD)

    def test_a_lie_begun_half_a_second_later_is_another_digest(self):
        later = replace(self.WORLD, attacks=(replace(self.LIAR, at_s=1.5),))
        assert self.digest(later) != self.digest(self.WORLD)

    def test_another_seed_is_another_world(self):
        one, other = (ran(3.0, robots=4, seed=seed) for seed in (1, 2))
        assert not np.array_equal(one.world.fleet.log, other.world.fleet.log)
        assert not np.array_equal(one.world.air.counts, other.world.air.counts)
        assert one.summary()["digest"] != other.summary()["digest"]


class TestWatching:
    @pytest.mark.parametrize("name", ["positions_m", "velocities_mps", "in_safe_mode", "airtime_s"])
    def test_what_was_told_stays_and_what_is_done_to_it_changes_nothing(self, name):
        run = ran(3.0, robots=9, defence="none")
        told = getattr(run, name)
        before = told.copy()
        run.advance(6.0)
        run.world.safe[:] = 1
        np.testing.assert_array_equal(told, before)
        now = getattr(run, name).copy()
        assert not np.array_equal(now, before)
        getattr(run, name)[:] = 0
        np.testing.assert_array_equal(getattr(run, name), now)


class TestEnd:
    def test_half_a_second_is_a_run_too(self):
        run = ran(0.5, robots=4)
        summary = run.summary()
        assert summary["distance_series"] == []
        from_goal_m = np.hypot(*(run.positions_m - 500.0).T)
        assert summary["mean_distance_to_goal_m"] == pytest.approx(from_goal_m.mean())
        run.advance(1.0)
        assert (len(summary["distance_series"]), len(run.summary()["distance_series"])) == (0, 1)

    def test_whoever_is_stopped_after_the_last_whole_second_is_told(self):
        summary = ran(10.4, robots=4, bti=BtiConfig(t_val_ms=10_300)).summary()
        assert summary["without_quorum"] == [1, 2, 3, 4]
        assert summary["correct_in_safe_mode"] == []


class TestQuorum:
    def test_a_crowd_that_fills_the_channel_is_not_the_defence_s_failure(self):
        run = ran(13.0, robots=144, grid_step_m=4.0, d_m=4.0)
        summary = run.summary()
        assert summary["correct_in_safe_mode"] == []
        assert len(summary["without_quorum"]) > 50
        assert run.airtime_s.sum() > 0.7 * 13.0, "all hear each other"

    def test_up_to_a_hundred_robots_in_one_range_nobody_is_stopped(self):
        scenario = Scenario(robots=100, grid_step_m=4.0, d_m=4.0, duration_s=25.0)
        run = Run(scenario)
        run.advance(5.0)
        before_s = run.airtime_s.sum()
        run.advance(25.0)
        assert not run.in_safe_mode.any()
        share = (run.airtime_s.sum() - before_s) / 20.0
        assert audits_share(scenario.bti, scenario.radio, scenario.robots_in_range) == pytest.approx(share, rel=0.25)

    @pytest.mark.parametrize("name", ["request-flood", "ghost-auditors", "long-frames"])
    def test_whoever_is_starved_by_a_liar_on_a_quiet_channel_is_told_as_wronged(self, name):
        summary = ran(
            36.0,
            robots=12,
            seed=1,
            grid_step_m=16.0,
            goal_m=(150.0, 150.0),
            defence="paper",
            attacks=(AttackSpec(name=name, at_s=12.0),),
        ).summary()
        assert len(summary["correct_in_safe_mode"]) >= 9
        assert summary["without_quorum"] == []

    def test_whoever_is_shouted_down_by_liars_is_told_as_wronged(self):
        jam = AttackSpec(name="jam", at_s=3.0)
        run = ran(16.0, robots=20, seed=3, grid_step_m=16.0, d_m=16.0, bti=BtiConfig(f_max=2), attacks=(jam,) * 15)
        assert run.airtime_s.sum() > 16.0
        assert len(run.summary()["correct_in_safe_mode"]) > 0
        assert run.summary()["without_quorum"] == []

    @pytest.mark.parametrize("f_max", [1, 3])
    def test_a_quorum_is_one_correct_robot_more_than_tokens_are_needed(self, f_max):
        for others in (f_max + 1, f_max + 2):
            run = ran(1.0, robots=others + 1, bti=BtiConfig(f_max=f_max))
            assert set(run._quorum._has().tolist()) == {others == f_max + 2}

    def test_who_loses_its_auditors_because_they_lost_theirs_is_without_quorum_too(self):
        """At 72 m a corner has three in range, an edge five, the middle eight: they go one after the other.

        At 64 m who seeks now and then reaches the edge on the other side, 128 m away, and then they live.
        """
        run = ran(60.0, robots=9, grid_step_m=72.0, d_m=72.0)
        assert run.summary()["without_quorum"] == list(range(1, 10))
        since_s = run.world.safe_us.reshape(3, 3) / 1e6
        corners, edges, middle = since_s[::2, ::2], since_s.ravel()[1::2], since_s[1, 1]
        assert corners.max() < edges.min()
        assert edges.max() < middle


def test_a_swarm_that_memory_does_not_hold_is_one_line(monkeypatch):
    def no_room(*_):
        raise MemoryError

    monkeypatch.setattr(run_module, "make_world", no_room)
    with pytest.raises(Unavailable, match="4 robots do not fit into memory"):
        Run(Scenario(robots=4))
