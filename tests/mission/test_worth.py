"""What a mission is worth: the numbers of the audit, and the brute force that is really run."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from phalanx.cli.mission.files import read_plain
from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.lab.cracking.force import crack_paper, crack_sealed
from phalanx.mission import Draft, Landmark, Mission, Position, Profile, Sensor
from phalanx.mission.authoring.compiling import alias_offset
from phalanx.mission.file.canonical import shape_of
from phalanx.mission.observable import Offset, cell_of, middle_of
from phalanx.mission.worth.audit import Rates, audit
from phalanx.mission.worth.guessing import OUT_OF_REACH
from phalanx.mission.worth.shown import Before, candidates_in, cell_in
from phalanx.world.building.floorplan import load_floorplan
from worlds import BOTH, CHEAP, built, cheap, corridor, decoded_of, walk, walker_of

BOX = (0.0, 0.0, 12.0, 10.0)


def small(coding: CodingConfig, *, x: float = 4.0) -> Draft:
    draft = Draft("small", coding=coding, area_m=BOX)
    draft.node("start", Position(1.0, 1.0), start=True)
    draft.node("door", Landmark("doorway", x, 2.17, 0.3))
    draft.node("corner", Landmark("concave_left", 9.03, 7.0, -2.0))
    draft.way("start", "door")
    draft.way("door", "corner")
    return draft


def rows(draft: Draft, profile: Profile, **more):
    report = audit(draft.mission(), profile, **more)
    return report, {row.name: row for row in report.nodes}


class TestAudit:
    def test_a_doorway_anywhere_on_a_map_is_as_many_candidates_as_the_page_says(self):
        draft = Draft("one", area_m=(0, 0, 40, 40))
        draft.node("door", Landmark("doorway", 3, 4, 0.0), start=True)
        _, row = rows(draft, Profile.PAPER)
        assert row["door"].candidates == pytest.approx(400 * 400 * 12)  # 1.9 M
        assert row["door"].core_s == pytest.approx(400 * 400 * 12 / Rates().hash_core)

    def test_what_the_node_before_reveals_narrows_the_next_to_a_corridor(self):
        report, row = rows(small(CodingConfig()), Profile.PAPER)
        everywhere = 120 * 100
        assert row["start"].candidates == pytest.approx(everywhere * 3)
        assert row["door"].candidates < 0.1 * everywhere * 12 * 3
        # Costs along a walk add and never multiply.
        assert report.core_s == pytest.approx(sum(r.core_s for r in report.nodes))

    def test_near_places_first_is_cheaper_and_dearer_for_a_door_farther_away(self):
        near, far = (rows(small(CodingConfig(), x=x), Profile.PAPER)[1]["door"] for x in (3.0, 6.0))
        assert near.nearest < far.nearest < far.candidates
        report = audit(replace(office(), coding=None), Profile.SEALED, open_start=True)
        lone = [row for row in report.nodes if row.name[0] in "DC"]  # doors and corners
        assert [round(sum(getattr(row, name) for row in lone)) for name in ("candidates", "nearest")] == [28_945, 5288]
        assert report.nearest_core_s < report.core_s / 2

    def test_without_its_start_key_a_sealed_mission_cannot_be_guessed_at_all(self):
        report, row = rows(small(CHEAP), Profile.SEALED)
        assert row["start"].candidates >= OUT_OF_REACH
        # Nothing could be summed: that is no cost of 0.
        assert report.out_of_reach == len(report.nodes)
        assert report.core_s == report.gpu_s == math.inf
        told = json.loads(json.dumps(report.to_json(), allow_nan=False))
        assert (told["core_s"], told["gpu_s"]) == (None, None)
        report, row = rows(small(CHEAP), Profile.SEALED, open_start=True)
        assert row["start"].candidates == pytest.approx(30 * 25)
        assert 0 < report.core_s < math.inf
        assert report.to_json()["core_s"] == report.core_s

    def test_what_is_behind_a_message_or_a_random_token_is_out_of_reach(self):
        for barrier in ("message", "token", "reading"):
            draft = small(CHEAP)
            if barrier == "message":
                draft.nodes[1] = replace(draft.nodes[1], wait=("go",))
            elif barrier == "reading":
                draft.nodes[1] = replace(draft.nodes[1], see=((Sensor(b"ab" * 16),),))
            else:
                draft.nodes[1] = replace(draft.nodes[1], see=((Landmark("qr", 4, 2, 0.3, None, "ab" * 16),),))
            report, row = rows(draft, Profile.SEALED, open_start=True)
            assert row["door"].candidates >= OUT_OF_REACH, barrier
            assert report.core_s == pytest.approx(row["start"].core_s), "and so is what comes after it"
        draft = small(CHEAP)
        draft.nodes[1] = replace(draft.nodes[1], see=((Landmark("qr", 4, 2, 0.3, None, "shelf 3"),),))
        _, row = rows(draft, Profile.SEALED, open_start=True)
        assert row["door"].candidates < OUT_OF_REACH, "a text that hangs on a wall is public"

    @pytest.mark.parametrize("value, bits", [(b"5f" * 16, 128), (b"gas", 0)])
    def test_a_floor_plan_shows_no_random_reading(self, value, bits):
        plain = office()
        start = replace(plain.nodes[0], see=((Sensor(value),),))
        mission = replace(plain, nodes=(start, *plain.nodes[1:]))
        report = audit(mission, Profile.SEALED, open_start=True, plan=candidates_in(OFFICE, 1))
        assert report.nodes[0].by_plan == report.nodes[0].candidates == 2.0**bits

    def test_the_robots_own_search_is_told(self):
        config = MissionConfig(tolerance_m=1.0)
        _, row = rows(small(CodingConfig(delta_mm=400)), Profile.SEALED, config=config)
        assert row["door"].robot_ms == pytest.approx(10 * 25 * 3), "2 rings of 0.4 m in 3 bins: to a metre away"
        _, row = rows(small(CodingConfig(delta_mm=25)), Profile.PAPER, config=config)
        assert row["door"].robot_ms == pytest.approx(1000 * 81 * 81 * 3 / Rates().hash_core)

    def test_what_looks_wrong_is_said(self):
        draft = Draft("wrong", area_m=BOX)
        draft.node("start", Position(1, 1), start=True)
        draft.node("narrow", Landmark("doorway", 3, 3, 0.0), width_m=0.9)
        draft.node("twin", Landmark("doorway", 3.01, 3, 0.01))
        draft.node("near", Landmark("doorway", 3.3, 3, 0.0))
        draft.node("island", Landmark("doorway", 9, 9, 0.0))
        draft.node("red", Sensor(b"red"))
        draft.node("red too", Sensor(b"red"))
        for name in ("narrow", "twin", "near", "red", "red too"):
            draft.way("start", name)
        _, row = rows(draft, Profile.PAPER)
        assert any("a door of 0.9 m" in problem for problem in row["narrow"].problems)
        assert "one observation satisfies twin too" in row["narrow"].problems
        assert "one observation satisfies narrow too" in row["twin"].problems
        assert "unreachable from any start" in row["island"].problems
        assert any("within the search radius" in problem for problem in row["near"].problems)
        assert "one observation satisfies red too" in row["red too"].problems
        assert row["start"].problems == ()


class TestCrack:
    def test_a_paper_mission_is_read_by_whoever_tries_everything(self):
        draft = small(CodingConfig(delta_mm=200))
        one = built(draft.mission(), Profile.PAPER)
        batches = list(crack_paper(one.mission, BOX))
        found = {node.node: node for batch in batches for node in batch.found}
        assert set(found) == {0, 1, 2}
        assert (found[1].kind, found[1].x_m, found[1].y_m) == ("doorway", pytest.approx(4.0), pytest.approx(2.17))
        assert found[2].orientation_rad == pytest.approx(-2.0, abs=1e-3)
        assert sum(batch.tries for batch in batches) == batches[-1].of

    def test_a_chained_paper_mission_is_read_too_for_what_it_releases_is_public(self):
        draft = small(CodingConfig(delta_mm=500))
        draft.nodes[1] = replace(draft.nodes[1], chained=True)
        one = built(draft.mission(), Profile.PAPER)
        assert 1 in {node.node for batch in crack_paper(one.mission, BOX) for node in batch.found}

    def test_a_sealed_mission_opens_node_by_node_to_who_has_its_start_key_and_looks_where_it_is(self):
        one = built(small(CHEAP).mission(), Profile.SEALED)
        batches = list(crack_sealed(one.mission, one.key, BOX))
        found = [node for batch in batches for node in batch.found]
        assert [node.node for node in found] == [0, 1, 2]
        assert (found[1].x_m, found[1].y_m) == (pytest.approx(4.0, abs=1e-3), pytest.approx(2.17, abs=1e-3))
        elsewhere = (20.0, 20.0, 24.0, 24.0)
        batches = list(crack_sealed(one.mission, one.key, elsewhere))
        assert not [node for batch in batches for node in batch.found]
        assert sum(batch.tries for batch in batches) == batches[-1].of

    def test_the_direction_that_an_open_node_reveals_is_tried_first(self):
        one = built(small(CHEAP).mission(), Profile.SEALED)
        tries = [
            (batch.tries, [node.node for node in batch.found]) for batch in crack_sealed(one.mission, one.key, BOX)
        ]
        after = 0
        for count, found in tries[1 + next(i for i, t in enumerate(tries) if t[1] == [0]) :]:
            after += count
            if found == [1]:
                break
        assert after < 0.2 * 30 * 25 * 12

    def test_the_wrong_gate_gives_nothing_wherever_one_looks(self):
        one = built(small(CHEAP).mission(), Profile.SEALED)
        wrong = replace(one.key, gates={0: replace(one.key.gates[0], share=bytes(32))})
        assert not [node for batch in crack_sealed(one.mission, wrong, BOX) for node in batch.found]

    def test_what_needs_more_than_a_place_is_left_alone(self):
        mission = corridor(3)  # doors with actions
        one = built(mission, Profile.PAPER)
        found = {node.node for batch in crack_paper(one.mission, (-1, -1, 10, 3)) for node in batch.found}
        assert found == {0}


OFFICE = load_floorplan("office_40x40")


def office() -> Mission:
    return replace(read_plain("office"), coding=CHEAP)


def tries_by_plan(mission: Mission, offset_mm: int = 1) -> int:
    """KDFs until all is read."""
    one = built(mission, Profile.SEALED, offset_mm=offset_mm)
    nodes, tries = set(), 0
    for batch in crack_sealed(one.mission, one.key, mission.box_m, plan=candidates_in(OFFICE, offset_mm)):
        tries += batch.tries
        nodes |= {node.node for node in batch.found}
        if len(nodes) == len(mission.nodes):
            return tries
    raise AssertionError(f"{len(nodes)} nodes read")


class TestFloorPlan:
    @pytest.mark.parametrize("offset_mm", [1, 50])
    def test_who_has_it_and_the_start_key_reads_the_office_in_about_a_try_a_node_however_offsets_are_rounded(
        self, offset_mm
    ):
        tries = tries_by_plan(office(), offset_mm)
        assert 33 <= tries <= 38
        report = audit(office(), Profile.SEALED, open_start=True, plan=candidates_in(OFFICE, offset_mm))
        assert sum(row.by_plan for row in report.nodes) == pytest.approx(tries, abs=3)
        assert report.plan_core_s < report.core_s / 1000
        assert audit(office(), Profile.SEALED, open_start=True).plan_core_s is None

    def test_offset_direction_and_apart_each_pick_the_landmark(self):
        """Of the first doorway behind a door, with one of the three at a time: its cell is among the first."""
        node = next(node for node in office().nodes if node.name == "D12")
        (door,) = node.see[0]
        shown, nowhere = candidates_in(OFFICE, 400), Offset()
        before = Before(10.6, 13.5, math.radians(90), 120)
        exact = alias_offset(CHEAP, node.see[0])

        def rank(plan, before, offset):
            shape = shape_of(node.see[0])
            cells = list(plan.cells(CHEAP, before, shape, offset))
            return cells.index(cell_in(CHEAP, shape, offset, door)) + 1, len(cells)

        first, of = rank(shown, before, nowhere)
        assert (first, of > 15) == (1, True), "by the direction"
        assert rank(shown, None, nowhere._replace(apart=exact.apart))[0] <= 3, "by how far its like is"
        assert rank(candidates_in(OFFICE, 1), None, exact._replace(apart=255))[0] <= 3, "by the offset"
        assert rank(shown, None, nowhere)[0] > 3, "by none of them"

    def test_without_the_start_key_it_is_worth_nothing(self):
        report = audit(office(), Profile.SEALED, plan=candidates_in(OFFICE, 1))
        assert report.plan_core_s == math.inf
        assert report.nodes[0].by_plan >= OUT_OF_REACH

    def test_what_it_does_not_show_is_looked_for_everywhere_when_the_rest_is_read(self):
        plain = replace(office(), area_m=(0.0, 0.0, 6.0, 3.0))
        start = replace(plain.nodes[0], see=((Position(5.1, 2.7),),))
        door = replace(plain.nodes[1], start=True)
        mission = replace(plain, nodes=(start, door), ways=())
        one = built(mission, Profile.SEALED)
        batches = crack_sealed(one.mission, one.key, mission.box_m, plan=candidates_in(OFFICE, 1))
        found = [(node.node, batch.tries) for batch in batches for node in batch.found]
        assert [node for node, _ in found] == [1, 0], "what is shown first"
        assert found[0][1] == 1 < found[1][1]


@pytest.mark.parametrize("rounded_mm", [1, 30, 50])
def test_a_rounded_offset_is_a_multiple_within_half_a_cell_and_names_the_same_cell(rounded_mm):
    for x_m in np.linspace(-1.0, 1.0, 401):
        offset = alias_offset(CHEAP, (Position(x_m, 0.3),), rounded_mm)
        assert offset.x % rounded_mm == 0
        assert abs(offset.x) <= CHEAP.delta_mm / 2
        middle_m = middle_of(CHEAP, offset, cell_of(CHEAP, offset, x_m, 0.3))[0]
        assert abs(middle_m - x_m) <= min(rounded_mm, CHEAP.delta_mm / 2) / 1000 + 1e-9


def test_a_mission_with_rounded_offsets_is_walked_to_its_end():
    for profile in BOTH:
        mission = cheap(corridor(), profile)
        walker = walker_of(built(mission, profile, offset_mm=50))
        assert [node for node, *_ in decoded_of(walk(mission, walker))] == list(range(6))
