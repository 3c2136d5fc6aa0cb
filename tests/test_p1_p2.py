"""P1 and P2 of docs/spec/rebound.md: every attack, several seeds. The long table is benchmarks/bench_attacks.py."""

from __future__ import annotations

import hashlib

import pytest

from phalanx.attacks import IN_FLOCKS
from phalanx.config import BtiConfig
from phalanx.lab.scorecard.flock_trial import stop_bound_s
from phalanx.robot.adversary.liar import Liar
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.run import Run

# Another seed of each, among fewer robots: attacks/test_verdicts.py.
SEEDS = [range(1), pytest.param(range(1, 25), marks=pytest.mark.long)]
ROBOTS = 25
# P2 wants a channel that is not saturated.
SATURATES = {"jam"}


def moment(name: str, seed: int) -> float:
    """Somewhere from the first second of grace to the fifth round, s."""
    return 1.0 + hashlib.sha256(f"{name} {seed}".encode()).digest()[0] / 256 * 19.0


def attacked(name: str, seed: int) -> Run:
    """The paper's 25 robots on a grid, the attack in as many of them as it takes."""
    at_s = moment(name, seed)
    liars = (AttackSpec(name=name, at_s=at_s),) * IN_FLOCKS[name].liars(BtiConfig().f_max)
    made = Scenario(name="p1-p2", robots=ROBOTS, seed=seed, duration_s=at_s + 13.0, attacks=liars)
    run = Run(made)
    run.advance(made.duration_s)
    return run


@pytest.mark.parametrize("seeds", SEEDS, ids=str)
@pytest.mark.parametrize("name", IN_FLOCKS)
def test_whoever_deviates_is_stopped_in_time_and_nobody_else_is_stopped(name, seeds):
    for seed in seeds:
        run = attacked(name, seed)
        summary = run.summary()
        if name not in SATURATES:
            assert summary["correct_in_safe_mode"] == [], f"seed {seed}"
            assert summary["without_quorum"] == [], f"seed {seed}"
        liars = [robot for _, robot in sorted(run.robots.items()) if isinstance(robot, Liar)]
        for liar, told in zip(liars, summary["compromised"]):
            if IN_FLOCKS[name].verdicts["hardened"] == "stopped":
                bound_s = stop_bound_s(run.scenario, output_missing=liar.output_missing)
                assert told["first_deviation_s"] is not None, f"seed {seed}"
                assert told["safe_mode_s"] is not None, f"seed {seed}"
                assert 0 <= told["safe_mode_s"] - told["first_deviation_s"] <= bound_s, f"seed {seed}"
            else:
                assert told["first_deviation_s"] is None, (
                    f"seed {seed}: declared {IN_FLOCKS[name].verdicts['hardened']}"
                )
                assert told["safe_mode_s"] is None or name in SATURATES, f"seed {seed}: it stopped itself"
