"""Maps of ROS's map_server: pictures that others made become floor plans with landmarks."""

from __future__ import annotations

import gzip
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from landmark_world import away
from phalanx.config.lidar import ExtractionConfig
from phalanx.errors import UsageError
from phalanx.mission.authoring.survey import survey
from phalanx.mission.landmarks import extract, floorplan_of_map, landmarks_of
from phalanx.mission.landmarks.gridmap import FREE, WALL, read_pgm, without_dust
from phalanx.mission.landmarks.lidar import Lidar
from phalanx.mission.worth.feasible import look_ahead
from phalanx.world.building.floorplan import MAPS, load_floorplan
from phalanx.world.building.walkers import free_place

OTHERS = Path(__file__).parent.parent / "data" / "maps"
ROS_MAPS = [MAPS / "aws_small_house.yaml", MAPS / "nav2_depot.yaml", *sorted(OTHERS.glob("*.yaml"))]
YAML = (
    b"image: x.pgm\nresolution: 0.05\norigin: [-1.0, -2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
)


def pgm(cells, kind=5):
    """A picture of cells, the first row at the bottom."""
    height, width = cells.shape
    if kind == 2:
        return f"P2\n# by hand\n{width} {height}\n255\n".encode() + b" ".join(b"%d" % v for v in cells[::-1].ravel())
    return b"P5\n%d %d\n255\n" % (width, height) + cells[::-1].astype(np.uint8).tobytes()


def drawn(plan, resolution_m=0.05, turn=0.0):
    """A floor plan's walls, two cells thick, as a picture and its YAML file; turned about the origin."""
    margin = 1.0
    cosine, sine = math.cos(turn), math.sin(turn)
    walls = plan.walls.reshape(-1, 2) @ np.array([[cosine, sine], [-sine, cosine]])
    low = walls.min(0) - margin
    width, height = np.ceil((walls.max(0) + margin - low) / resolution_m).astype(int)
    cells = np.full((height, width), 254)
    for (ax, ay), (bx, by) in walls.reshape(-1, 2, 2):
        count = int(math.hypot(bx - ax, by - ay) / resolution_m * 4) + 2
        x, y = np.linspace(ax, bx, count) - low[0], np.linspace(ay, by, count) - low[1]
        for dx in (-0.5, 0.5):
            for dy in (-0.5, 0.5):
                cells[np.floor(y / resolution_m + dy).astype(int), np.floor(x / resolution_m + dx).astype(int)] = 0
    words = f"image: x.pgm\nresolution: {resolution_m}\norigin: [{low[0]}, {low[1]}, 0.0]\n"
    return words.encode(), pgm(cells)


class TestMapsOfOthers:
    @pytest.mark.parametrize("path", ROS_MAPS, ids=lambda path: path.stem)
    def test_every_map_loads_and_has_landmarks(self, path):
        plan = load_floorplan(path)
        sites = landmarks_of(plan, ExtractionConfig(door_min_m=0.8))
        assert len(sites) >= 20
        assert np.isfinite(plan.walls).all()
        x0, y0, x1, y1 = plan.bounds
        for site in sites:
            for alias in site.aliases:
                assert x0 <= alias.x_m <= x1
                assert y0 <= alias.y_m <= y1

    @pytest.mark.parametrize(("name", "share"), [("aws_small_house", 0.6), ("nav2_depot", 0.35)])
    def test_a_robot_in_such_a_map_sees_the_landmarks_that_were_taken_from_it(self, name, share):
        """Convex corners, the plainest: of those that single scans show, so many are landmarks of the map."""
        plan = load_floorplan(name)
        known = [site.aliases[0] for site in landmarks_of(plan) if site.type == "corner_convex"]
        random, lidar, hits, count = np.random.default_rng(3), Lidar(plan.walls), 0, 0
        for _ in range(60):
            pose = (*free_place(plan, 0.3, random), random.uniform(-math.pi, math.pi))
            for landmark in extract(lidar.sweep(pose, random)).landmarks(*pose):
                if landmark.type == "corner_convex":
                    count += 1
                    hits += any(away(landmark, other.x_m, other.y_m) < 0.15 for other in known)
        assert count > 15
        assert hits > share * count

    def test_the_house_has_its_size(self):
        plan = load_floorplan("aws_small_house")
        largest = max(outline.area_m2 for outline in plan.outlines)
        assert 100 < largest < 200
        assert plan.inside(0, 2)
        assert not plan.inside(-7, 2)  # the bed
        assert not plan.inside(11, 0)


class TestDrawnMaps:
    @pytest.mark.parametrize(("turn_deg", "missing"), [(0, 0), (10, 0), (20, 0), (30, 3), (45, 0)])
    def test_the_office_as_a_picture_has_its_doorways_where_they_are(self, turn_deg, missing):
        """Two cells thick and at an angle, the end of a wall can be too ragged for a jamb."""
        office = load_floorplan("office_40x40")
        turn = math.radians(turn_deg)
        plan = floorplan_of_map(*drawn(office, turn=turn), "drawn")
        found = [
            site.aliases[0] for site in landmarks_of(plan, ExtractionConfig(door_min_m=1.0)) if site.type == "doorway"
        ]
        doors = [site.aliases[0] for site in landmarks_of(office) if site.type == "doorway"]
        cosine, sine = math.cos(turn), math.sin(turn)
        missed = 0
        for door in doors:
            x, y = cosine * door.x_m - sine * door.y_m, sine * door.x_m + cosine * door.y_m
            near = [other for other in found if away(other, x, y) < 0.12]
            missed += not near
            for other in near:
                apart = (other.orientation_rad - door.orientation_rad - turn + math.pi / 2) % math.pi - math.pi / 2
                assert abs(apart) < math.radians(7.5)
        assert missed == missing
        assert len(found) == len(doors) - missing

    def test_a_box_is_measured_to_a_tenth_of_a_cell(self):
        cells = np.full((100, 120), 254)
        cells[20:60, 30:90] = 0
        cells[22:58, 32:88] = 205
        plan = floorplan_of_map(YAML, pgm(cells), "box")
        corners = {
            (round(site.aliases[0].x_m, 2), round(site.aliases[0].y_m, 2))
            for site in landmarks_of(plan)
            if site.type in ("concave_left", "concave_right")
        }
        assert corners == {(0.5, -1.0), (3.5, -1.0), (3.5, 1.0), (0.5, 1.0)}

    def test_text_and_binary_pictures_are_the_same(self):
        cells = np.full((40, 50), 254)
        cells[10:20, 10:30] = 0
        first, second = (floorplan_of_map(YAML, pgm(cells, kind), "box") for kind in (2, 5))
        assert np.array_equal(first.walls, second.walls)

    def test_negate_turns_dark_and_bright(self):
        cells = np.full((40, 50), 254)
        cells[10:20, 10:30] = 0
        turned = floorplan_of_map(YAML.replace(b"negate: 0", b"negate: 1"), pgm(255 - cells), "box")
        assert np.allclose(turned.walls, floorplan_of_map(YAML, pgm(cells), "box").walls)

    @pytest.mark.parametrize("grey", [0, 205, 254])
    def test_a_map_of_one_kind_only_has_no_landmarks_but_its_borders(self, grey):
        plan = floorplan_of_map(YAML, pgm(np.full((30, 30), grey)), "plain")
        assert landmarks_of(plan) == ()

    @given(st.integers(1, 12), st.integers(1, 12), st.data())
    @settings(max_examples=60, deadline=None)
    def test_any_picture_gives_closed_outlines(self, width, height, data):
        cells = np.array(
            data.draw(st.lists(st.sampled_from([0, 205, 254]), min_size=width * height, max_size=width * height))
        )
        plan = floorplan_of_map(YAML, pgm(cells.reshape(height, width)), "noise")
        assert np.isfinite(plan.walls).all()
        landmarks_of(plan)


class TestFiles:
    @given(st.binary(max_size=200))
    def test_garbage_is_a_usage_error(self, data):
        with pytest.raises(UsageError):
            read_pgm(data, "x")

    @pytest.mark.parametrize(
        "data",
        [
            b"P5\n10 10\n255\n" + b"\0" * 99,
            b"P5\n0 10\n255\n",
            b"P5\n999999 999999\n255\n\0",
            b"P5\n2 1\n0\n\0\0",
            b"P2\n2 1\n255\n1 x",
            b"P2\n2 1\n255\n1 99999999999999999999999",
            b"P2\n2 1\n255\n1 300",
            b"P6\n1 1\n255\n\0\0\0",
        ],
    )
    def test_a_broken_picture_is_refused(self, data):
        with pytest.raises(UsageError):
            read_pgm(data, "x")

    def test_sixteen_bit_pictures_are_read(self):
        assert read_pgm(b"P5 2 1 65535\n\xff\xff\x00\x00", "x").tolist() == [[255, 0]]

    @pytest.mark.parametrize(
        "words",
        [
            b"resolution: 0.05",
            b"image: x.pgm",
            b"image: x.pgm\nresolution: 0",
            b"image: x\nresolution: 1\noccupied_thresh: 0.1",
        ],
    )
    def test_a_broken_yaml_file_is_refused(self, words):
        with pytest.raises(UsageError):
            floorplan_of_map(words, pgm(np.full((3, 3), 254)), "x")

    def test_a_picture_that_is_missing_or_no_gzip_is_said(self, tmp_path):
        (tmp_path / "a.yaml").write_bytes(YAML)
        with pytest.raises(UsageError, match=r"x\.pgm"):
            load_floorplan(tmp_path / "a.yaml")
        (tmp_path / "x.pgm.gz").write_bytes(gzip.compress(pgm(np.full((9, 9), 254)))[:-4])
        with pytest.raises(UsageError, match=r"x\.pgm\.gz"):
            load_floorplan(tmp_path / "a.yaml")


class TestDust:
    """Lone cells of a map: dust of SLAM, or the leg of a chair."""

    @staticmethod
    def swept(*marks, edge_m=0.05):
        """(cells that are left of those marked in a room of 4 x 2 m; how many were swept)."""
        cells = np.full((round(2 / edge_m), round(4 / edge_m)), FREE, np.uint8)
        for row, column in marks:
            cells[row, column] = WALL
        cells = np.pad(cells, 1, constant_values=WALL)
        left, count = without_dust(cells, edge_m)
        return {(row, column) for row, column in marks if left[row + 1, column + 1] != FREE}, count

    @pytest.mark.parametrize(
        ("marks", "left"),
        [
            ([(20, 40)], set()),
            ([(20, 40), (20, 41)], {(20, 40), (20, 41)}),  # a thing of two cells
            ([(20, 40), (21, 41)], {(20, 40), (21, 41)}),  # they touch
            ([(20, 38), (20, 46)], set()),  # nobody gets between them, and anybody around
            ([(2, 40)], set()),  # beside a wall
            # A chair's legs, and a row of posts across the room: a robot may be on either side, and gets not through.
            ([(16, 36), (16, 44), (24, 36), (24, 44)], {(16, 36), (16, 44), (24, 36), (24, 44)}),
            ([(row, 40) for row in range(4, 40, 8)], {(row, 40) for row in range(4, 40, 8)}),
        ],
    )
    def test_a_lone_cell_is_swept_if_a_robot_gets_around_it(self, marks, left):
        assert self.swept(*marks) == (left, len(marks) - len(left))

    def test_cells_of_a_coarse_map_are_things(self):
        assert self.swept((5, 10), edge_m=0.2) == ({(5, 10)}, 0)

    def test_a_dusty_map_is_surveyed_with_what_is_seen_where_the_dust_stands_and_says_how_much_there_is(self):
        """Both rooms were kept once: where robots met the dust they never saw either, and ran out of time."""
        cells = np.full((160, 240), 254)
        cells[:4], cells[-4:], cells[:, :4], cells[:, -4:] = 0, 0, 0, 0
        cells[:70, 118:122], cells[100:, 118:122] = 0, 0
        start = b"start_pose: [2.0, 2.0, 0.0]\n"
        clean = floorplan_of_map(YAML + start, pgm(cells), "clean", swept=True)
        specks = np.random.default_rng(1).random(cells.shape) < 0.0005
        dusty = np.where(specks, 0, cells)
        asked = [floorplan_of_map(YAML + start, pgm(dusty), "dusty", swept=swept) for swept in (False, True)]
        assert [plan.dust > 15 for plan in (clean, *asked)] == [False, False, True]
        assert len(asked[0].walls) >= len(asked[1].walls) + 2 * asked[1].dust, "each is a line there and back"
        assert np.array_equal(asked[1].drawn, asked[0].walls)
        swept = replace(asked[1], drawn=None)
        assert [len(survey(plan).nodes) for plan in (clean, swept, asked[1])] == [4, 4, 2]
        assert look_ahead(survey(clean), None, asked[1]).infeasible.keys() == {"room1", "room2"}
