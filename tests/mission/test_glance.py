"""A glance says that a scan holds nothing only where who looks finds nothing: no node, no fix, and as many tries."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.config.mission import MissionConfig
from phalanx.mission import Draft, Landmark, Position, Profile, Sensor, State, Walker
from phalanx.mission.observable import ScanLandmarks, rows_of
from phalanx.mission.walk.finding import Finder
from phalanx.mission.walk.state import Keyring
from worlds import BOTH, CHEAP, at, built, cheap

# Not dear to search, so that the profiles try as many cells.
TRIES = MissionConfig(hash_tries=300, kdf_tries=8)
THINGS = (
    Landmark("doorway", 4.0, 0.5, 0.1),
    Landmark("concave_left", 8.0, -0.5, 1.0),
    Landmark("room", 12.0, 0.3, None, 9.0),
    Landmark("concave_right", 16.0, 0.2, -2.0),
)
# How sure a robot is: as sure as one gets; of its place alone; less; lost.
SPREADS = ((1e-4, 1e-5), (1e-4, 0.01), (0.02, 2e-3), (0.3, 0.02))


def hall(*, reads: bool):
    """Four things in a row; who `reads` has to sense something beside the second."""
    draft = Draft("hall", coding=CHEAP)
    draft.node("n0", Position(0.0, 0.0), start=True)
    for i, thing in enumerate(THINGS):
        more = (Sensor(b"warm"),) if reads and i == 1 else ()
        draft.node(f"n{i + 1}", thing, *more, final=i == len(THINGS) - 1)
        draft.way(f"n{i}", f"n{i + 1}")
        if 0 < i < len(THINGS) - 1:
            draft.way(f"n{i + 1}", f"n{i}")
    return draft.mission()


def states_of(mission, walker: Walker) -> list[State]:
    """Those of a robot that sees each thing when it stands before it; in each some nodes are decoded."""
    states, state = [], State()
    for i, (x_m, thing) in enumerate([(0.0, None), *((thing.x_m - 0.5, thing) for thing in THINGS)]):
        for k in range(60):
            seen = at(
                mission, x_m, 0.0, 100.0 * i + k, landmarks=() if thing is None else (thing,), sensors=(b"warm",),
                travelled_m=x_m,
            )  # fmt: skip
            state, outcome = walker.step(state, seen)
            if outcome.decoded is not None:
                break
        states.append(state)
    assert len(states[-2].opened) == len(THINGS)
    return states[:-1]  # the last is done


@cache
def walks():
    """(mission, walker, states) in either profile, without and with something to sense."""
    return [
        (mission, walker, states_of(mission, walker))
        for profile in BOTH
        for reads in (False, True)
        for mission in [cheap(hall(reads=reads), profile)]
        for one in [built(mission, profile)]
        for walker in [Walker(one.mission, one.key, TRIES)]
    ]


sightings = st.one_of(
    # Near what is known or looked for, or right there
    st.tuples(
        st.integers(0, len(THINGS) - 1),
        st.one_of(st.just(0.0), st.floats(-0.6, 0.6)),
        st.one_of(st.just(0.0), st.floats(-0.6, 0.6)),
        st.one_of(st.just(0.0), st.floats(-0.5, 0.5)),
    ),
    # Anywhere
    st.tuples(st.integers(0, len(THINGS) - 1), st.floats(-9, 9), st.floats(-9, 9), st.floats(-3, 3)),
)


def in_sight(sighted) -> ScanLandmarks:
    moved = [
        replace(
            THINGS[i],
            x_m=THINGS[i].x_m + dx,
            y_m=THINGS[i].y_m + dy,
            orientation_rad=None if THINGS[i].orientation_rad is None else THINGS[i].orientation_rad + turn,
        )
        for i, dx, dy, turn in sighted
    ]
    return ScanLandmarks(rows_of(moved))


@settings(max_examples=150, deadline=None)
@given(
    st.integers(0, 2 * len(BOTH) - 1),
    st.integers(0, len(THINGS) - 1),
    st.lists(sightings, max_size=4),
    st.sampled_from([0.0, *(thing.x_m - 0.5 for thing in THINGS)]),
    st.sampled_from(SPREADS),
    st.booleans(),
    st.booleans(),
)
def test_a_step_comes_to_the_same_with_a_glance_as_without(walk, decoded, sighted, x_m, doubt, warm, back):
    mission, walker, states = walks()[walk]
    metres2, radians2 = doubt
    spread, state = (metres2, 0.0, 0.0, metres2, 0.0, radians2), states[decoded]
    if back and decoded > 1:
        state = replace(state, target=decoded - 1)  # on its way to what it knows
    things = in_sight(sighted)
    seen = at(
        mission, x_m, 0.0, state.t_s + 1, landmarks=things, sensors=(b"warm",) if warm else (), spread=spread,
        travelled_m=x_m,
    )  # fmt: skip
    # Landmarks one by one are never glanced at.
    plainly = replace(seen, landmarks=tuple(things))
    assert told(walker.step(state, seen)) == told(walker.step(state, plainly))
    assert told(walker.look(state, seen)) == told(walker.look(state, plainly))


def told(came_to) -> str:
    """All of it, with what does not show; NaN is like NaN in words."""
    keys: Keyring = came_to[0].keys
    return repr((came_to, sorted(keys.tried), sorted(keys.gates), sorted(keys.proofs)))


@pytest.mark.parametrize("profile", BOTH)
def test_who_sees_nothing_that_matters_is_not_looked_for(profile, monkeypatch):
    mission, walker, states = walks()[2 * BOTH.index(profile)]
    looks, look = [], Finder.look
    monkeypatch.setattr(Finder, "look", lambda *args: looks.append(args) or look(*args))

    def step(decoded: int, x_m: float, *things: Landmark, doubt=SPREADS[0], target: int | None = None):
        state = states[decoded] if target is None else replace(states[decoded], target=target)
        spread = (doubt[0], 0.0, 0.0, doubt[0], 0.0, doubt[1])
        rows = ScanLandmarks(rows_of(things))
        looks.clear()
        _, outcome = walker.step(state, at(mission, x_m, 0.0, state.t_s + 1, landmarks=rows, spread=spread))
        return len(looks), outcome

    elsewhere = Landmark("corner_convex", 5.0, 2.0, 1.0)
    assert [step(1, 4.0, *seen)[0] for seen in ((), (elsewhere,), (THINGS[0], elsewhere))] == [0, 0, 0]
    # What is known corrects a pose that is not sure; what is looked for is found.
    for doubt in SPREADS[1:3]:
        looked, outcome = step(1, 4.0, THINGS[0], doubt=doubt)
        assert looked == 1
        assert outcome.fix is not None
    for decoded, target in ((1, 2), (2, 1)):  # a node that is new, and one that is known and made for again
        looked, outcome = step(decoded, THINGS[target - 1].x_m - 0.5, THINGS[target - 1], target=target)
        assert looked == 1
        assert outcome.decoded is not None
        assert outcome.decoded.node == target


def test_who_is_given_gates_looks_for_what_is_behind_them():
    """A gaze belongs to a keyring, not only to what was decoded."""
    mission, walker, states = walks()[2 * BOTH.index(Profile.SEALED)]
    state = replace(states[1], opened=MappingProxyType({**states[1].opened}))  # which no other test has asked for
    seen = at(mission, 7.5, 0.0, state.t_s + 1, landmarks=ScanLandmarks(rows_of(THINGS[1:2])))
    locked = replace(state, keys=Keyring())
    assert walker.step(locked, seen)[1].decoded is None
    assert walker.step(state, seen)[1].decoded is not None
    assert walker.step(locked, seen)[1].decoded is None


def test_what_a_scan_shows_is_told_as_landmarks():
    things = (*THINGS, Landmark("corner_convex", math.pi, -1.0, 0.0))
    seen = ScanLandmarks(rows_of(things))
    assert tuple(seen) == things
    assert len(seen) == len(things)
    assert seen[1] is seen.landmarks[1]
    assert seen[-2:] == things[-2:]
    assert np.array_equal(rows_of(seen), rows_of(things), equal_nan=True)
    assert not ScanLandmarks(rows_of(()))
