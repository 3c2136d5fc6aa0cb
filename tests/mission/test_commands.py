"""The commands `phalanx mission build|inspect|verify|audit|draw|crack`, as people run them."""

from __future__ import annotations

import json
import math
import re
import stat
import subprocess

import pytest
from click.testing import CliRunner

from phalanx.cli.commands.mission import mission as group
from phalanx.cli.credentials import read_trusted
from phalanx.cli.mission.author import explored
from phalanx.cli.mission.files import (
    parse_box,
    parse_robots,
    parse_window,
    read_plain,
)
from phalanx.config.builtin import built_in
from phalanx.errors import PeerError, Unavailable, UsageError
from phalanx.mission import Landmark, Profile, parse_mission
from phalanx.mission.file.records import FOREVER_S
from phalanx.mission.landmarks.sites import landmarks_of
from phalanx.mission.worth import audit
from phalanx.world.building.floorplan import load_floorplan

SMALL = """
mission: small
area: [0, 0, 8, 8]
coding: {delta_mm: 400, kdf_log2_n: 1, kdf_r: 1}
nodes:
  start: {start: true, see: {position: [1, 1]}}
  door: {see: {doorway: [5, 4], facing: 90}, final: true, wait: [go]}
  side: {see: {doorway: [2, 6], facing: 0}}
ways:
  - [start, door]
  - [start, side]
"""
TWO = """
mission: two
coding: {delta_mm: 400, kdf_log2_n: 1, kdf_r: 1}
nodes:
  start: {start: true, see: {position: [3.0, 1.5]}}
  lobby: {see: {doorway: [9, 12], facing: 90}, final: true}
ways: [[start, lobby]]
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yaml").write_text(SMALL)
    subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", "op.pem"], check=True)
    subprocess.run(["openssl", "pkey", "-in", "op.pem", "-pubout", "-out", "op.pub"], check=True)
    return tmp_path


def run(*words: str, code: int = 0):
    """stdout; what is raised is raised."""
    result = CliRunner().invoke(group, words, standalone_mode=False)
    if result.exception:
        raise result.exception
    assert (result.return_value or 0) == code
    return result.stdout


def said_by(*words: str) -> str:
    """stderr."""
    return CliRunner().invoke(group, words, standalone_mode=False).stderr


def js(*words: str, code: int = 0):
    return json.loads(run(*words, "--json", code=code))


def test_a_mission_is_built_signed_inspected_and_verified(folder):
    told = js("build", "small.yaml", "--out", "m.phxm", "--sign-key", "op.pem", "--robots", "1-3,9", "--valid", "10/20")
    (row,) = told["files"]
    assert (row["nodes"], row["ways"], row["robots"], row["valid_to_s"]) == (3, 4, [1, 2, 3, 9], 20)
    assert stat.S_IMODE((folder / "m.phxm.key").stat().st_mode) == 0o600
    seen = js("inspect", "m.phxm")
    assert [node["to"] for node in seen["nodes"]] == [[1, 2], [0], [0]]
    assert "flags" in seen["nodes"][0]
    run("inspect", "m.phxm")
    assert js("verify", "m.phxm", "--trust", "op.pub")["trusted"] is True
    signer = seen["signer"]
    assert signer in run("verify", "m.phxm", "--trust", signer)
    assert js("verify", "m.phxm", "--robot", "9", "--at", "15")["ok"] is True
    for words in (("--robot", "8", "--at", "15"), ("--at", "25"), ("--trust", "00" * 32)):
        with pytest.raises(PeerError):
            run("verify", "m.phxm", *words)


def test_verify_tells_the_reason_of_whatever_was_altered(folder):
    run("build", "small.yaml", "--out", "m.phxm", "--sign-key", "op.pem")
    raw = (folder / "m.phxm").read_bytes()
    for byte in range(0, len(raw), 7):
        altered = bytearray(raw)
        altered[byte] ^= 1
        (folder / "bad.phxm").write_bytes(altered)
        with pytest.raises(PeerError) as caught:
            run("verify", "bad.phxm", "--trust", "op.pub")
        assert str(caught.value)
    result = CliRunner().invoke(group, ["verify", "bad.phxm", "--json"], standalone_mode=False)
    assert json.loads(result.stdout)["ok"] is False
    assert isinstance(result.exception, PeerError)


def test_the_same_seed_builds_the_same_bytes_and_says_that_it_is_not_for_earnest(folder):
    for name in ("a", "b"):
        run("build", "small.yaml", "--out", f"{name}.phxm", "--seed", "7")
    run("build", "small.yaml", "--out", "c.phxm")
    a, b, c = ((folder / f"{name}.phxm").read_bytes() for name in "abc")
    assert a == b != c


def test_a_mission_in_parts_is_a_file_for_each(folder):
    files = js("build", "inspection", "--out", "two.phxm", "--profile", "paper")["files"]
    assert [row["file"] for row in files] == ["two-a.phxm", "two-b.phxm"]
    for row in files:
        parse_mission((folder / row["file"]).read_bytes())


def test_a_floor_plan_becomes_a_mission_and_a_mission_is_checked_against_it(folder):
    told = js("build", "--map", "office_40x40", "--out", "all.phxm", "--profile", "paper")
    assert told["files"][0]["nodes"] > 30
    assert "no such doorway on the map" in said_by("build", "small.yaml", "--map", "office_40x40", "--out", "m.phxm")
    of_ours = said_by("build", "office", "--map", "office_40x40", "--out", "o.phxm", "--profile", "paper")
    assert "warning" not in of_ours


def test_a_mission_that_looks_wrong_is_built_with_a_warning(folder):
    (folder / "odd.yaml").write_text(SMALL.replace("  side:", "  twin: {see: {doorway: [2, 6], facing: 0}}\n  side:"))
    said = said_by("build", "odd.yaml", "--out", "odd.phxm")
    assert (folder / "odd.phxm").exists()
    assert "side: one observation satisfies twin too" in said
    assert "twin: unreachable from any start" in said


@pytest.mark.long
def test_of_a_map_in_which_no_robot_gets_on_nothing_is_built_and_the_reason_is_told(folder):
    """In drawn:22 robots begin before a door that they do not see on the way through it."""
    error = (
        CliRunner().invoke(group, ["build", "--map", "drawn:22", "--out", "m.phxm"], standalone_mode=False).exception
    )
    assert isinstance(error, UsageError)
    assert re.search(r"in drawn:mirror:22: corner\d+ from start: uncertainty ", str(error))
    assert "no robot" not in said_by("build", "--map", "drawn:1", "--profile", "paper", "--out", "m.phxm")


def test_a_trial_and_its_outlook_begin_turned_as_the_start_says(folder):
    """The map says north; who begins with its back to the only door has to turn, and knows less well where it is."""
    walls = "[[0,0,9,0],[9,0,9,8],[9,8,0,8],[0,8,0,0],[0,5,3.5,5],[5.5,5,9,5]]"
    (folder / "flat.yaml").write_text(f"size: [9, 8]\nstart_pose: [4.5, 2, 1.5708]\nwalls: {walls}\n")
    begun = [explored("flat.yaml", start, "audit")[1].start for start in (None, "4.5,2,-90", "4.5,2")]
    assert [round(pose[2], 2) for pose in begun] == [1.57, -1.57, 1.57]


def test_the_audit_prints_what_it_assumes(folder):
    text = run("audit", "small.yaml", "--open-start")
    assert "KDFs/s" in text
    assert "> 2^128" in text
    told = js("audit", "office", "--profile", "paper")
    assert len(told["nodes"]) == 33
    assert told["core_s"] > 0
    assert told["rates"]["hash_core"] > 0


def test_who_has_the_floor_plan_is_counted_beside_who_has_not(folder):
    told = js("audit", "office", "--open-start")
    assert told["plan_core_s"] < 1 < 1000 < told["core_s"]
    assert told["nodes"][5]["by_plan"] < 10 < told["nodes"][5]["candidates"]
    assert js("audit", "office")["plan_core_s"] is None, "nothing can be begun"
    assert "same, with the map" in run("audit", "office", "--open-start", "--offset-mm", "50")


def test_a_trial_lives_the_mission_in_its_map_and_reports(folder):
    (folder / "two.yaml").write_text(f"map: office_40x40{TWO}")
    told = js("audit", "two.yaml", "--trial", "2", "--profile", "paper")
    assert told["feasible"] is True
    trial = told["trial"]
    assert (trial["times"], trial["completed"], trial["false_fixes"], trial["false_decodes"]) == (2, 2, 0, 0)
    assert 0 < trial["pose_error_m_max"] < 0.5
    assert [(row["seed"], row["decoded"], row["nodes"], row["end"]) for row in trial["runs"]] == [
        (0, 2, 2, ""),
        (1, 2, 2, ""),
    ]
    (folder / "far.yaml").write_text(f"map: office_40x40{TWO}".replace("[9, 12], facing: 90", "[9, 39], facing: 0"))
    text = run("audit", "far.yaml", "--trial", "1", "--profile", "paper")
    assert "infeasible from start: 38.0 m away, but a robot follows a direction for at most" in text
    assert "ran 1 times: 0 completed" in text
    assert "seed 0    1 of 2 nodes   " in text
    with pytest.raises(UsageError, match="no map to run the mission in"):
        run("audit", "small.yaml", "--trial", "1")


def test_robots_that_are_told_of_strangers_believe_no_landmark_that_stands_alone(folder):
    (folder / "two.yaml").write_text(f"map: office_40x40{TWO}")
    how = ["run", "two.yaml", "--profile", "paper", "--duration", "30"]
    assert "2 of 2 nodes decoded" in run(*how)
    assert "1 of 2 nodes decoded" in run(*how, "--strangers", "0.05", code=1)


def test_a_map_lies_beside_its_mission_wherever_one_stands(folder, monkeypatch):
    there, elsewhere = folder / "there", folder / "elsewhere"
    (there / "maps").mkdir(parents=True)
    elsewhere.mkdir()
    (there / "two.yaml").write_text(f"map: maps/hall.yaml{TWO}".replace("facing: 90", "facing: 0"))
    hall = "size: [20, 20]\nstart_pose: [3, 1.5, 0]\nwalls: [[0, 12, 8, 12], [10, 12, 20, 12]]\n"
    (there / "maps" / "hall.yaml").write_text(hall)
    monkeypatch.chdir(elsewhere)
    for source in ("../there/two.yaml", str(there / "two.yaml")):
        assert js("audit", source)["feasible"] is True
        assert read_plain(source).nodes[1].see[0][0].apart_m == math.inf, "the map shows no other door"
        run("draw", source, "--out", "two.svg")
    (elsewhere / "maps").mkdir()
    (there / "maps" / "hall.yaml").rename(elsewhere / "maps" / "hall.yaml")
    with pytest.raises(UsageError, match=r"no file .*there/maps/hall.yaml"):
        run("draw", "../there/two.yaml", "--out", "two.svg")


def test_a_floor_plan_is_tried_first(folder):
    (folder / "two.yaml").write_text(TWO)
    run("build", "two.yaml", "--open-start", "--out", "two.phxm", "--offset-mm", "50")
    told = js("crack", "two.phxm", "--map", "office_40x40", "--offset-mm", "50")
    assert ({node["node"] for node in told["found"]}, told["tries"] < 10) == ({0, 1}, True)
    run("build", "two.yaml", "--profile", "paper", "--out", "paper.phxm")
    with pytest.raises(UsageError, match="--map with the paper profile"):
        run("crack", "paper.phxm", "--map", "office_40x40")


def test_a_paper_mission_is_cracked_and_a_sealed_one_wants_its_key(folder):
    run("build", "small.yaml", "--out", "p.phxm", "--profile", "paper")
    told = js("crack", "p.phxm", "--box", "0,0,8,8")
    assert {node["node"] for node in told["found"]} == {0, 2}
    assert told["shapes_not_tried"] == 1
    assert told["tries_per_s"] > 0
    run("build", "small.yaml", "--out", "s.phxm")
    with pytest.raises(UsageError, match="start key"):
        run("crack", "s.phxm")
    told = js("crack", "s.phxm", "--box", "0,0,8,8", "--key", "s.phxm.key")
    assert {node["node"] for node in told["found"]} == {0, 2}, "the door wants a message"
    assert told["kdf"] == {"log2_n": 1, "r": 1}
    assert "nodes read" in run("crack", "s.phxm", "--box", "100,100,102,102", "--key", "s.phxm.key", code=1)
    run("build", "small.yaml", "--out", "t.phxm")
    with pytest.raises(UsageError, match="another mission"):
        run("crack", "s.phxm", "--key", "t.phxm.key")


@pytest.mark.parametrize("form", ["svg", "png"])
def test_a_mission_is_drawn(folder, form):
    run("draw", "office", "--out", f"deep/office.{form}")
    assert (folder / "deep" / f"office.{form}").stat().st_size > 10_000


def test_without_matplotlib_drawing_says_what_is_missing(folder, monkeypatch):
    monkeypatch.setattr("phalanx.lab.figures.missions.importlib.util.find_spec", lambda _: None)
    with pytest.raises(Unavailable, match="matplotlib"):
        run("draw", "office", "--out", "office.svg")


@pytest.mark.parametrize(
    "words, says",
    [
        (("build", "--out", "x"), "nothing to build"),
        (("build", "nowhere.yaml", "--out", "x"), "no file nowhere.yaml"),
        (("build", "broken.yaml", "--out", "x"), "broken.yaml:1: not YAML: "),
        (("build", "--map", "broken.yaml", "--out", "x"), "broken.yaml:1: not YAML: "),
        (("build", "bare.yaml", "--out", "x"), "bare.yaml is a map, not a mission"),
        (("build", "twice.yaml", "--out", "x"), "occurs twice"),
        (("build", "small.yaml", "--out", "x", "--robots", "a"), "invalid robot id"),
        (("build", "small.yaml", "--out", "x", "--robots", "5-1"), "robot ids 5-1"),
        (("build", "small.yaml", "--out", "x", "--robots", "1,60000-70000"), "robot ids 60000-70000"),
        (("run", "small.yaml", "--at", "1e308"), "--at 1e+308"),
        (("build", "small.yaml", "--out", "x", "--valid", "now"), "invalid period"),
        (("build", "small.yaml", "--out", "x", "--valid", "now/then"), "invalid time"),
        (("build", "small.yaml", "--out", "x", "--sign-key", "op.pub"), "no unencrypted private key"),
        (("verify", "nowhere.phxm"), "no file"),
        (("crack", "m.phxm", "--box", "1,2,3"), "invalid area"),
        (("draw", "office", "--out", "x.gif"), "neither PNG nor SVG"),
        (("audit", "m.phxm"), "already encoded"),
        (("build", "--map", "empty.yaml", "--out", "x"), "has no landmarks"),
        (("build", "--map", "bare.yaml", "--out", "x"), "has no landmarks"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_cannot_be_done_is_said_in_one_line(folder, words, says):
    run("build", "small.yaml", "--out", "m.phxm")
    (folder / "broken.yaml").write_text("nodes: [")
    (folder / "twice.yaml").write_text(SMALL.replace("  side:", "  door:"))
    (folder / "empty.yaml").write_text("size: [4, 4]\nwalls: []\n")
    (folder / "bare.yaml").write_text("size: [4, 4]\nwalls: []\nstart_pose: [1, 1, 0]\n")
    with pytest.raises(UsageError) as caught:
        run(*words)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_written_is_not_the_user_s_mistake(folder):
    with pytest.raises(Unavailable, match=r"cannot write small\.yaml/x"):
        run("build", "small.yaml", "--out", "small.yaml/x")


def test_every_command_has_an_example():
    for name, command in group.commands.items():
        if name != "run":
            assert command.epilog.startswith(f"Example: phalanx mission {name}"), name
            assert CliRunner().invoke(group, [name, "--help"]).exit_code == 0


def test_options_are_read_as_they_are_written(folder):
    assert parse_robots("1,2,5-7") == (1, 2, 5, 6, 7)
    assert parse_window("/") == (0, FOREVER_S)
    assert parse_window("1970-01-02/1970-01-03T00:00+01:00") == (86_400, 2 * 86_400 - 3600)
    assert parse_box("0,1,2,3.5") == (0, 1, 2, 3.5)
    assert read_trusted("AB" * 32) == bytes([0xAB]) * 32


class TestBuiltIn:
    @pytest.mark.parametrize("name", built_in("missions"))
    @pytest.mark.parametrize("profile", Profile)
    def test_all_that_comes_with_phalanx_has_nothing_wrong(self, name, profile):
        mission = read_plain(name)
        report = audit.audit(mission, profile)
        assert not [row for row in report.nodes if row.problems]

    def test_the_office_is_the_floor_plans_32_landmarks(self):
        mission = read_plain("office")
        kinds = [alias[0].type for node in mission.nodes for alias in node.see[:1] if isinstance(alias[0], Landmark)]
        assert {kind: kinds.count(kind) for kind in set(kinds)} == {"doorway": 19, "room": 9, "concave_left": 4}
        shown = [alias for site in landmarks_of(load_floorplan("office_40x40")) for alias in site.aliases]
        for node in mission.nodes[1:]:
            for (landmark,) in node.see:
                near = [s for s in shown if s.type == landmark.type and abs(s.x_m - landmark.x_m) < 1e-3]
                assert [s for s in near if abs(s.y_m - landmark.y_m) < 1e-3], node.name
