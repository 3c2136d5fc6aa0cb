"""Where robots are, packed: as the vectors say, in however many pieces."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mirror import read_places, read_route
from phalanx.gateway.places import NOWHERE, Places, encode_route, group_places
from phalanx.robot import Point

VECTORS = Path(__file__).parent.parent / "vectors"
CASES, ROUTES = (json.loads((VECTORS / name).read_text())["cases"] for name in ("places.json", "routes.json"))


def table(rows) -> np.ndarray:
    return np.array(rows, np.int64).reshape(-1, 4)


@pytest.mark.parametrize("case", [case for case in CASES if "rows" in case], ids=lambda case: case["name"])
def test_places_are_packed_as_the_oracle_does_it(case):
    places = Places(table(case["rows"]))
    assert [places.encode()] == case["places"]
    assert read_places(case["places"]) == [tuple(row) for row in case["read"]]


numbers = st.lists(st.integers(1, 700), max_size=60).map(lambda gaps: np.cumsum([0, *gaps]).tolist())
near = st.integers(-30_000, 30_000)


@given(numbers, st.data())
def test_every_robot_is_told_exactly(them, data):
    rows = [(n, data.draw(near), data.draw(near), data.draw(st.integers(0, 359))) for n in them]
    assert read_places([Places(table(rows)).encode()]) == rows


@given(st.lists(st.tuples(st.integers(-(10**9), 10**9), st.integers(-(10**9), 10**9)), min_size=1, max_size=20))
def test_on_a_wide_field_no_place_is_off_by_more_than_half_a_step(at):
    rows = [(n, x, y, 0) for n, (x, y) in enumerate(at)]
    piece = Places(table(rows)).encode()
    extent = max(max(v[axis] for v in at) - min(v[axis] for v in at) for axis in (0, 1))
    assert piece[3] <= max(1, extent / 65535 + 1)
    for (_, x, y, _), (_, told_x, told_y, _) in zip(rows, read_places([piece]), strict=True):
        assert max(abs(x - told_x), abs(y - told_y)) <= piece[3] / 2


def test_one_that_is_far_away_does_not_blur_where_the_others_are():
    rows = [(0, 1757, 402, 10), (1, 871, 1551, 20), (2, 9_000_000, 9_000_000, 30), (3, 900, 800, 40)]
    told = read_places([some.encode() for some in group_places(table(rows))])
    assert sorted(told) == rows


def test_what_swarms_that_come_and_go_leave_out_costs_a_piece_and_no_more():
    rows = [(0, 1, 1, 0), (10**9, 2, 2, 0), (10**9 + 1200, 3, 3, 0)]
    places = group_places(table(rows))
    assert len(places) == 2
    assert read_places([some.encode() for some in places]) == rows


def test_nobody_is_packed_as_nothing():
    assert group_places(table([])) == []


@pytest.mark.parametrize("case", [case for case in ROUTES if "points" in case], ids=lambda case: case["name"])
def test_routes_are_packed_as_the_oracle_does_it(case):
    assert encode_route(7, [Point(float(x), float(y)) for x, y in case["points"]]) == case["route"]


@given(st.lists(st.builds(Point, st.floats(), st.floats()), max_size=70))
def test_a_route_is_told_as_far_as_its_points_are_somewhere(route):
    _, *told = encode_route(0, route)
    somewhere = [point for point in route if abs(point.x_mm) < NOWHERE and abs(point.y_mm) < NOWHERE][:65]
    for point, read in zip(somewhere, read_route(told), strict=True):
        assert max(abs(point.x_mm - read["x"]), abs(point.y_mm - read["y"])) <= told[2] / 2 + 0.5
