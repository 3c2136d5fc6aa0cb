"""A cheat on a mission, tried in a team as `phalanx attack run` does it."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from phalanx.attacks import ON_MISSIONS
from phalanx.cli.commands.attack import attack as group
from phalanx.errors import UsageError
from phalanx.lab.scorecard.team_trial import TeamTrial, try_in_team

TEAM = [name for name, attack in ON_MISSIONS.items() if attack.scene == "team"]


@pytest.mark.parametrize(
    ("name", "refusal"),
    [
        ("skip-node", "output wrong"),
        pytest.param("drive-dark", "output wrong", marks=pytest.mark.long),
        pytest.param("show-unsensed", "evidence wrong", marks=pytest.mark.long),
        ("forge-claim", "evidence wrong"),
    ],
)
def test_each_is_stopped_in_time_for_what_it_does_and_the_others_complete_their_mission(name, refusal):
    trial = try_in_team(ON_MISSIONS[name], "hardened")
    assert not trial.broken
    assert (trial.completed, trial.others, trial.in_safe_mode) == (3, 3, ())
    assert 0 < trial.stopped_s - trial.deviated_s <= trial.bound_s
    assert set(trial.refusals) == {refusal}


def test_those_above_are_all_that_cheat_in_a_team():
    assert sorted(TEAM) == ["drive-dark", "forge-claim", "show-unsensed", "skip-node"]


def test_without_audits_nobody_is_stopped():
    trial = try_in_team(ON_MISSIONS["drive-dark"], "none")
    assert (trial.broken, trial.stopped_s, trial.bound_s, trial.refusals) == (False, None, None, {})
    assert trial.deviated_s is not None


@pytest.mark.parametrize(
    ("wrong", "broken"),
    [
        ({}, False),
        ({"stopped_s": None}, True),
        ({"stopped_s": 25.0}, True),
        ({"deviated_s": None}, True),
        ({"in_safe_mode": (2,)}, True),
        ({"declared": "bites"}, True),
        ({"declared": "bites", "stopped_s": None}, False),
    ],
)
def test_what_is_promised_and_not_kept_is_broken(wrong, broken):
    told = {"declared": "stopped", "deviated_s": 13.0, "stopped_s": 21.0, "bound_s": 10.1, "in_safe_mode": ()}
    rest = {"attack": "drive-dark", "defence": "hardened", "refusals": {}, "completed": 3, "others": 3}
    assert TeamTrial(**{**rest, **told, **wrong}).broken == broken


def test_the_command_says_when_and_why_it_was_stopped_and_takes_no_options_of_flocks(monkeypatch):
    tried = []

    def once(*words, **more):
        tried[:] = tried or [try_in_team(*words, **more)]
        return tried[0]

    monkeypatch.setattr("phalanx.cli.attack.try_in_team", once)
    shown = CliRunner().invoke(group, ["run", "skip-node"], standalone_mode=False)
    assert (shown.exception, shown.return_value) == (None, 0)
    assert "stopped: as declared" in shown.stdout
    assert "output wrong (" in shown.stdout
    assert "3 of 3 completed the mission; in Safe Mode: none" in shown.stdout
    told = json.loads(CliRunner().invoke(group, ["run", "skip-node", "--json"], standalone_mode=False).stdout)
    assert told["attack"] == "skip-node"
    assert told["in_safe_mode"] == []
    for words in (["skip-node", "--robots", "9"], ["skip-node:robot=2"], ["skip-node:at=3"]):
        assert isinstance(CliRunner().invoke(group, ["run", *words], standalone_mode=False).exception, UsageError)
