"""Missions made from maps that do not say where robots begin; and pictures, digests and empty files of missions."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st

from phalanx.cli.commands.mission import mission as group
from phalanx.cli.mission.draw import simulate_parts
from phalanx.cli.mission.files import read_encoded, read_plain, read_start_key
from phalanx.errors import UsageError
from phalanx.lab.figures.missions import draw_mission
from phalanx.mission import Landmark, Profile
from phalanx.mission.authoring.free import STAND_M, Free
from phalanx.mission.authoring.survey import START, _reached, _without, most_spacious_start, survey, with_start
from phalanx.mission.landmarks import FloorPlan, floorplan_of_yaml
from phalanx.mission.refused import MalformedMission
from phalanx.mission.worth.audit import audit
from phalanx.mission.worth.feasible import look_ahead
from phalanx.world.building.floorplan import MAPS, load_floorplan
from phalanx.world.missions.report import Report, summary
from phalanx.world.missions.setup import MissionRun, Part

OTHERS = Path(__file__).parent.parent / "data" / "maps"
ROS = [MAPS / "nav2_depot.yaml", MAPS / "aws_small_house.yaml", *sorted(OTHERS.glob("*.yaml"))]
TB3 = OTHERS / "tb3_world.yaml"
# Two rooms without a door between them.
ROOMS = b"walls: [[0,0,9,0],[9,0,9,4],[9,4,0,4],[0,4,0,0],[3,0,3,4]]\n"
# So long that its one landmark, its middle, is in nobody's sight at the ends.
HALL = b"walls: [[0,0,60,0],[60,0,60,4],[60,4,0,4],[0,4,0,0]]\n"


# A corridor around a block of 18 m: from the start, the middle of a side, no corner's end is in sight of the other's.
RING = (
    b"size: [23, 23]\nstart_pose: [11.5, 1.25, 0]\nwalls: [[0,0,23,0],[23,0,23,23],[23,23,0,23],[0,23,0,0],"
    b"[2.5,2.5,20.5,2.5],[20.5,2.5,20.5,20.5],[20.5,20.5,2.5,20.5],[2.5,20.5,2.5,2.5]]\n"
)
# A shelf, 0.1 m from the wall behind it.
SHELF = (
    b"size: [10, 8]\nstart_pose: [2, 4, 0]\nwalls: [[0,0,10,0],[10,0,10,8],[10,8,0,8],[0,8,0,0],"
    b"[4,0.1,4.4,0.1],[4.4,0.1,4.4,1.6],[4.4,1.6,4,1.6],[4,1.6,4,0.1]]\n"
)


# A door in a wall whose sides show it 0.12 m apart, as walls of maps that robots drew often do.
RAGGED = (
    b"size: [12, 6]\nstart_pose: [2, 3, 0]\nwalls: [[0,0,12,0],[12,0,12,6],[12,6,0,6],[0,6,0,0],[6,0,6,3],[6,3,6.2,3.12],"
    b"[6.2,3.12,6.2,0],[6,6,6,4.4],[6,4.4,6.2,4.52],[6.2,4.52,6.2,6]]\n"
)


def corridor(long_m: float, wide_m: float = 3.0) -> FloorPlan:
    """Two rooms with a door each, at both ends of a bare corridor."""
    a, b = 6.0, 6.0 + long_m
    walls = [[0, 0, a, 0], [a, 6, 0, 6], [0, 6, 0, 0], [a, 0, a, 2.3], [a, 3.7, a, 6]]
    walls += [[b, 0, b + 6, 0], [b + 6, 0, b + 6, 6], [b + 6, 6, b, 6], [b, 0, b, 2.3], [b, 3.7, b, 6]]
    walls += [[a, 3 + side, b, 3 + side] for side in (-wide_m / 2, wide_m / 2)]
    return floorplan_of_yaml(f"size: [{b + 6}, 6]\nstart_pose: [3, 3, 0]\nwalls: {walls}\n".encode())


def command(*words: object) -> Result:
    return CliRunner().invoke(group, [str(word) for word in words], standalone_mode=False)


def refused(*words: object) -> str:
    error = command(*words).exception
    assert isinstance(error, UsageError), error
    return str(error)


def test_behind_a_shelf_where_no_robot_gets_through_no_way_leads_from_one_end_to_the_other() -> None:
    mission = survey(floorplan_of_yaml(SHELF))
    left, right = sorted(node.name for node in mission.nodes if node.place and node.place[1] < 0.2)
    ways = {(way.source, way.target) for way in mission.ways}
    assert (left, right) not in ways
    assert {(START, left), (START, right)} & ways, "to the end that is in sight of the start one does"


@pytest.mark.parametrize(
    ("long_m", "wide_m", "is_kept"), [(12, 3, True), (22, 3, True), (22, 2, False), (30, 3, False)]
)
def test_at_the_far_end_of_a_bare_corridor_stands_what_a_robot_can_be_expected_to_know_there(
    long_m: float, wide_m: float, is_kept: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Of the narrow one's door scans show nothing on the way, and the longest is longer than a direction is followed."""
    plan = corridor(long_m, wide_m)
    mission = survey(plan)
    beyond = [node.name for node in mission.nodes if node.place and node.place[0] > 6 + long_m / 2]
    assert bool(beyond) == is_kept
    assert look_ahead(mission, None, plan).completes(mission)
    assert ("left out" in caplog.text) is not is_kept


@pytest.mark.parametrize(("gap_m", "leads"), [(0.44, False), (0.6, True)])
def test_ways_do_not_lead_through_gaps_that_a_pilot_may_not_find_its_way_through(gap_m: float, leads: bool) -> None:
    """In willow-full a robot stood before such a gap, between legs of chairs, until its time was over."""
    low, high = 3 - gap_m / 2, 3 + gap_m / 2
    walls = f"[[0,0,12,0],[12,0,12,6],[12,6,0,6],[0,6,0,0],[6,0,6,{low}],[6,{high},6,6],[9,2,10,2]]"
    mission = survey(floorplan_of_yaml(f"size: [12, 6]\nstart_pose: [2, 3, 0]\nwalls: {walls}\n".encode()))
    assert any(node.place and node.place[0] > 6.5 for node in mission.nodes) == leads


def test_no_way_is_driven_straight_through_a_thin_wall_that_stands_askew() -> None:
    """Places on both sides of one may be nearer to each other than the middles of their cells."""
    walls = "[[0,0,8,0],[8,0,8,6],[8,6,0,6],[0,6,0,0],[3.5,1.5,5.5,6]]"
    free = Free(floorplan_of_yaml(f"walls: {walls}\n".encode()), [(2, 1)])
    assert free.side_of((1.3, 3.9), (7.5, 3.9)) is None
    assert free.side_of((1.3, 0.9), (7.5, 0.9)) == 1


def test_around_a_ring_ways_do_not_lead_over_a_start_at_which_nothing_is_to_be_seen() -> None:
    mission = survey(floorplan_of_yaml(RING))
    ways = {(way.source, way.target) for way in mission.ways if START not in (way.source, way.target)}
    names = {node.name for node in mission.nodes} - {START}
    assert len(names) == 4
    reached = {min(names)}
    for _ in names:
        reached |= {b for a, b in ways if a in reached}
    assert reached == names


def test_a_door_that_a_ragged_map_shows_at_two_places_is_one_between_them() -> None:
    door = next(node for node in survey(floorplan_of_yaml(RAGGED)).nodes if node.name.startswith("door"))
    assert door.place == pytest.approx((6.1, 3.76), abs=0.05)
    thing = door.see[0][0]
    assert isinstance(thing, Landmark)
    assert thing.apart_m > 5


def test_what_a_scan_shows_only_if_a_beam_is_aimed_at_it_is_no_landmark() -> None:
    """The sides of a shelf, 0.35 m deep: no shorter wall is one, and their ends are seen in full by luck."""
    shelf = b"[2.4,0.12,3.6,0.12],[3.6,0.12,3.6,0.47],[3.6,0.47,2.4,0.47],[2.4,0.47,2.4,0.12]"
    room = b"size: [7, 6]\nstart_pose: [2, 4.5, 0]\nwalls: [[0,0,7,0],[7,0,7,6],[7,6,0,6],[0,6,0,0]," + shelf + b"]\n"
    corners = [node.place for node in survey(floorplan_of_yaml(room)).nodes if node.name.startswith("corner")]
    assert sorted((round(x, 1), round(y, 1)) for x, y in filter(None, corners)) == [(2.4, 0.5), (3.6, 0.5)]


def _ahead_m(face: Landmark, x_m: float, y_m: float) -> float:
    turn = face.orientation_rad or 0.0
    return (x_m - face.x_m) * math.cos(turn) + (y_m - face.y_m) * math.sin(turn)


def test_ways_lead_to_the_side_from_which_a_thing_is_seen() -> None:
    mission = survey(load_floorplan("drawn:100"))
    nodes = {node.name: node for node in mission.nodes}
    ways = {(way.source, way.target) for way in mission.ways}
    behind = set()
    for source, target in ways:
        (x, y), aliases = nodes[source].place or (0.0, 0.0), [thing for alias in nodes[target].see for thing in alias]
        faces = [each for each in aliases if isinstance(each, Landmark) and each.type.startswith("concave")]
        ahead = [_ahead_m(face, x, y) for face in faces]
        if faces and max(ahead) < -0.1 * math.dist((x, y), nodes[target].place or (0.0, 0.0)):
            behind.add((source, target))
    assert any((target, source) not in ways for source, target in ways), "some lead one way"
    assert not behind, "no way back is needed, as others lead there"


@pytest.mark.parametrize("path", sorted(OTHERS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_map_of_ros_has_a_place_where_robots_begin_and_always_the_same(path: Path) -> None:
    plan = load_floorplan(path)
    assert plan.start is None
    start = most_spacious_start(plan)
    assert start == most_spacious_start(load_floorplan(path))
    assert plan.inside(*start[:2])
    assert with_start(plan, start).start == start
    # Nowhere is more room, as far as a thousand random places tell; the grid's step is an eighth of a metre at most.
    x0, y0, x1, y1 = plan.bounds
    rolled = np.random.default_rng(5).uniform((x0, y0), (x1, y1), (1000, 2)).tolist()
    most_m = max(plan.clearance_m(*place) for place in rolled if plan.inside(*place))
    assert plan.clearance_m(*start[:2]) > most_m - 0.3


def test_a_map_of_ros_as_it_was_delivered_becomes_a_mission_that_a_robot_completes(tmp_path: Path) -> None:
    file = tmp_path / "tb3.phxm"
    built = command("build", "--map", TB3, "--out", file, "--profile", "paper")
    assert built.exception is None
    said = built.stderr.partition("--start ")[2].split()[0]
    ran = command("run", file, "--world", TB3, "--start", said, "--duration", "300", "--json")
    told = json.loads(ran.stdout)
    assert (told["completed"], told["decoded"], told["false_fixes"]) == (1, told["nodes"], 0)
    assert told["nodes"] > 5


def test_a_start_that_is_given_is_the_missions(tmp_path: Path) -> None:
    plan = load_floorplan(TB3)
    file = tmp_path / "tb3.phxm"
    built = command("build", "--map", TB3, "--out", file, "--start=-2,0,180", "--profile", "paper")
    assert built.exception is None
    assert "does not say" not in built.stderr
    mission = survey(with_start(plan, (-2.0, 0.0, 0.0)))
    assert [node.place for node in mission.nodes if node.start] == [(-2.0, 0.0)]
    assert read_encoded(file).header.nodes == len(mission.nodes)


@pytest.mark.parametrize("path", ROS, ids=lambda path: path.stem)
def test_a_start_in_no_free_space_is_told_as_that(path: Path, tmp_path: Path) -> None:
    plan = load_floorplan(path)
    x0, y0, _, _ = plan.bounds
    for x, y in ((x0, y0), (x0 - 1, y0), tuple(plan.walls[0, :2])):
        assert "no robot can stand" in refused("build", "--map", path, "--out", tmp_path / "x", f"--start={x},{y}")
    # What the map itself says is checked as well.
    with pytest.raises(UsageError, match="no robot can stand"):
        survey(replace(plan, start=(x0, y0, 0.0), outlines=()))


def test_a_start_goes_with_a_map_and_is_two_or_three_numbers(tmp_path: Path) -> None:
    out = tmp_path / "x.phxm"
    assert "invalid start" in refused("build", "--map", TB3, "--out", out, "--start", "here")
    assert "made from a map" in refused("build", "office", "--out", out, "--start", "3,1.5")
    assert "nothing to build" in refused("build", "--out", out, "--start", "3,1.5")


def test_in_a_map_of_several_spaces_nobody_guesses_which_is_meant() -> None:
    with pytest.raises(UsageError, match="no single space"):
        most_spacious_start(floorplan_of_yaml(ROOMS))
    told = floorplan_of_yaml(ROOMS + b"start_pose: [6, 2, 0]\n")
    assert with_start(told, (5.0, 1.0, 0.0)).start == (5.0, 1.0, 0.0)
    for place in ((1.5, 2.0, 0.0), (9.0 - STAND_M / 2, 2.0, 0.0)):
        with pytest.raises(UsageError, match="no robot can stand"):
            with_start(told, place)


def test_a_drawing_of_a_run_shows_where_the_robot_was_and_where_it_believed_to_be(tmp_path: Path) -> None:
    plain, plan = read_plain("inspection"), load_floorplan("office_40x40")
    for name, words in (("still", ()), ("run", ("--run",)), ("other", ("--run", "--seed", 1))):
        told = command("draw", "inspection", "--out", tmp_path / f"{name}.svg", *words)
        assert told.exception is None
        assert ("completed it" in told.stderr) == bool(words)
    words, lines = zip(*(_svg(tmp_path / f"{name}.svg") for name in ("still", "run", "other")), strict=True)
    assert ["<!-- true path -->" in text for text in words] == [False, True, True]
    still, run, other = lines
    # Three lines for each of two robots, and three in the legend.
    assert len(run) == len(still) + 9
    assert run != other
    # From the same seed the same.
    reports = simulate_parts(plain, plan, 0)
    assert [report.done for report in reports] == [True, True]
    draw_mission(plain, plan, tmp_path / "same.svg", reports)
    assert _svg(tmp_path / "same.svg")[1] == run


def _svg(path: Path) -> tuple[str, list[str]]:
    """A picture's text, and its lines that are drawn, but for letters."""
    text = path.read_text()
    return text, re.findall(r'<g id="line2d_\d+">\s*<path d="([^"]*)"', text)


def test_a_drawing_of_a_run_wants_a_map(tmp_path: Path) -> None:
    (tmp_path / "bare.yaml").write_text(
        "mission: bare\narea: [0, 0, 8, 8]\nnodes:\n  a: {start: true, see: {position: [1, 1]}}\n"
    )
    assert "no map" in refused("draw", tmp_path / "bare.yaml", "--out", tmp_path / "x.svg", "--run")


@pytest.fixture(scope="module")
def inspection(tmp_path_factory: pytest.TempPathFactory) -> MissionRun:
    folder, plain = tmp_path_factory.mktemp("inspection"), read_plain("inspection")
    assert command("build", "inspection", "--out", folder / "m.phxm", "--profile", "paper").exception is None
    part = Part(read_encoded(folder / "m-a.phxm"), None, (3.0, 1.5, 0.0))
    return MissionRun(plan=load_floorplan(plain.floor_plan), parts=(part,))


REPORT = Report(0, True, 1.0, [(0.5, 1)], {}, 7, 0, [1.0], [1.0], [0.1], [0.1], [(0.2, "drift")], [(0.3, "pick")], [])


@pytest.mark.parametrize(
    "other",
    [
        {"not_validated": [(0.2, "blocked")]},
        {"not_validated": [(0.3, "drift")]},
        {"actions": [(0.3, "drop")]},
        {"actions": []},
        {"hashes_tried": 8},
        {"decoded": [(0.6, 1)]},
        {"false_fixes": 1},
        {"done": False},
    ],
    ids=lambda other: next(iter(other)),
)
def test_a_runs_digest_covers_what_happened_and_no_clock(other: dict[str, object], inspection: MissionRun) -> None:
    def digest(report: Report) -> str:
        return str(summary(inspection, [report])["digest"])

    assert digest(replace(REPORT, **other)) != digest(REPORT)
    assert digest(replace(REPORT, search_ms=[9.0], extraction_ms=[9.0])) == digest(REPORT)


def test_an_empty_file_is_called_empty(tmp_path: Path) -> None:
    for name, content in (("none.yaml", ""), ("comment.yaml", "# nothing yet\n"), ("none.phxm", "")):
        (tmp_path / name).write_text(content)
        assert "is empty" in refused("build", tmp_path / name, "--out", tmp_path / "x.phxm")
        assert "is empty" in refused("run", tmp_path / name)
    for read in (read_encoded, read_start_key):
        with pytest.raises(MalformedMission, match="is empty"):
            read(tmp_path / "none.phxm")


@pytest.mark.parametrize(
    ("name", "is_left_out"),
    [("drawn:21", True), pytest.param("nav2_depot", False, marks=pytest.mark.long), ("office_40x40", False)],
)
def test_a_mission_made_from_a_map_has_what_can_be_reached_and_tells_how_much_it_has_not(
    name: str, is_left_out: bool, caplog: pytest.LogCaptureFixture
) -> None:
    plan = load_floorplan(name)
    mission = survey(plan)
    assert not [row for row in audit(mission, Profile.PAPER).nodes if "unreachable from any start" in row.problems]
    assert len(caplog.messages) == is_left_out
    for message in caplog.messages:
        told = re.fullmatch(rf"{plan.name}: (\d+) of (\d+) landmarks left out: no way from the start", message)
        assert told
        assert int(told[2]) - int(told[1]) == len(mission.nodes) - 1


@given(st.data())
def test_whatever_nobody_finds_each_place_that_is_left_is_on_a_tour_from_the_start_and_back(
    data: st.DataObject,
) -> None:
    names = [START, *"abcdefgh"]
    pairs = st.sets(st.tuples(st.sampled_from(names), st.sampled_from(names)).filter(lambda way: way[0] != way[1]))
    ways, behind = data.draw(pairs), data.draw(pairs)
    dark = data.draw(st.sets(st.sampled_from(names[1:])))
    left = _without(dark, ways, behind)
    for place in _reached(START, left):
        assert place not in dark
        assert START in _reached(place, left)


def test_a_landmark_where_robots_begin_is_in_reach_and_a_start_without_any_is_refused() -> None:
    mission = survey(floorplan_of_yaml(ROOMS + b"start_pose: [6, 2, 0]\n"))
    assert [node.name for node in mission.nodes] == ["start", "room1"]
    assert len(mission.ways) == 2
    # The middle of a long hall is in no lidar's sight as a room.
    with pytest.raises(UsageError, match="has no landmarks"):
        survey(floorplan_of_yaml(HALL + b"start_pose: [10, 2, 0]\n"))
