"""Buildings that chance has drawn: whole, the same by the same name, and all of each can be reached."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.cli.commands.mission import mission as group
from phalanx.errors import UsageError
from phalanx.lab.buildings.drawn import KINDS, drawn
from phalanx.mission.landmarks import FloorPlan, landmarks_of
from phalanx.world.building.floorplan import load_floorplan
from phalanx.world.building.walkers import Walkers

ROBOT_M = 0.175
# So far from walls is a place where a robot can stand and turn.
ROOM_M = ROBOT_M + 0.075
STEP_M = 0.1
Cell = tuple[int, int]

# Of each kind's building 1: walls, and the sum of their ends.
KNOWN = {
    "office": (184, 9203.09),
    "alike": (84, 2349.46),
    "flat": (80, 1569.1),
    "pillars": (58, 1501.1),
    "racks": (28, 736.95),
    "corridor": (28, 921.56),
    "mirror": (100, 3031.66),
    "clutter": (44, 963.54),
}

names = st.builds("drawn:{}:{}".format, st.sampled_from(list(KINDS)), st.integers(0, 100_000))


def at(cell: Cell) -> tuple[float, float]:
    return cell[0] * STEP_M, cell[1] * STEP_M


def around(cell: Cell) -> Iterator[Cell]:
    for dx, dy in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        yield cell[0] + dx, cell[1] + dy


def spread(first: Cell, free: set[Cell]) -> set[Cell]:
    reached, waiting = {first}, deque([first])
    while waiting:
        new = [cell for cell in around(waiting.popleft()) if cell in free and cell not in reached]
        reached.update(new)
        waiting += new
    return reached


def unreached(plan: FloorPlan) -> list[tuple[float, float]]:
    """A place in each space inside where a robot could stand, and does not come to from where it begins."""
    _, _, width, height = plan.bounds
    cells = [(i, j) for i in range(math.ceil(width / STEP_M)) for j in range(math.ceil(height / STEP_M))]
    free = {cell for cell in cells if plan.clearance_m(*at(cell)) >= ROOM_M}
    assert plan.start is not None
    begin = min(free, key=lambda cell: math.dist(at(cell), plan.start[:2]))
    free -= spread(begin, free)
    missed = []
    while free:
        first = next(iter(free))
        free -= spread(first, free)
        missed += [at(first)] if plan.inside(*at(first)) else []
    return missed


@settings(max_examples=5)
@given(names)
def test_all_of_a_building_can_be_reached_by_a_robot(name: str) -> None:
    assert unreached(drawn(name)) == []


@settings(max_examples=30)
@given(names)
def test_walls_have_a_length_and_lie_within_the_bounds(name: str) -> None:
    plan = drawn(name)
    x0, y0, x1, y1 = plan.bounds
    lengths_m = np.hypot(plan.walls[:, 2] - plan.walls[:, 0], plan.walls[:, 3] - plan.walls[:, 1])
    assert np.all(lengths_m > 5e-5), "places are whole tenths of a millimetre"
    assert np.all((plan.walls[:, ::2] >= x0) & (plan.walls[:, ::2] <= x1))
    assert np.all((plan.walls[:, 1::2] >= y0) & (plan.walls[:, 1::2] <= y1))
    assert 6 < min(x1 - x0, y1 - y0) <= max(x1 - x0, y1 - y0) < 50
    assert plan.outlines


@settings(max_examples=30)
@given(names)
def test_robots_begin_where_there_is_room(name: str) -> None:
    plan = drawn(name)
    assert plan.start is not None
    assert plan.inside(*plan.start[:2])
    assert plan.clearance_m(*plan.start[:2]) >= 0.4
    assert abs(plan.start[2]) < 2 * math.pi


@settings(max_examples=20)
@given(names)
def test_a_name_is_always_the_same_building(name: str) -> None:
    one, other = drawn(name), load_floorplan(name)
    assert one.name == name
    assert (one.start, one.bounds) == (other.start, other.bounds)
    assert np.array_equal(one.walls, other.walls)


def test_a_seed_alone_decides_the_kind_and_seeds_differ() -> None:
    plans = [drawn(f"drawn:{seed}") for seed in range(2 * len(KINDS))]
    assert [plan.name for plan in plans[: len(KINDS)]] == [f"drawn:{kind}:{i}" for i, kind in enumerate(KINDS)]
    assert len({plan.walls.tobytes() for plan in plans}) == len(plans)


def test_a_building_of_each_kind_is_the_one_that_it_was() -> None:
    # Whoever changes what is drawn changes what measurements by these names mean.
    walls = {kind: drawn(f"drawn:{kind}:1").walls for kind in KINDS}
    assert {kind: (len(each), round(float(np.abs(each).sum()), 2)) for kind, each in walls.items()} == KNOWN


@pytest.mark.parametrize("kind", KINDS)
def test_people_find_room_and_robots_find_landmarks(kind: str) -> None:
    plans = [drawn(f"drawn:{kind}:{seed}") for seed in range(2)]
    assert all(landmarks_of(plan) for plan in plans)
    for plan in plans:
        Walkers(plan, 3, np.random.default_rng(0)).step(10.0)


@pytest.mark.parametrize("name", ["drawn:", "drawn:x", "drawn:hut:1", "drawn:-1", "drawn:1.5", "drawn:99999999999"])
def test_a_name_that_names_no_building_is_said(name: str) -> None:
    with pytest.raises(UsageError, match="is called"):
        load_floorplan(name)


@pytest.mark.long
def test_missions_are_made_for_drawn_buildings_and_run_in_them(tmp_path) -> None:
    file = str(tmp_path / "m.phxm")
    words = ("build", "--map", "drawn:office:1", "--profile", "paper", "--out", file)
    assert CliRunner().invoke(group, words, standalone_mode=False).exception is None
    words = ("run", file, "--world", "drawn:office:1", "--duration", "2")
    done = CliRunner().invoke(group, words, standalone_mode=False)
    assert done.exception is None
    assert "nodes decoded" in done.stdout
