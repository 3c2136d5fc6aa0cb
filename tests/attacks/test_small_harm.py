"""Harm that is small beside the way the robots fly: it is the attack's, and no chance."""

from __future__ import annotations

import numpy as np
from trials import AT_S, Trial, run, scenario

from phalanx.robot.attacks.hijack import Dawdle
from phalanx.sim.scenarios.run import Run
from phalanx.sim.scenarios.scenario import AttackSpec

LONG_S = 90.0


def tried(name: str, end_s: float, seed: int = 1) -> Trial:
    """Beside the same dice."""
    liar = AttackSpec(name=name, at_s=AT_S)
    return Trial(run(scenario("none", liar, end_s=end_s, seed=seed)), run(scenario("none", end_s=end_s, seed=seed)))


def apart_m(one: Run, other: Run) -> float:
    """On the mean."""
    return float(np.sqrt(((one.positions_m - other.positions_m) ** 2).sum(axis=1)).mean())


def test_a_robot_that_falls_silent_leads_others_further_astray_than_other_dice_do():
    honest = run(scenario("none", end_s=LONG_S))
    dice = max(apart_m(honest, run(scenario("none", end_s=LONG_S, seed=seed))) for seed in (2, 3, 4))
    assert tried("omit-sends", LONG_S).harm > 3 * dice


def test_the_harm_of_coming_late_is_that_of_the_delay_and_adds_up(monkeypatch):
    """The placebo does all that the attack does, and 85 ms sooner."""
    late = [tried("in-protocol", end_s).harm for end_s in (36.0, LONG_S, 150.0)]
    monkeypatch.setattr(Dawdle, "DELAY_MS", 0)
    on_time = [tried("in-protocol", end_s).harm for end_s in (36.0, LONG_S, 150.0)]
    assert late[0] < late[1] / 2 < late[2] / 2
    assert late[2] > 0.3
    assert all(harm > 20 * placebo for harm, placebo in zip(late, on_time, strict=True))
