"""The search: its order, its size, and that it is the same compiled and plain."""

from __future__ import annotations

import math
from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.mission import Experience, Landmark, Profile
from phalanx.mission.file.canonical import AT_POSITION, Shape
from phalanx.mission.observable import LANDMARK_TYPES, Cell, Offset, middle_of
from phalanx.mission.pose.spread import misfit
from phalanx.mission.walk.fix import fits, sighting
from phalanx.mission.walk.search import is_around, placed, pose_uncertainty, region
from phalanx.mission.walk.search_sealed import cells_that_fit
from phalanx.mission.walk.searched import spiral
from phalanx.papers.missions.fig8c import use_plain_hash
from worlds import built, corridor, walk, walker_of


def cells_around(shape, coding, doubt, landmark, centre, offset):
    """Return the cells in which the thing may truly be that was seen in `centre`: ring after ring, likely bins first."""
    rings, steps, bins = region(shape, coding, doubt, landmark, offset)
    return [
        centre._replace(
            x=centre.x + dx, y=centre.y + dy, bin=centre.bin if centre.bin < 0 else (centre.bin + step) % bins
        )
        for dx, dy in spiral(rings)
        for step in steps
    ]


def test_the_compiled_and_the_plain_search_walk_alike():
    mission = corridor(4)
    config = MissionConfig(tolerance_m=0.3)
    compiled = list(walk(mission, walker_of(built(mission, Profile.PAPER), config), steps_each=3))
    with use_plain_hash():
        assert list(walk(mission, walker_of(built(mission, Profile.PAPER), config), steps_each=3)) == compiled


@pytest.mark.parametrize("rings", range(6))
def test_a_spiral_visits_every_cell_once_ring_after_ring(rings):
    steps = spiral(rings)
    assert len(set(steps)) == len(steps) == (2 * rings + 1) ** 2
    assert [max(abs(x), abs(y)) for x, y in steps] == sorted(max(abs(x), abs(y)) for x, y in steps)


LANDMARK, HERE = Shape(1), Shape(AT_POSITION)


def cells(config: MissionConfig, delta_mm: int, spread: tuple[float, ...], x_m: float = 0.0, shape: Shape = HERE):
    """As many as are tried around a door so far ahead, or around the robot."""
    seen = Experience(0.0, 0.0, 0.0, 0.0, spread=spread)
    door = Landmark("doorway", x_m, 0.0) if shape.place == 1 else None
    coding = CodingConfig(delta_mm=delta_mm)
    return len(cells_around(shape, coding, pose_uncertainty(config, seen), door, Cell(0, 0), Offset()))


def test_as_many_cells_as_the_paper_tests_where_the_robot_is_as_unsure_as_there():
    lost = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    for delta_mm, many in ((400, 9), (200, 25), (100, 121), (50, 441), (25, 1681)):
        assert cells(MissionConfig(tolerance_m=0.5), delta_mm, lost) == many


def test_the_search_goes_as_far_as_the_robot_is_unsure_and_never_beyond_its_tolerance():
    config = MissionConfig(tolerance_m=1.0)

    def known(metres: float, degrees: float = 0.0) -> tuple[float, ...]:
        return metres**2, 0.0, 0.0, metres**2, 0.0, math.radians(degrees) ** 2

    tried = [cells(config, 100, known(metres)) for metres in (0.01, 0.1, 0.2, 0.5, 5.0)]
    assert tried == [1, 49, 225, 441, 441], "none, 3, 7 and 10 rings"
    near, far = (cells(config, 100, known(0.04, 3.0), x_m, LANDMARK) for x_m in (1.0, 6.0))
    assert near < far == 441, "a heading that is off moves what is far away, and little of what is near"
    assert cells(config, 100, known(0.04, 3.0)) == cells(config, 100, known(0.04)), "nor the robot itself"


@pytest.mark.parametrize(
    "shape, turn_rad, centre",
    [
        (Shape(0), None, Cell(0, 0)),
        (HERE, None, Cell(3, -2)),
        (LANDMARK, 0.3, Cell(1, 2, -1, 4)),
        (Shape(1, oriented=True), 0.3, Cell(1, 2, 0)),
        (Shape(1, oriented=True), 0.3, Cell(1, 2, 2)),
    ],
)
def test_a_cell_is_around_another_if_it_is_tried(shape, turn_rad, centre):
    seen = Experience(0.0, 0.0, 0.0, 0.0, spread=(0.04, 0.0, 0.0, 0.04, 0.0, 0.02))
    door = Landmark("doorway", 1.5, 0.7, turn_rad) if shape.place == 1 else None
    asked = shape, CodingConfig(delta_mm=200), pose_uncertainty(MissionConfig(), seen), door, centre, Offset(30, -20, 5)
    tried = set(cells_around(*asked))
    assert len(tried) > (8 if shape.place else 0)
    bins = CodingConfig().heading_bins
    near = {Cell(*at) for at in product(range(-12, 13), range(-12, 13), range(-1, bins), (-1, 4, 5))}
    assert tried <= near
    assert {cell for cell in near if is_around(*asked, cell)} == tried


@settings(deadline=None)
@given(
    st.floats(-3.2, 3.2),
    st.booleans(),
    st.sampled_from(["doorway", "concave_left"]),
    st.tuples(st.floats(0.01, 0.3), st.floats(0.001, 0.2)),
    st.tuples(*[st.integers(-50, 50)] * 2, st.integers(-1000, 1000)),
)
def test_the_slow_search_tries_what_fits_of_the_cells_around(turn, oriented, kind, sure, moved):
    coding, config, offset = CodingConfig(), MissionConfig(), Offset(*moved)
    shape = Shape(1 + LANDMARK_TYPES.index(kind), int(oriented))
    landmark = Landmark(kind, 2.0, -1.0, turn)
    spread = (sure[0] ** 2, 0.0, 0.0, sure[0] ** 2, 0.0, sure[1] ** 2)
    seen = Experience(0.0, 0.1, 0.2, 0.0, landmarks=(landmark,), spread=spread)
    ((_, centre),) = placed(shape, coding, seen, (), offset, 0)
    doubt, expected = pose_uncertainty(config, seen), []
    for cell in cells_around(shape, coding, doubt, landmark, centre, offset):
        match = sighting(landmark, Landmark(kind, *middle_of(coding, offset, cell)), 2.0, -1.0)
        if fits(config, doubt.spread, 0.1, 0.2, match):
            expected.append((misfit(doubt.spread, 0.1, 0.2, match, doubt.sight), cell))
    assert cells_that_fit(shape, coding, doubt, landmark, centre, offset) == expected
