"""Floor plans in YAML, and the landmarks of them."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from landmark_world import away
from phalanx.config.builtin import built_in
from phalanx.config.lidar import LidarConfig
from phalanx.errors import UsageError
from phalanx.mission.landmarks import extract, floorplan_of_yaml, landmarks_of
from phalanx.mission.landmarks.lidar import Lidar
from phalanx.world.building.floorplan import MAPS, load_floorplan

OFFICE = yaml.safe_load((MAPS / "office_40x40.yaml").read_text())

CONCAVE = ("concave_left", "concave_right")


def plan_of(walls, start=None, **words):
    words |= {"walls": [list(wall) for wall in walls]}
    if start:
        words["start_pose"] = [*start, 0.0]
    return floorplan_of_yaml(yaml.safe_dump(words).encode())


def square(x, y, size):
    return [
        (x, y, x + size, y),
        (x + size, y, x + size, y + size),
        (x + size, y + size, x, y + size),
        (x, y + size, x, y),
    ]


def is_it(seen, alias):
    """Whether a landmark seen without noise is this one."""
    turn = math.remainder(seen.orientation_rad - alias.orientation_rad, math.tau)
    return seen.type == alias.type and away(seen, alias.x_m, alias.y_m) < 0.1 and abs(turn) < 0.1


class TestTheOffice:
    def sites(self, kind):
        return [site for site in landmarks_of(load_floorplan("office_40x40")) if site.type == kind]

    def test_its_doorways_are_those_of_whoever_drew_it(self):
        sites = self.sites("doorway")
        assert len(sites) == len(OFFICE["doors"])
        for door in OFFICE["doors"]:
            (ax, ay), (bx, by) = door["jambs"]
            (site,) = [site for site in sites if away(site.aliases[0], (ax + bx) / 2, (ay + by) / 2) < 1e-6]
            assert site.width_m == pytest.approx(door["width"])
            direction = math.atan2(by - ay, bx - ax) % math.pi
            assert site.aliases[0].orientation_rad == pytest.approx(direction, abs=1e-6)

    def test_each_of_its_rooms_is_one_landmark_with_all_triples_of_corners(self):
        sites = self.sites("room")
        for name, (x0, y0, x1, y1) in OFFICE["rooms"].items():
            inside = [
                site for site in sites if all(x0 <= alias.x_m <= x1 and y0 <= alias.y_m <= y1 for alias in site.aliases)
            ]
            assert len(inside) == 1, name
        # One more: the lobby has three corners in a row, too.
        assert len(sites) == len(OFFICE["rooms"]) + 1
        rectangle = next(site for site in sites if len(site.aliases) == 2)
        assert rectangle.aliases[0].area_m2 == pytest.approx(rectangle.aliases[1].area_m2)

    def test_its_named_corners_are_landmarks_with_the_normals_of_both_walls(self):
        sites = [site for site in landmarks_of(load_floorplan("office_40x40")) if site.type in CONCAVE]
        for corner in OFFICE["corners"]:
            (site,) = [site for site in sites if away(site.aliases[0], *corner["xy"]) < 1e-6]
            normals = [alias.orientation_rad for alias in site.aliases]
            assert abs(math.remainder(normals[0] - normals[1], math.tau)) == pytest.approx(math.pi / 2)

    def test_no_landmark_can_only_be_seen_from_outside(self):
        plan = load_floorplan("office_40x40")
        for site in landmarks_of(plan):
            alias = site.aliases[0]
            if site.type.startswith(("corner", "concave")):
                x, y = (
                    alias.x_m + 0.2 * math.cos(alias.orientation_rad),
                    alias.y_m + 0.2 * math.sin(alias.orientation_rad),
                )
                assert plan.inside(x, y)

    def test_islands_and_closets_are_not_inside(self):
        plan = load_floorplan("office_40x40")
        assert plan.inside(3, 1.5)
        assert plan.inside(20, 15)
        for x, y in ((20, 19.5), (12, 38), (38, 1), (-1, 5), (41, 5)):
            assert not plan.inside(x, y)


class TestWalls:
    def test_a_free_wall_has_two_ends_that_are_seen_from_both_sides(self):
        sites = landmarks_of(plan_of([*square(0, 0, 8), (3, 4, 5, 4)], (1, 1)))
        ends = [site for site in sites if site.type in CONCAVE]
        assert {(site.aliases[0].x_m, site.aliases[0].y_m) for site in ends} == {(3, 4), (5, 4)}
        for site in ends:
            assert sorted(math.sin(alias.orientation_rad) for alias in site.aliases) == pytest.approx([-1, 1])
            # Who stands south of it, and looks at its southern face, has its western end on the left.
            hands = {round(math.sin(alias.orientation_rad)): alias.type for alias in site.aliases}
            west = site.aliases[0].x_m == 3
            assert hands == {-1: CONCAVE[not west], 1: CONCAVE[west]}

    def test_all_corners_of_an_island_have_a_hand_for_each_wall_as_a_lidar_sees_them(self):
        plan = plan_of([*square(0, 0, 12), *square(5, 5, 2)], (1, 1))
        corners = [site for site in landmarks_of(plan) if site.type in CONCAVE]
        lidar, chance = Lidar(plan.walls, LidarConfig(noise_m=0.0, drop_out=0.0)), np.random.default_rng(0)
        found = set()
        for turn in np.arange(8) * math.pi / 4 + 0.2:
            pose = (6 + 4 * math.cos(turn), 6 + 4 * math.sin(turn), turn + math.pi)
            for seen in extract(lidar.sweep(pose, chance)).landmarks(*pose):
                if seen.type in CONCAVE:
                    (alias,) = [alias for site in corners for alias in site.aliases if is_it(seen, alias)]
                    found.add(alias)
        assert found == {alias for site in corners for alias in site.aliases}
        assert Counter(alias.type for alias in found) == {"concave_left": 4, "concave_right": 4}

    def test_walls_that_cross_or_touch_make_corners(self):
        sites = landmarks_of(plan_of([*square(0, 0, 8), (4, 0, 4, 8), (4, 4, 8, 4.001)], (1, 1)))
        assert Counter(site.type for site in sites) == {"corner_convex": 4, "room": 1}

    def test_a_wall_is_the_same_whichever_way_it_is_drawn_and_in_how_many_pieces(self):
        whole = landmarks_of(plan_of(square(0, 0, 8), (1, 1)))
        pieces = [(8, 0, 0, 0), (8, 8, 8, 5), (8, 0, 8, 6), (8, 8, 0, 8), (0, 0, 0, 8)]
        assert Counter(map(repr, whole)) == Counter(map(repr, landmarks_of(plan_of(pieces, (1, 1)))))

    def test_a_room_that_nobody_comes_to_has_no_landmarks(self):
        sites = landmarks_of(plan_of([*square(0, 0, 8), *square(10, 0, 8)], (1, 1)))
        assert all(alias.x_m <= 8 for site in sites for alias in site.aliases)

    def test_a_building_around_an_island_around_a_robot(self):
        inner = landmarks_of(plan_of([*square(0, 0, 20), *square(5, 5, 6)], (6, 6)))
        assert Counter(site.type for site in inner) == {"corner_convex": 4, "room": 1}
        outer = landmarks_of(plan_of([*square(0, 0, 20), *square(5, 5, 6)], (1, 1)))
        assert Counter(site.type for site in outer) == {"corner_convex": 4, "concave_left": 4, "room": 1}

    @pytest.mark.parametrize(("thick", "depth"), [(0.3, 0.15), (0.5, 0.25)])
    def test_the_doorway_of_a_thick_wall_is_one_in_the_middle(self, thick, depth):
        left, right = 4.0, 4.0 + thick
        walls = [
            *[(0, 0, left, 0), (left, 0, left, 3), (left, 3, right, 3), (right, 3, right, 0), (right, 0, 9, 0)],
            *[(9, 0, 9, 8), (9, 8, right, 8), (right, 8, right, 5), (right, 5, left, 5), (left, 5, left, 8)],
            *[(left, 8, 0, 8), (0, 8, 0, 0)],
        ]
        (door,) = [site for site in landmarks_of(plan_of(walls, (1, 1))) if site.type == "doorway"]
        assert away(door.aliases[0], 4 + depth, 4) < 1e-6

    def test_a_plan_without_walls_has_no_landmarks(self):
        plan = plan_of([], (1, 1), size=[5.0, 5.0])
        assert landmarks_of(plan) == ()
        assert plan.clearance_m(2, 2) == math.inf
        assert plan.inside(2, 2)
        assert plan.sees((0, 0), (5, 5))

    def test_codes_are_landmarks_where_they_hang(self):
        plan = plan_of(square(0, 0, 5), (1, 1), codes=[{"text": "a", "at": [0.0, 2.0, 0.3], "facing": 0.0}])
        (site,) = [site for site in landmarks_of(plan) if site.type == "qr"]
        assert (site.aliases[0].text, site.aliases[0].x_m, site.aliases[0].orientation_rad) == ("a", 0.0, 0.0)


class TestFiles:
    @pytest.mark.parametrize(
        ("text", "said"),
        [
            ("walls: [[0, 0, 1]]", "wall 1"),
            ("walls: [[0, 0, 1, a]]", "wall 1"),
            ("walls: [[0, 0, 1, .nan]]", "wall 1"),
            ("walls: [[1, 1, 1, 1]]", "no length"),
            ("walls: 3", "not a list"),
            ("{}", "neither walls nor a size"),
            ("[1, 2]", "not a map"),
            ("a: [", "not YAML"),
            ("walls: [[0, 0, 1, 1]]\nstart_pose: here", "start_pose"),
            ("walls: [[0, 0, 1, 1]]\ncodes: [{at: [1, 2, 3]}]", "code 1"),
            ("walls: [[0, 0, 1, 1]]\ncodes: [{text: a, at: [1, 2, 3], facing: 0, edge: 9}]", "code 1"),
            ("walls: [[0, 0, 1, 1]]\ncodes: [{text: '', at: [1, 2, 3], facing: 0}]", "a text of 0 bytes"),
            (f"walls: [[0, 0, 1, 1]]\ncodes: [{{text: {'a' * 901}, at: [1, 2, 3], facing: 0}}]", "of 901 bytes"),
            ("walls: [" + "[0, 0, 1, 1]," * 2001 + "]", "2001 walls"),
        ],
    )
    def test_what_is_wrong_with_a_file_is_said(self, text, said):
        with pytest.raises(UsageError, match=said):
            floorplan_of_yaml(text.encode())

    @given(st.binary(max_size=300))
    def test_garbage_is_a_usage_error(self, data):
        with pytest.raises(UsageError):
            floorplan_of_yaml(data)

    @given(st.recursive(st.none() | st.floats() | st.text(max_size=5), lambda x: st.lists(x, max_size=4) | st.dictionaries(st.sampled_from(["walls", "codes", "size", "origin", "start_pose", "text", "at"]), x, max_size=4)))  # fmt: skip
    def test_any_yaml_is_a_plan_or_a_usage_error(self, words):
        try:
            floorplan_of_yaml(yaml.safe_dump(words).encode())
        except UsageError:
            pass

    def test_the_built_in_maps_load_and_have_landmarks(self):
        assert {"office_40x40", "office_30x25"} <= set(built_in("maps"))
        for name in built_in("maps"):
            assert landmarks_of(load_floorplan(name))

    def test_a_map_that_is_not_there_is_said(self, tmp_path):
        with pytest.raises(UsageError, match="office_40x4") as caught:
            load_floorplan("office_40x4")
        assert "office_40x40" in caught.value.hint
        with pytest.raises(UsageError, match="no file"):
            load_floorplan(tmp_path / "no.yaml")

    def test_the_codes_of_the_camera_office_hang_on_walls_and_face_free_space(self):
        plan = load_floorplan("office_30x25")
        assert len({code.text for code in plan.codes}) == 23
        for code in plan.codes:
            assert plan.clearance_m(code.x_m, code.y_m) < 0.01
            x, y = code.x_m + 0.5 * math.cos(code.facing_rad), code.y_m + 0.5 * math.sin(code.facing_rad)
            assert plan.inside(x, y)
            assert plan.clearance_m(x, y) > 0.4
