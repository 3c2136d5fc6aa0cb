"""Liars among robots that stand or drive where a test puts them, whatever their controllers command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from commands import ROOT
from phalanx.robot.adversary.attack import own_attack
from phalanx.robot.adversary.liar import Liar
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.run import Run
from scripts import loaded

layouts = loaded(ROOT / "scripts" / "layouts.py")


def placed_scenario(attack: type[Liar], f_max: int, at_s: float, **fields: object) -> Scenario:
    """Return a scenario in which robots 1 to f_max lie from then on."""
    own = own_attack(attack)
    liars = tuple(AttackSpec(name=own.name, own=own, robot=k, at_s=at_s) for k in range(1, f_max + 1))
    return replace(find_scenario("bti-fig9"), grid_step_m=1.0, defence="hardened", attacks=liars, **fields)


def stopped_robots(run: Run, places: Callable[[float], np.ndarray], talked: int = 50) -> list[int]:
    """Return the correct robots in Safe Mode at the end, though each liar talked more than so often."""
    layouts.drive(run, layouts.Layout(places), run.scenario.duration_s)
    told = run.summary()
    assert all(liar.gained > talked for liar in run.robots.values()), "they talked"
    assert all(liar["first_deviation_s"] is None for liar in told["compromised"]), "no log shows it"
    return told["correct_in_safe_mode"] + told["without_quorum"]
