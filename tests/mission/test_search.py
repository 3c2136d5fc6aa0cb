"""The search: its order, its size, and that it is the same compiled and plain."""

from __future__ import annotations

import hashlib

import pytest
from worlds import built, corridor, walk, walker_of

from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.mission import (
    Profile,
)
from phalanx.mission.walk.search import rings_of, spiral


def test_the_compiled_and_the_plain_search_walk_alike(monkeypatch):
    def plain(message, where, patches, targets):
        digests = [targets.rows[i].astype("<u8").tobytes() for i in range(len(targets.rows))]
        for i, patch in enumerate(patches):
            tried = message[:where] + int(patch).to_bytes(8, "little") + message[where + 8 :]
            digest = hashlib.sha3_256(tried).digest()
            if digest in digests:
                return i, targets.place(digests.index(digest))
        return None

    mission = corridor(4)
    config = MissionConfig(tolerance_m=0.3)
    compiled = list(walk(mission, walker_of(built(mission, Profile.PAPER), config), steps_each=3))
    monkeypatch.setattr("phalanx.mission.walk.search.find_patched", plain)
    assert list(walk(mission, walker_of(built(mission, Profile.PAPER), config), steps_each=3)) == compiled


@pytest.mark.parametrize("rings", range(6))
def test_a_spiral_visits_every_cell_once_ring_after_ring(rings):
    steps = spiral(rings)
    assert len(set(steps)) == len(steps) == (2 * rings + 1) ** 2
    assert [max(abs(x), abs(y)) for x, y in steps] == sorted(max(abs(x), abs(y)) for x, y in steps)


def test_as_many_cells_as_the_paper_tests():
    for delta_mm, cells in ((400, 9), (200, 25), (100, 121), (50, 441), (25, 1681)):
        assert len(spiral(rings_of(MissionConfig(), CodingConfig(delta_mm=delta_mm), 1 << 20))) == cells
