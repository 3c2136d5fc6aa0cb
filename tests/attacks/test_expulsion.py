"""`expel`: claims that push as hard as they like throw correct robots out of range; bounded, they do not."""

from __future__ import annotations

import pytest

from phalanx.config import BtiConfig
from phalanx.config.flock import NO_CROWD
from phalanx.robot.controllers.flock_law import PUSH
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.run import Run

SEEDS = range(3)


def lost(seed: int, crowd: float, **options: object) -> int:
    """Correct robots in Safe Mode, of the paper's 25, a minute after one of them began to lie for its last seconds."""
    made = Scenario(robots=25, seed=seed, duration_s=75.0, attacks=(AttackSpec(name="expel"),), **options)
    run = Run(made)
    run.world.fleet.params[PUSH] *= crowd / made.flock.crowd
    run.advance(made.duration_s)
    told = run.summary()
    return len(told["correct_in_safe_mode"]) + len(told["without_quorum"])


def test_its_claims_lose_nobody_and_without_the_bound_every_time_several():
    assert [lost(seed, 4.0) for seed in SEEDS] == [0, 0, 0]
    assert min(lost(seed, NO_CROWD) for seed in SEEDS) >= 3


@pytest.mark.parametrize("step_m", [50.0, 60.0])
def test_nor_does_a_flock_whose_robots_hear_few_others(step_m):
    few = {"grid_step_m": step_m, "d_m": step_m, "bti": BtiConfig(f_max=1)}
    assert [lost(seed, 4.0, **few) for seed in SEEDS] == [0, 0, 0]


@pytest.mark.parametrize("step_m, alone", [(30.0, [15]), (19.0, [])])
def test_whoever_has_fewer_than_2_f_max_1_others_within_half_the_range_can_be_parted_from_all(step_m, alone):
    """The robot at the end of a line, beside a liar: two correct ones hear it, 60 and 90 m away. P2 does not speak of it."""
    liar = AttackSpec(name="expel", at_s=8.0, robot=14)
    made = Scenario(
        robots=15, formation="line", grid_step_m=step_m, d_m=step_m, goal_m=(7 * step_m, 100.0), duration_s=45.0,
        bti=BtiConfig(f_max=1), attacks=(liar,),
    )  # fmt: skip
    assert made.radio.range_m / 2 == pytest.approx(58, abs=0.5)
    run = Run(made)
    run.advance(made.duration_s)
    told = run.summary()
    assert (told["correct_in_safe_mode"], told["without_quorum"]) == ([], alone)


def test_nor_do_claims_that_last_twice_as_long_where_audits_are_rare():
    """T_val 20 s: with the push that is harmless for 10 s, seed 0 loses four."""
    bti = BtiConfig(f_max=1, t_audit_ms=8000, t_val_ms=20_000)
    made = Scenario(
        robots=25, grid_step_m=25.0, d_m=20.0, goal_m=(150.0, 150.0), duration_s=52.0, bti=bti,
        attacks=(AttackSpec(name="expel", at_s=1.0),),
    )  # fmt: skip
    told = []
    for harder in (1, 2):
        run = Run(made)
        run.world.fleet.params[PUSH] *= harder
        run.advance(made.duration_s)
        summary = run.summary()
        told.append(len(summary["correct_in_safe_mode"]) + len(summary["without_quorum"]))
    assert told[0] == 0 < told[1]
