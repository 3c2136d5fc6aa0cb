"""Bodies: where they go, whom they are near, what they touch."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.errors import UsageError
from phalanx.world.audited.body import accelerate, accelerated, obstacle_contacts, robot_contacts
from phalanx.world.radio.reach import in_range, make_reach, rebuild

NO_DISCS, NO_BOXES = np.zeros((0, 3)), np.zeros((0, 4))
# Narrow and wide crowds, negative coordinates, places that many share.
places = st.one_of(st.integers(-6, 6).map(float), st.floats(-1e5, 1e5))
crowds = st.lists(st.tuples(places, places), min_size=1, max_size=60)


def near(pos, reach):
    return [reach.ids[reach.near[i] : in_range(reach, i)].tolist() for i in range(len(pos))]


def contacts(path, contact_m=1.0):
    """Pairs counted at each look along a path of positions."""
    counted, last = [], np.full_like(path[0], np.nan)
    reach = make_reach(len(path[0]), 100.0)
    for pos in path:
        rebuild(reach, pos)
        counted.append(robot_contacts(pos, last, reach, contact_m))
        last = pos
    return counted


class TestMotion:
    def test_a_robot_under_constant_acceleration_follows_its_parabola_however_often_it_is_asked(self):
        for looks in ([10_000_000], [1, 333_333, 2_000_000, 9_999_999, 10_000_000]):
            pos, vel, acc = np.array([[1.0, 2.0]]), np.array([[3.0, -4.0]]), np.zeros((1, 2))
            at_us = np.zeros(1, np.int64)
            accelerate(acc, 0, 0.5, -0.25, 5.0)
            for now_us in looks:
                accelerated(pos, vel, acc, at_us, 0, now_us)
            assert pos[0] == pytest.approx([1 + 30 + 25, 2 - 40 - 12.5], abs=1e-9)
            assert vel[0] == pytest.approx([8, -6.5], abs=1e-9)
            assert at_us[0] == 10_000_000

    @pytest.mark.parametrize(
        "asked, done",
        [(4.9, 4.9), (5.1, 5.0), (-7.0, -5.0), (math.inf, 5.0), (-math.inf, -5.0), (math.nan, 0.0)],
    )
    def test_an_acceleration_is_clipped_on_each_axis_and_nonsense_is_none(self, asked, done):
        acc = np.full((2, 2), 9.0)
        accelerate(acc, 1, asked, 1.0, 5.0)
        assert acc.tolist() == [[9.0, 9.0], [done, 1.0]]


class TestReach:
    @given(crowds, st.sampled_from([0.5, 1.0, 116.33, 5e4]))
    @settings(max_examples=60, deadline=None)
    def test_lists_are_those_of_all_pairs(self, points, range_m):
        pos = np.array(points)
        reach = make_reach(len(pos), range_m)
        total = rebuild(reach, pos)
        gaps = ((pos[:, None] - pos[None]) ** 2).sum(axis=2)
        expected = [[k for k in range(len(pos)) if k != i and gaps[i, k] <= range_m**2] for i in range(len(pos))]
        assert near(pos, reach) == expected
        assert sum(map(len, expected)) <= total <= len(reach.candidate_ids)
        for i in range(len(pos)):
            row = slice(reach.near[i], in_range(reach, i))
            assert reach.square[row] == pytest.approx(gaps[i, reach.ids[row]], rel=1e-6)

    @given(
        crowds,
        st.lists(st.tuples(st.floats(0.0, 0.3), st.integers(0, 2**32)), max_size=6),
        st.sampled_from([0.0, 0.25]),
    )
    @settings(max_examples=60, deadline=None)
    def test_lists_that_follow_robots_are_those_made_anew(self, points, steps, skin):
        pos = np.array(points)
        reach = make_reach(len(pos), 1.0, skin=skin)
        for share, seed in [(0.0, 0), *steps]:
            chance = np.random.default_rng(seed)
            pos = pos * chance.choice([0.7, 0.9, 1.0, 1.0, 1.0, 1.1, 1.4])
            pos = pos + share * chance.uniform(-1.0, 1.0, pos.shape) + chance.integers(-2, 3, 2)
            anew = make_reach(len(pos), 1.0)
            assert max(rebuild(reach, pos), rebuild(anew, pos)) <= len(reach.candidate_ids)
            assert near(pos, reach) == near(pos, anew)

    def test_who_all_go_the_same_way_or_to_the_same_place_are_not_sorted_anew(self):
        pos = np.random.default_rng(1).uniform(0.0, 5.0, (40, 2))
        reach = make_reach(40, 1.0)
        rebuild(reach, pos)
        for goal, share in (
            (np.array([30.0, -20.0]), 0.0),
            (np.array([3.0, 2.0]), 0.15),
            (np.array([900.0, 0.0]), 0.15),
        ):
            rebuild(reach, pos + goal - share * (pos - goal))
            assert np.array_equal(reach.sorted_at, pos)
        away = pos.copy()
        away[7] += 0.2
        rebuild(reach, away)
        assert np.array_equal(reach.sorted_at, away)

    def test_a_crowd_whose_candidates_find_no_room_is_listed_all_the_same(self):
        # In pairs that see each other only; within the skin of each are a dozen.
        x, y = np.meshgrid(0.6 * np.arange(8), 0.6 * np.arange(5))
        pos = np.concatenate(
            [np.stack([x.ravel(), y.ravel()], axis=1), np.stack([x.ravel() + 0.05, y.ravel()], axis=1)]
        )
        reach, roomy = make_reach(80, 0.5, capacity=80, skin=1.0), make_reach(80, 0.5)
        assert rebuild(roomy, pos) > 80
        assert rebuild(make_reach(80, 0.5, skin=1.0), pos) > len(reach.candidate_ids)
        assert rebuild(reach, pos) == 80
        assert near(pos, reach) == near(pos, roomy)

    def test_lists_without_room_are_cut_and_say_how_much_they_need(self):
        pos = np.zeros((10, 2))
        reach = make_reach(10, 1.0, capacity=30)
        assert rebuild(reach, pos) == 90 > len(reach.candidate_ids)
        assert sum(map(len, near(pos, reach))) == len(reach.candidate_ids)
        roomy = make_reach(10, 1.0, capacity=90)
        assert rebuild(roomy, pos) == 90
        assert near(pos, roomy) == [[k for k in range(10) if k != i] for i in range(10)]

    @pytest.mark.parametrize("bad", [(0, 1.0), (1, 0.0), (1, math.nan), (1, math.inf)])
    def test_a_reach_of_nothing_cannot_be_made(self, bad):
        with pytest.raises(UsageError) as caught:
            make_reach(*bad)
        assert caught.value.hint


class TestContacts:
    def test_a_pair_counts_once_until_it_parts_and_meets_again(self):
        gaps = [3.0, 0.9, 0.5, 0.9, 1.1, 0.9]
        assert contacts([np.array([[0.0, 0.0], [gap, 0.0]]) for gap in gaps]) == [0, 1, 0, 0, 0, 1]

    def test_two_that_pass_each_other_between_looks_have_touched_if_their_paths_were_near(self):
        def passing(apart):
            return [np.array([[0.0, 0.0], [apart, y]]) for y in (-5.0, 5.0)]

        assert contacts(passing(0.9)) == [0, 1]
        assert contacts(passing(1.1)) == [0, 0]

    def test_those_who_begin_in_contact_count_once_each_pair(self):
        assert contacts([np.zeros((4, 2))] * 3) == [6, 0, 0]

    @pytest.mark.parametrize(
        "discs, boxes",
        [
            (np.array([[10.0, 0.0, 2.0]]), NO_BOXES),
            (NO_DISCS, np.array([[8.0, -1.0, 12.0, 1.0]])),
        ],
    )
    def test_an_obstacle_is_touched_half_a_contact_from_its_edge(self, discs, boxes):
        last, counted = np.full((1, 2), np.nan), []
        for x in (7.4, 7.6, 9.0, 12.4, 12.6, 12.4):
            pos = np.array([[x, 0.0]])
            counted.append(obstacle_contacts(pos, last, discs, boxes, 1.0))
            last = pos
        assert counted == [0, 1, 0, 0, 0, 1]

    def test_the_corner_of_a_box_is_round_to_a_round_robot(self):
        box, nowhere = np.array([[0.0, 0.0, 1.0, 1.0]]), np.full((1, 2), np.nan)
        assert obstacle_contacts(np.array([[1.3, 1.3]]), nowhere, NO_DISCS, box, 1.0) == 1
        assert obstacle_contacts(np.array([[1.4, 1.4]]), nowhere, NO_DISCS, box, 1.0) == 0
