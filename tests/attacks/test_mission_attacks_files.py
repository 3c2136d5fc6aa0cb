"""What is done to a mission's file, when nobody looks at its signature, its names or its window."""

from __future__ import annotations

import numpy as np
import pytest

from phalanx.attacks import ATTACKS
from phalanx.attacks.missions.between import Between
from phalanx.errors import PeerError
from phalanx.lab.scorecard.errand import shelf_errand
from phalanx.lab.scorecard.mission_trial import ROBOT, ROBOT_CONFIG, Operator, plan_of, try_mission_attack, walk
from phalanx.mission import State, Walker, parse_mission, parse_start_key


class Remembers(Walker):
    """Keeps what it experienced where something decoded."""

    lived = None

    def step(self, state, seen):
        after, outcome = super().step(state, seen)
        if outcome.decoded or seen.messages:
            self.lived.append(seen)
        return after, outcome


def decoded(walker, lived):
    """Nodes and what they say to do, out of experiences."""
    state, got = State(), []
    for seen in lived:
        state, outcome = walker.step(state, seen)
        if outcome.decoded:
            got.append((outcome.decoded.node, outcome.decoded.do, outcome.order))
    return got


@pytest.mark.parametrize("defence", ["paper", "hardened"])
def test_whatever_bit_is_changed_nothing_else_is_decoded_and_nothing_else_done(defence, monkeypatch):
    sent = Operator(defence, 0).send(shelf_errand(), ROBOT, 1)
    monkeypatch.setattr("phalanx.lab.scorecard.mission_trial.Walker", Remembers)
    monkeypatch.setattr(Remembers, "lived", [])
    assert walk(Between(plan_of(defence, 0, 0.0, {})), sent, defence, 0).done

    key = parse_start_key(sent.key) if defence == "hardened" else None
    honest = decoded(Walker(parse_mission(sent.file), key, ROBOT_CONFIG), Remembers.lived)
    assert [node for node, *_ in honest] == [0, 1, 2, 3, 4]
    chance = np.random.default_rng(0)
    # Every third byte; tests/mission/test_altered.py has all of them, in a world of points.
    for byte in range(int(chance.integers(3)), len(parse_mission(sent.file).signed_part()), 3):
        altered = bytearray(sent.file)
        altered[byte] ^= 1 << int(chance.integers(8))
        try:
            walker = Walker(parse_mission(bytes(altered)), key, ROBOT_CONFIG)
        except PeerError:
            continue
        got = decoded(walker, Remembers.lived)
        assert len(got) < len(honest), byte
        assert got == honest[: len(got)], byte


@pytest.mark.parametrize("name", ["forge-graph", "replay-day", "replay-robot", "replay-again"])
def test_it_is_the_signature_the_window_the_names_and_the_memory_that_stop_it(name):
    """Without them the mission runs: it is a true one, or as good as one."""
    trial = try_mission_attack(ATTACKS[name], "hardened", options={"unchecked": 1})
    assert not trial.kept
    assert trial.attacked.done
    assert trial.harm >= 1


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.9])
def test_a_changed_bit_is_stopped_without_a_look_at_the_signature_too(share):
    """The robot drives as far as the file is true."""
    sent = Operator("hardened", 0).send(shelf_errand(), ROBOT, 1)
    bit = int(share * 8 * len(parse_mission(sent.file).signed_part()))
    trial = try_mission_attack(ATTACKS["flip-bit"], "hardened", options={"unchecked": 1, "bit": bit})
    assert trial.kept
    assert trial.attacked.refused != "not_authentic"
    assert "hand_over" not in trial.attacked.actions


def test_a_clock_that_was_set_back_brings_no_mission_back_that_the_robot_has_started():
    class Started(ATTACKS["set-clock"].kind):
        again = True

    attack = Started(plan_of("hardened", 0, 0.0, {}))
    robot = walk(attack, Operator("hardened", 0).send(shelf_errand(), ROBOT, 1), "hardened", 0)
    assert robot.refused == "already_started"
