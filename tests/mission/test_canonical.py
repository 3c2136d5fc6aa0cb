"""Canonical bytes: two meanings never have the same spelling, and a measured thing lies in the cell of the true one."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.config.mission import CodingConfig
from phalanx.errors import UsageError
from phalanx.mission import LANDMARK_TYPES, Action, Direction, Landmark, Position
from phalanx.mission.file.canonical import (
    Shape,
    action_bytes,
    canonical,
    parse_action,
    parse_shape,
    place_bytes,
    shape_of,
    with_direction,
)
from phalanx.mission.observable import Cell, bins_of, cell_of, middle_of, offset_of, sector_of
from phalanx.mission.refused import MalformedMission

texts = st.text(st.characters(codec="utf-8"), min_size=1, max_size=12)
values = st.one_of(st.integers(-(10**9), 10**9).map(lambda n: n / 1000), texts)
actions = st.builds(
    lambda name, args: Action(name, tuple(sorted(args.items()))), texts, st.dictionaries(texts, values, max_size=4)
)
parts = st.fixed_dictionaries(
    {},
    optional={
        "sensors": st.lists(st.binary(max_size=5), max_size=3).map(sorted).map(tuple),
        "action": actions,
        "window": st.integers(-(2**62), 2**62),
        "messages": st.lists(st.binary(max_size=5), max_size=3).map(sorted).map(tuple),
        "previous": st.binary(max_size=40),
        "direction": st.builds(Direction, st.integers(0, 3599), st.integers(4, 3600)),
    },
)
landmarks = st.builds(
    Landmark,
    st.sampled_from(LANDMARK_TYPES),
    st.floats(-900, 900),
    st.floats(-900, 900),
    st.none() | st.floats(-math.pi, math.pi),
    st.none() | st.floats(0, 500),
)
codings = st.builds(
    CodingConfig,
    delta_mm=st.integers(20, 1000),
    heading_bins=st.integers(4, 100).map(lambda n: 2 * n),
    area_cm2=st.integers(200, 50_000),
)


def meaning(words: dict) -> dict:
    return {key: value for key, value in words.items() if value != ()}


@given(parts, parts)
def test_two_meanings_have_two_spellings(one, two):
    assert (canonical(**one) == canonical(**two)) == (meaning(one) == meaning(two))


def test_the_papers_concatenation_would_confuse_these():
    assert canonical(sensors=[b"1", b"12"]) != canonical(sensors=[b"11", b"2"])
    shape = Shape(place=1)
    assert place_bytes(shape, Cell(1, 12)) != place_bytes(shape, Cell(11, 2))


@given(parts, st.integers(0, 119))
def test_a_way_is_the_nodes_bytes_with_a_direction_after_them(node, sector):
    node.pop("direction", None)
    direction = Direction(sector, 120)
    assert with_direction(canonical(**node), direction) == canonical(**node, direction=direction)


@given(actions)
def test_actions_come_back_as_they_were_written(action):
    assert action_bytes(parse_action(action_bytes(action))) == action_bytes(action)
    assert parse_action(action_bytes(action)) == action


@given(st.binary(max_size=60))
def test_any_bytes_are_an_action_or_refused(raw):
    try:
        action = parse_action(raw)
    except MalformedMission:
        return
    assert parse_action(action_bytes(action)) == action


@given(st.integers(0, 2**16 - 1))
def test_every_shape_has_one_code(code):
    try:
        shape = parse_shape(code)
    except MalformedMission:
        return
    assert shape.code == code


@given(codings, landmarks, st.floats(-0.49, 0.49), st.floats(-0.49, 0.49), st.floats(-0.45, 0.45))
def test_whoever_measures_to_less_than_half_a_cell_finds_the_cell(coding, truth, dx, dy, turn):
    # A mm, 1e-4 rad and 0.01 m2 are lost where offsets are rounded.
    offset = offset_of(coding, truth)
    delta = coding.delta_mm / 1000 - 0.002
    orientation = None if truth.orientation_rad is None else truth.orientation_rad + turn * (coding.bin_rad - 2e-4)
    seen = replace(truth, x_m=truth.x_m + dx * delta, y_m=truth.y_m + dy * delta, orientation_rad=orientation)
    cell = cell_of(coding, offset, seen.x_m, seen.y_m, seen)
    assert cell == cell_of(coding, offset, truth.x_m, truth.y_m, truth)
    x, y, middle = middle_of(coding, offset, cell)
    assert (x, y) == (pytest.approx(truth.x_m, abs=6e-4), pytest.approx(truth.y_m, abs=6e-4))
    if truth.orientation_rad is not None:
        period = coding.bin_rad * bins_of(coding, truth.type)
        off = (middle - truth.orientation_rad + period / 2) % period - period / 2
        assert abs(off) < 1e-4


def test_a_doorway_is_the_same_from_both_sides():
    coding = CodingConfig()
    front, back = Landmark("doorway", 3, 4, 0.3), Landmark("doorway", 3, 4, 0.3 - math.pi)
    offset = offset_of(coding, front)
    assert cell_of(coding, offset, 3, 4, front) == cell_of(coding, offset, 3, 4, back)
    assert cell_of(coding, offset, 3, 4, replace(front, type="qr")) != cell_of(
        coding, offset, 3, 4, replace(back, type="qr")
    )


def test_sectors_are_centred_on_the_axes():
    assert [sector_of(math.radians(degrees), 8) for degrees in (0, 22, 23, 90, -22, -23, 359)] == [0, 0, 1, 2, 0, 7, 0]


@pytest.mark.parametrize(
    "see",
    [
        (Position(0, 0), Landmark("qr", 0, 0)),
        (Action("a"), Action("b")),
    ],
)
def test_a_conjunction_that_the_format_cannot_say_is_refused(see):
    with pytest.raises(UsageError):
        shape_of(see)


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e7])
def test_a_landmark_is_somewhere(bad):
    with pytest.raises(UsageError):
        Landmark("room", bad, 0)
    with pytest.raises(UsageError):
        Landmark("room", 0, 0, area_m2=bad)
    with pytest.raises(UsageError, match="no landmark type"):
        Landmark("window", 0, 0)
