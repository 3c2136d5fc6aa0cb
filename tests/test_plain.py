"""Optimised runs and `--plain` runs end in the same digest."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from phalanx.bti import fleet
from phalanx.cli.main import run_command
from phalanx.config import BtiConfig
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.run import Run

pytestmark = pytest.mark.long

SWARM = Scenario(robots=9, duration_s=20.0, bti=BtiConfig(f_max=1))
CROWD = Scenario(robots=49, duration_s=8.0, grid_step_m=4.0, d_m=4.0)
ATTACKS = ["flee", "spoof", "expel", "stale-log", "forge-checkpoint", "slot-squat", "frame-flood", "reorder-entries"]


def told(scenario, **how):
    run = Run(scenario, **how)
    run.advance(scenario.duration_s)
    return {name: said for name, said in run.summary().items() if name != "real_time_factor"}


def same(scenario):
    clever, plain = told(scenario), told(scenario, plain=True)
    assert clever == plain
    return plain


@pytest.mark.parametrize("defence", ["none", "paper", "hardened"])
@pytest.mark.parametrize("scenario", [SWARM, CROWD], ids=["swarm", "crowd"])
def test_honest_swarms(scenario, defence):
    same(replace(scenario, defence=defence, seed=5))


@pytest.mark.parametrize("defence", ["paper", "hardened"])
@pytest.mark.parametrize("attack", ATTACKS)
def test_swarms_with_a_liar(attack, defence):
    liar = AttackSpec(name=attack, robot=5, at_s=2.0)
    assert same(replace(SWARM, defence=defence, attacks=(liar,)))["compromised"]


@pytest.mark.parametrize("front_bytes", [64, 1024])
def test_logs_in_two_pieces(front_bytes, monkeypatch):
    whole = told(SWARM)
    monkeypatch.setattr(fleet, "LARGE_LOGS_BYTES", 0)
    monkeypatch.setattr(fleet, "LOG_FRONT_BYTES", front_bytes)
    run = Run(SWARM)
    run.advance(SWARM.duration_s)
    assert run.summary()["digest"] == whole["digest"]
    assert run.world.fleet.log.shape[1] == front_bytes
    assert run.world.fleet.log_rest.any(axis=1).all()


def test_the_command_says_the_same_of_both(capsys):
    def digest(*words):
        assert run_command(["sim", "run", "flock-12", "--duration", "5", "--json", *words]) == 0
        return json.loads(capsys.readouterr().out)["digest"]

    assert digest() == digest("--plain")
