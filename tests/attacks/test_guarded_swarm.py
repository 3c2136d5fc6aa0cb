"""Guarded robots under audit: planners that nobody can replay, and robots that leave their envelope or their log."""

from __future__ import annotations

import random
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from phalanx.bti import log
from phalanx.bti.log import ENTRY_T
from phalanx.config import BtiConfig
from phalanx.config.guard import GuardConfig
from phalanx.errors import UsageError
from phalanx.robot import Liar, Planner
from phalanx.robot.adversary.attack import own_attack
from phalanx.robot.controllers import dispatch
from phalanx.robot.controllers.compiled import compiled
from phalanx.robot.controllers.guard_law import guard_params
from phalanx.robot.planner import ToGoal
from phalanx.wire.fields import get_u32, row
from phalanx.wire.guarded import ADVICE, KIND_WISH, WISH
from phalanx.world import AttackSpec, Scenario, simulate

pytestmark = pytest.mark.long

AT_S, LISTEN_MS = 5.0, 2000
ENVELOPE = GuardConfig(
    forget_ms=LISTEN_MS,
    speed_mps=1.5,
    fences=(((-5.0, -5.0), (90.0, -5.0), (90.0, 90.0), (-5.0, 90.0)),),
)
SWARM = Scenario(
    robots=6,
    grid_step_m=16.0,
    goal_m=(60.0, 60.0),
    duration_s=20.0,
    controller="guard",
    guard=ENVELOPE,
    bti=BtiConfig(f_max=1),
    seed=3,
)


class Anything(Planner):
    """Never twice the same, and often nonsense."""

    def advise(self, _t_s, _position_m, _velocity_mps):
        kind = random.randrange(6)
        return ((9.0, 9.0), (-1.0, 0.5), (float("nan"), 0.0), (1e300, -1e300), None, np.array((0.3, -2.0)))[kind]


class Silent(Planner):
    def advise(self, _t_s, _position_m, _velocity_mps):
        return None


class Wider(Liar):
    """Runs the guard with an envelope of its own, twice as fast and without a fence."""

    def decide(self, entry_len):
        if not hasattr(self, "wider"):
            params = guard_params(replace(ENVELOPE, speed_mps=3.0, fences=(), n_max=5))
            self.wider = compiled(dispatch.NUMBERS["guard"], params)(self.id)
            self.wider.on_input(0, 0, b"")
        step, t_ms = self.robot.step, get_u32(self.w.entry, ENTRY_T)
        honest = super().decide(entry_len)
        outputs = self.wider.on_input(step + 1, t_ms, self.reading)
        return outputs[:1] + honest[1:] if self.lies(t_ms) else honest

    def on_advice(self, advice):
        super().on_advice(advice)
        if hasattr(self, "wider"):
            self.wider.on_advice(advice)

    def read(self, _now_ms, reading):
        self.reading = reading
        return reading


class Misquotes(Liar):
    """Logs other advice than it follows."""

    def on_advice(self, advice):
        begin = int(self.f.robot[self.i].log_len)
        super().on_advice(advice)
        if self.sensed_ms >= self.plan.start_ms:
            other = ADVICE.encode(bytes=advice[:1] + bytes(4) + advice[5:])
            log.write(self.f, self.i, begin, row(other), len(other))
            self.record_deviation(self.sensed_ms)


class OwnWill(Liar):
    """Says that its planner advised what it wants itself, and does as the guard says."""

    def on_advice(self, advice):
        super().on_advice(WISH.form.pack(KIND_WISH, -1.0, -1.0) if self.sensed_ms >= self.plan.start_ms else advice)


@cache
def told(planner=None, attack=None, defence="hardened"):
    attacks = (AttackSpec(name=attack.__name__, own=own_attack(attack), robot=2, at_s=AT_S),) if attack else ()
    return simulate(replace(SWARM, attacks=attacks, defence=defence), planner=planner, every_s=0.25)


def stopped(result):
    (summary,) = result.summaries
    return summary["correct_in_safe_mode"] + summary["without_quorum"]


@pytest.mark.parametrize("planner", [None, Anything, Silent])
def test_robots_whose_planners_nobody_can_replay_pass_their_audits(planner):
    result = told(planner)
    assert stopped(result) == []
    assert len(result.verdicts) > SWARM.robots
    assert not result.verdicts["refusal"].any()
    assert result.summaries[0]["contacts"] == 0


def test_what_planners_wish_is_what_robots_do():
    moved = {}
    for planner in (ToGoal, Silent):
        at = told(None if planner is ToGoal else planner).positions_m[0]
        moved[planner] = np.linalg.norm(at[-1] - at[0], axis=1)
    assert moved[ToGoal].min() > 3.0
    assert moved[Silent].max() == 0.0


@pytest.mark.parametrize("attack", [Wider, Misquotes])
def test_who_leaves_the_envelope_or_misquotes_its_advice_is_stopped(attack):
    (liar,) = told(None, attack).summaries[0]["compromised"]
    bound_s = SWARM.bti.stop_bound_ms(output_missing=False) / 1000
    assert AT_S <= liar["first_deviation_s"] < AT_S + 5.0
    assert liar["safe_mode_s"] is not None
    assert liar["safe_mode_s"] <= liar["first_deviation_s"] + bound_s
    assert stopped(told(None, attack)) == []


def test_who_lies_about_its_advice_stays_in_the_envelope_and_keeps_its_tokens():
    result = told(None, OwnWill)
    (liar,) = result.summaries[0]["compromised"]
    assert liar["safe_mode_s"] is None
    assert result.positions_m[0, -1, 1, 0] < result.positions_m[0, :, 1, 0].max() - 1.0, "it does as it likes"
    assert result.positions_m[0, :, 1].min() >= -5.0 + ENVELOPE.clear_m - 1e-3
    assert result.summaries[0]["contacts"] == 0


def test_a_planner_needs_somebody_to_advise():
    with pytest.raises(UsageError, match="nobody that it could advise"):
        simulate(replace(SWARM, controller="flock", duration_s=1.0), planner=Silent)


def test_a_planner_that_returns_no_velocity_is_told():
    class Wrong(Planner):
        def advise(self, _t_s, _position_m, _velocity_mps):
            return 1.0, 2.0, 3.0

    with pytest.raises(UsageError, match="advise returned tuple"):
        simulate(replace(SWARM, duration_s=1.0), planner=Wrong)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"grid_step_m": 1.0}, "grid_step_m is 1"),
        ({"grid_step_m": 60.0}, "outside its fences"),
        ({"bti": BtiConfig(f_max=1, delta_ms=120), "guard": GuardConfig(speed_mps=0.45)}, "accel_mps2 is 2"),
    ],
)
def test_a_scenario_whose_robots_cannot_keep_their_envelope_is_refused(change, says):
    with pytest.raises(UsageError, match=says):
        replace(SWARM, **change)
