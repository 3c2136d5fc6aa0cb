"""Harm that is small beside the way the robots fly: it is the attack's, and no chance."""

from __future__ import annotations

import numpy as np
import pytest
from trials import AT_S, END_S, F_MAX, Trial, honest, scenario

from phalanx.attacks import IN_FLOCKS
from phalanx.attacks.hijack import Dawdle
from phalanx.robot.adversary.harm import ASTRAY
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.world.scenarios.run import Run

LONG_S = 90.0
ENDS_S = (END_S, LONG_S, 150.0)
BITE = [name for name, kind in IN_FLOCKS.items() if kind.harm is ASTRAY and kind.verdicts["none"] == "bites"]


def began(name: str, seed: int = 1) -> Run:
    """Not gone on yet."""
    liars = [AttackSpec(name=name, at_s=AT_S) for _ in range(IN_FLOCKS[name].liars(F_MAX))]
    return Run(scenario("none", *liars, seed=seed))


def on(running: Run, until_s: float) -> Trial:
    """Beside the same dice."""
    running.advance(until_s)
    return Trial(running, honest("none", until_s, running.scenario.seed))


def tried(name: str, end_s: float, seed: int = 1) -> Trial:
    return on(began(name, seed), end_s)


def apart_m(one: Run, other: Run) -> float:
    """On the mean."""
    return float(np.sqrt(((one.positions_m - other.positions_m) ** 2).sum(axis=1)).mean())


@pytest.mark.parametrize("name, times", [("omit-sends", 3), ("drop-entries", 3), ("reorder-entries", 2)])
def test_harm_adds_up_to_more_than_other_dice_do(name, times):
    dice = max(apart_m(honest("none", LONG_S), honest("none", LONG_S, seed)) for seed in (2, 3, 4))
    assert tried(name, LONG_S).harm > times * dice


def test_where_a_liar_has_taken_itself_is_no_harm():
    fled = tried("flee", END_S)
    ways_m = np.linalg.norm(fled.run.positions_m - fled.beside.positions_m, axis=1)
    assert ways_m[fled.liars[0].i] > 1000
    assert fled.harm == pytest.approx(np.delete(ways_m, fled.liars[0].i).mean())


@pytest.mark.parametrize("name", BITE)
@pytest.mark.parametrize("seeds", [range(2, 4), pytest.param(range(4, 9), marks=pytest.mark.long)])
def test_what_bites_does_so_with_other_seeds_too(name, seeds):
    assert all(tried(name, END_S, seed).harm >= IN_FLOCKS[name].bites_from for seed in seeds)


def test_the_harm_of_coming_late_is_that_of_the_delay_and_adds_up(monkeypatch):
    """The placebo does all that the attack does, at once."""
    running = began("in-protocol")
    late = [on(running, end_s).harm for end_s in ENDS_S]
    monkeypatch.setattr(Dawdle, "DELAY_MS", 0)
    monkeypatch.setattr(Dawdle, "POLLS_MS", 0)
    running = began("in-protocol")
    on_time = [on(running, end_s).harm for end_s in ENDS_S]
    assert late[0] < late[1] / 2 < late[2] / 2
    assert late[2] > 0.3
    assert all(harm > 20 * placebo for harm, placebo in zip(late, on_time, strict=True))
