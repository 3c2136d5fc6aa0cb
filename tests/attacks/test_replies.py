"""Lost tokens, relayed HELLOs and robots that drive: each uses up the few token requests of a round, if it can."""

from __future__ import annotations

from dataclasses import replace

import pytest

from commands import ROOT
from phalanx.world.scenarios.run import Run


@pytest.fixture
def scripts(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import layouts
    import promises

    return layouts, promises


def stopped(scripts, layout: str, f_max: int, seed: int, defence: str = "hardened", **options: float) -> list[int]:
    """Return the correct robots in Safe Mode after 24 s; liars begin at once."""
    layouts, promises = scripts
    case = promises.Case(promises.LIES.get(layout, promises.NOBODY), layout, f_max, 4.0, 0.0, seed)
    made = promises.scenario_of(case)
    liars = tuple(replace(each, at_s=1.0, options=options) for each in made.attacks)
    made = replace(made, defence=defence, duration_s=24.0, attacks=liars)
    run = Run(made)
    layouts.drive(run, promises.layout_of(case), made.duration_s)
    assert all(liar.gained > 50 for liar in run.robots.values()), "they talked"
    told = run.summary()
    assert all(liar["first_deviation_s"] is None for liar in told["compromised"]), "no log shows it"
    return told["correct_in_safe_mode"] + told["without_quorum"]


def test_liars_that_talk_over_its_tokens_stop_a_robot_as_printed_and_none_that_seeks(scripts):
    assert stopped(scripts, "hidden", 3, 1, "paper") == [4]
    assert stopped(scripts, "hidden", 3, 1) == []


@pytest.mark.parametrize("f_max", [1, 5])
def test_robots_whose_hello_is_relayed_from_far_away_are_not_asked_in_vain_for_long(scripts, f_max):
    assert stopped(scripts, "relayed", f_max, 0) == []


def test_liars_that_relay_seek_and_its_answers_both_ways_are_not_stopped(scripts):
    """The exception on docs/promises.md."""
    assert len(stopped(scripts, "relayed", 1, 0, both=1.0)) > 5


def test_robots_that_drive_from_place_to_place_lose_some_as_printed_and_none_that_seeks(scripts):
    assert len(stopped(scripts, "waypoints", 1, 2, "paper")) > 1
    assert stopped(scripts, "waypoints", 1, 2) == []


@pytest.mark.long
@pytest.mark.parametrize("layout", ["groups", "convoy", "carousel", "waypoints"])
@pytest.mark.parametrize("f_max", [1, 3])
def test_no_robot_that_drives_as_fast_as_promised_is_stopped(scripts, layout, f_max):
    assert [stopped(scripts, layout, f_max, seed) for seed in range(4)] == [[]] * 4
