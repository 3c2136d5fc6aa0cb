"""The brute force of a captured mission: it reads what it can read, at a rate that is measured; and no more."""

from __future__ import annotations

from functools import cache

import pytest

from phalanx.config.defence import DEFENCES
from phalanx.config.mission import CodingConfig
from phalanx.lab.cracking.attacks import ATTACKS
from phalanx.lab.scorecard.errand import TOKEN, shelf_errand
from phalanx.lab.scorecard.mission_trial import ROBOT, Operator, plan_of, try_guess, try_mission_attack
from phalanx.mission import parse_start_key

CHEAP = CodingConfig(delta_mm=800, kdf_log2_n=1, kdf_r=1)
PLACES = 3  # nodes that are a place and nothing else; the others take a token or a message


@cache
def trial(name: str, defence: str):
    return try_mission_attack(ATTACKS[name], defence)


def guess(name: str, defence: str, chance=None, **more):
    plan = plan_of(defence, 0, 0.0, {})
    if chance is not None:
        object.__setattr__(plan, "chance", chance)
    return try_guess(ATTACKS[name].kind(plan), defence, 0, **more)


class Loaded:
    """Dice that always show the same."""

    def __init__(self, shows: bytes):
        self.shows = shows

    def bytes(self, length: int) -> bytes:
        assert length == len(self.shows)
        return self.shows


@pytest.mark.parametrize("defence", DEFENCES)
@pytest.mark.parametrize("name", ATTACKS)
def test_the_guess_comes_to_what_it_declares(name, defence):
    told, verdict = trial(name, defence).attacked, ATTACKS[name].verdicts[defence]
    assert trial(name, defence).kept
    assert (told.read > 0) == (verdict == "bites")
    if defence == "none":
        assert told.read == told.nodes
        return
    assert told.tries > 0
    assert told.tries_per_s == pytest.approx(told.tries / told.seconds)
    assert told.whole_s == pytest.approx(told.candidates / told.tries_per_s)
    year_s = 3.2e7
    if verdict == "bites":
        assert told.read == PLACES
        assert told.tries == told.candidates, "it was run to the end"
    elif verdict == "limited":
        assert told.candidates < 1e9
        assert 10 < told.whole_s < year_s
    else:
        assert told.whole_s > 1e20 * year_s


def test_paper_falls_a_thousand_times_as_fast_as_sealed():
    paper, sealed = (trial("guess-graph", defence).attacked for defence in ("paper", "hardened"))
    assert paper.tries_per_s > 1000 * sealed.tries_per_s


def test_sealed_falls_too_to_who_has_its_start_key_and_the_time():
    """At a try that costs nothing: the places are read, the token and what needs a message are not."""
    told = guess("guess-graph", "hardened", coding=CHEAP, tries=1 << 30)
    assert told.read == PLACES


def test_without_the_right_gate_nothing_is_read_wherever_one_looks_and_with_it_all_places_are():
    whole_box = 51 * 51
    assert guess("guess-gate", "hardened", coding=CHEAP, tries=2 * whole_box).read == 0
    (gate,) = parse_start_key(Operator("hardened", 0).send(shelf_errand(CHEAP), ROBOT, 1).key).gates.values()
    assert guess("guess-gate", "hardened", Loaded(gate.share), coding=CHEAP, tries=whole_box).read == PLACES


@pytest.mark.parametrize("defence", ["paper", "hardened"])
def test_a_token_that_is_guessed_right_does_open(defence):
    coding = CHEAP if defence == "hardened" else None
    assert guess("guess-token", defence, Loaded(bytes.fromhex(TOKEN)), tries=16, coding=coding).read == 1
