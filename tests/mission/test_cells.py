"""Cells: compiled as plain, and the memory of a search, which saves time and changes nothing."""

from __future__ import annotations

import math
import struct

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.config.mission import MissionConfig
from phalanx.crypto.sha3 import Targets, find, padded, sha3_256
from phalanx.mission import Experience, Landmark, Profile
from phalanx.mission.pose.spread import Sight
from phalanx.mission.walk.cells import (
    BIN_STEPS,
    CELL_LIMIT,
    RINGS,
    Groups,
    Message,
    PoseUncertainty,
    bins_beside,
    level_of,
    numbers_of,
    search_cells,
    search_shapes,
)
from phalanx.mission.walk.search import Budget
from phalanx.mission.walk.search_paper import PaperSearch
from phalanx.mission.walk.searched import SearchMemory
from worlds import built, corridor

metres = st.floats(-1e6, 1e6)
STEPS = (0.1, 0.1, math.pi / 12, 2.0)


@settings(deadline=None)
@given(metres, metres, st.floats(-10, 10), st.floats(-5, 1e5), st.tuples(*[st.floats(-0.2, 0.2)] * 4))
def test_a_cell_is_what_python_rounds_to_compiled_and_plain(x, y, turn, area, offset):
    rounded = [round((value - off) / step) for value, off, step in zip((x, y, turn, area), offset, STEPS, strict=True)]
    expected = (rounded[0], rounded[1], rounded[2] % 24, max(0, min(CELL_LIMIT, rounded[3])))
    assert numbers_of(x, y, turn, area, offset, STEPS, 24) == expected
    assert numbers_of.py_func(x, y, turn, area, offset, STEPS, 24) == expected
    assert numbers_of(x, y, math.nan, math.nan, offset, STEPS, 24) == (*expected[:2], -1, -1)


def test_halves_go_to_the_even_cell_and_what_is_too_far_to_the_last():
    def at(x: float, y: float, step: float) -> tuple[int, ...]:
        return numbers_of(x, y, math.nan, math.nan, (0.0,) * 4, (step,) * 4, 1)[:2]

    assert [at(x, 0.0, 1.0)[0] for x in (0.5, 1.5, -0.5, 2.5)] == [0, 2, 0, 2]
    assert at(1e12, -1e12, 0.1) == (CELL_LIMIT, -CELL_LIMIT)


def _search() -> PaperSearch:
    return PaperSearch(built(corridor(5), Profile.PAPER).mission, MissionConfig())


def _tried(search: PaperSearch, seen: Experience, tries: int) -> tuple[list[object], int]:
    budget = Budget(tries)
    return list(search.run((0, 1, 2, 3, 4), seen, (), b"", budget)), budget.used


doors = st.builds(
    Landmark, st.just("doorway"), st.floats(-1, 20), st.floats(-1, 3), st.one_of(st.none(), st.floats(-3, 3))
)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.lists(doors, max_size=4), st.integers(0, 30_000)), min_size=2, max_size=6))
def test_what_was_searched_before_changes_neither_what_is_found_nor_the_tries(steps):
    experienced = _search()
    for landmarks, tries in steps + steps:
        seen = Experience(0.0, 3.0, 0.2, 0.0, landmarks=tuple(landmarks))
        assert _tried(experienced, seen, tries) == _tried(_search(), seen, tries)


def test_a_search_that_is_made_again_hashes_nothing_again(monkeypatch):
    search, hashed = _search(), []

    def counted(*arguments):
        hashed.append(arguments)
        return find(*arguments)

    monkeypatch.setattr("phalanx.mission.walk.cells.find", counted)
    monkeypatch.setattr("phalanx.mission.walk.cells.search_cells", search_cells.py_func)
    monkeypatch.setattr("phalanx.mission.walk.search_paper.search_shapes", search_shapes.py_func)
    seen = Experience(0.0, 3.0, 0.2, 0.0, landmarks=(Landmark("doorway", 9.3, 1.1, 0.4),))
    first, before = _tried(search, seen, 100_000), len(hashed)
    assert before > 0
    assert _tried(search, seen, 100_000) == first
    assert len(hashed) == before


def test_a_search_one_cell_further_hashes_an_edge_alone(monkeypatch):
    hashed = []

    def counted(template, word, shift, patches, targets):
        hashed.append(len(patches))
        return find(template, word, shift, patches, targets)

    monkeypatch.setattr("phalanx.mission.walk.cells.find", counted)
    searched, kernel = SearchMemory(), search_cells.py_func
    for x_m in (-0.8, -0.7, -0.9, -0.8):
        _asked(searched, [x_m], kernel=kernel)
    assert hashed == [11 * 11, 11, 11]


def _doubt(metres: float = 0.145, radians: float = 0.0) -> PoseUncertainty:
    """Five rings around what is near, of cells of 0.1 m."""
    return PoseUncertainty(0.0, 0.0, np.diag([metres**2, metres**2, radians**2]), Sight(0.001, 0.0, 0.001), 3.5, 1.0)


MESSAGE = Message(padded(bytes(40), 8), 1, 0)


def _asked(
    searched: SearchMemory,
    xs_m: list[float],
    first: int = 0,
    left: int = 10_000,
    wanted: int | None = None,
    kernel=search_cells,
):
    """What a search around these places tells, where the digest of one cell is wanted, or none."""
    things = np.array([[x_m, 0.0, math.nan, math.nan] for x_m in xs_m])
    text = struct.pack("<8xiihih16x", wanted or 0, 0, -1, -1, 0)
    targets = Targets([] if wanted is None else [sha3_256(text)])
    groups = Groups(np.zeros((1, 5)), targets.rows, np.array([0, len(targets.rows)]))
    return kernel(first, things, False, _doubt(), groups, STEPS, 1, searched.known, np.array([1]), left, MESSAGE)


def test_a_search_tells_where_it_found_what_and_goes_on_behind_it():
    # The pairs of a thing and a group are three, for the bins; without an orientation one of them is searched.
    places, searched = [0.0, 1.0, 2.0], SearchMemory()
    pair, row, left, cell, after = _asked(searched, places, wanted=12)
    assert (pair, row, cell, after) == (3, 0, (12, 0, -1, -1), 4)
    assert 10_000 - 11 * 11 - 5 * 5 <= left < 10_000 - 11 * 11 - 3 * 3, "one cell around, and of the next two rings"
    assert _asked(searched, places, after, left, wanted=12) == (-1, -1, left - 11 * 11, (0, 0, 0, 0), -1)
    assert searched.known.used[0] == 2, "what was found is looked for again"
    assert _asked(searched, places, wanted=12) == (pair, row, left, cell, after)


def test_a_search_ends_with_its_tries_and_does_not_call_searched_what_was_not():
    searched = SearchMemory()
    assert _asked(searched, [0.0, 1.0, 2.0, 3.0, 4.0], left=400)[2] == 37 - 7 * 7
    assert searched.known.used[0] == 3, "of the fourth the first rings alone"
    assert _asked(searched, [4.0], wanted=40)[3] == (40, 0, -1, -1), "nobody came so far"
    assert _asked(SearchMemory(), [0.0, 1.0], left=0)[:3] == (-1, -1, 0)


def test_a_full_table_is_emptied_and_never_knows_what_was_not_added():
    searched = SearchMemory(rows=64)
    lane = searched.lane("a", len(RINGS))
    assert searched.lane("a", len(RINGS)) == lane
    assert searched.lane("b", 1) not in range(lane, lane + len(RINGS))
    for x in range(120):
        _asked(searched, [x / 10])
    own, table = lane + RINGS.index(5), searched.known.table
    known = sorted(row[1] for row in table.tolist() if row[0] == own)
    assert known == list(range(96, 120)), "of 64 rows 48 are used, and 120 is 48 and 48 and 24"
    assert searched.known.used[0] == np.count_nonzero(table[:, 0]) == 24


@settings(deadline=None)
@given(
    st.tuples(metres, metres).map(lambda at: (at[0] / 1e5, at[1] / 1e5)),
    st.floats(-3.2, 3.2) | st.just(math.nan),
    st.booleans(),
    st.tuples(st.floats(0, 1), st.floats(0, 0.5)),
)
def test_a_region_is_the_same_compiled_and_plain_and_reaches_as_far_as_the_doubt(at, turn, place, sure):
    thing, doubt = np.array([*at, turn, math.nan]), _doubt(*sure)
    level, beside = level_of(thing, place, STEPS, doubt), bins_beside(turn, 0.0, STEPS[2], doubt)
    assert level == level_of.py_func(thing, place, STEPS, doubt)
    assert beside == bins_beside.py_func(turn, 0.0, STEPS[2], doubt)
    rings = RINGS[level]
    far = 0.0 if place else math.hypot(*at) * sure[1]
    # From the middle of the cell, and at most so far off it.
    assert (rings + 0.5) * STEPS[0] >= min(3.5 * math.hypot(sure[0], far), 1.0) - 1e-9
    assert any(beside) <= (not math.isnan(turn))


def test_bins_beside_are_tried_where_the_heading_leaves_them_open():
    def bins(turn: float, radians: float) -> tuple[bool, bool]:
        return bins_beside(turn * STEPS[2], 0.0, STEPS[2], _doubt(0.1, radians))

    assert len(BIN_STEPS) == 3
    assert bins(0.0, 0.0) == (False, False)
    assert bins(0.45, 0.01) == (True, False), "15 degrees a bin, and 0.75 degrees from the next: 3.5 times 0.57"
    assert bins(-0.45, 0.01) == (False, True)
    assert bins(0.0, 0.1) == (True, True)
