"""Lost tokens, relayed HELLOs and robots that drive: each uses up the few token requests of a round, if it can."""

from __future__ import annotations

from dataclasses import replace

import pytest
from placed_liars import stopped_robots

from commands import ROOT
from phalanx.world.scenarios.run import Run


@pytest.fixture
def promises(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import promises

    return promises


def stopped(promises, layout: str, f_max: int, seed: int, defence: str = "hardened", **options: float) -> list[int]:
    """Return the correct robots in Safe Mode after 24 s; liars begin at once."""
    case = promises.Case(promises.LIES.get(layout, promises.NOBODY), layout, f_max, 4.0, 0.0, seed)
    made = promises.scenario_of(case)
    liars = tuple(replace(each, at_s=1.0, options=options) for each in made.attacks)
    made = replace(made, defence=defence, duration_s=24.0, attacks=liars)
    return stopped_robots(Run(made), promises.layout_of(case).at)


def test_liars_that_talk_over_its_tokens_stop_a_robot_as_printed_and_none_that_seeks(promises):
    assert stopped(promises, "hidden", 3, 1, "paper") == [4]
    assert stopped(promises, "hidden", 3, 1) == []


@pytest.mark.parametrize("f_max", [1, 5])
def test_robots_whose_hello_is_relayed_from_far_away_are_not_asked_in_vain_for_long(promises, f_max):
    assert stopped(promises, "relayed", f_max, 0) == []


def test_liars_that_relay_seek_and_its_answers_both_ways_are_not_stopped(promises):
    """The exception on docs/promises.md."""
    assert len(stopped(promises, "relayed", 1, 0, both=1.0)) > 5


def test_robots_that_drive_from_place_to_place_lose_some_as_printed_and_none_that_seeks(promises):
    assert len(stopped(promises, "waypoints", 1, 2, "paper")) > 1
    assert stopped(promises, "waypoints", 1, 2) == []


@pytest.mark.long
@pytest.mark.parametrize("layout", ["groups", "convoy", "carousel", "column", "waypoints"])
@pytest.mark.parametrize("f_max", [1, 3])
def test_no_robot_that_drives_as_fast_as_promised_is_lost(promises, layout, f_max):
    assert [stopped(promises, layout, f_max, seed) for seed in range(4)] == [[]] * 4
