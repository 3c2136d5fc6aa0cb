"""Missions that are made from a map can be looked at like others; whoever waits for locks is told how far they are."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from phalanx.cli import terminal
from phalanx.cli.commands.mission import mission as group
from phalanx.errors import UsageError
from phalanx.mission import BuildOptions, Profile
from phalanx.mission.authoring import survey
from phalanx.mission.worth.audit import audit
from phalanx.mission.worth.feasible import look_ahead
from phalanx.mission.worth.shown import candidates_in
from phalanx.world.building.floorplan import load_floorplan

CHEAP = """
mission: chain
coding: {{delta_mm: 400, kdf_log2_n: 1, kdf_r: 1}}
nodes:
  n0: {{start: true, see: {{position: [0, 0]}}}}
{nodes}
ways:
{ways}
"""


def command(*words: object) -> Result:
    return CliRunner().invoke(group, [str(word) for word in words], standalone_mode=False)


def chain(folder: Path, nodes: int) -> Path:
    file = folder / "chain.yaml"
    rows = [f"  n{i}: {{see: {{doorway: [{3 * i}, 0], facing: 0}}}}" for i in range(1, nodes)]
    ways = [f"  - [n{i - 1}, n{i}]" for i in range(1, nodes)]
    file.write_text(CHEAP.format(nodes="\n".join(rows), ways="\n".join(ways)))
    return file


# Two rooms, and between them a door 0.9 m wide.
HALL = """
size: [8, 6]
start_pose: [1, 1, 0]
walls: [[0, 0, 8, 0], [8, 0, 8, 6], [8, 6, 0, 6], [0, 6, 0, 0], [5, 0, 5, 2.5], [5, 3.4, 5, 6]]
"""


def test_no_folder_is_made_for_missions_and_their_keys(tmp_path: Path) -> None:
    error = command("build", "office", "--out", tmp_path / "nowhere" / "m.phxm").exception
    assert isinstance(error, UsageError)
    assert error.hint == "create it first"
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.long
def test_the_audit_that_a_build_from_a_map_points_to_is_of_the_same_mission(tmp_path: Path) -> None:
    told = command("build", "--map", "aws_small_house", "--out", tmp_path / "m.phxm", "--profile", "paper")
    assert told.exception is None
    hint = re.search(r"(\d+) more; phalanx mission (audit .*) lists them", told.stderr)
    assert hint
    words = shlex.split(hint[2].replace("MAP", "aws_small_house"))
    report = json.loads(command(*words, "--json").stdout)
    problems = [problem for node in report["nodes"] for problem in node["problems"]]
    warned = [line for line in told.stderr.splitlines() if line.startswith("phalanx: warning:")]
    assert len(problems) == int(hint[1]) + len(warned) - 1


@pytest.mark.long
def test_a_map_alone_is_audited_as_what_build_makes_of_it() -> None:
    plan = load_floorplan("office_30x25")
    report = json.loads(command("audit", "--map", "office_30x25", "--json").stdout)
    mission = survey.survey(plan)
    told = audit(
        mission,
        Profile.SEALED,
        plan=candidates_in(plan, BuildOptions().offset_mm),
        outlook=look_ahead(mission, None, plan),
    ).to_json()
    assert report["nodes"] == json.loads(json.dumps(told))["nodes"]
    elsewhere = json.loads(command("audit", "--map", "office_30x25", "--start", "14,8", "--json").stdout)
    assert elsewhere["nodes"] != report["nodes"]


@pytest.mark.long
def test_a_map_alone_is_drawn_with_its_landmarks(tmp_path: Path) -> None:
    assert command("draw", "--map", "office_30x25", "--out", tmp_path / "m.svg").exception is None
    text = (tmp_path / "m.svg").read_text()
    names = [node.name for node in survey.survey(load_floorplan("office_30x25")).nodes]
    assert len(names) > 10
    assert all(f"<!-- {name} -->" in text for name in names)


def test_doors_are_as_wide_as_the_map_or_the_author_says(tmp_path: Path) -> None:

    def doors(*words: str | Path) -> int:
        nodes = json.loads(command("audit", "--profile", "paper", "--json", *words).stdout)["nodes"]
        assert not any("a door of" in problem for node in nodes for problem in node["problems"])
        return sum(node["name"].startswith("door") for node in nodes)

    text = HALL.replace("walls", "door_width: [0.7, 1.3]\nwalls")
    for name, file in (("paper", HALL), ("real", text)):
        (tmp_path / f"{name}.yaml").write_text(file)
    assert doors("--map", tmp_path / "paper.yaml") == 0
    assert doors("--map", tmp_path / "paper.yaml", "--door-width", "0.7,1.3") == 1
    assert doors("--map", tmp_path / "real.yaml") == 1
    # A mission that somebody wrote is told the same.
    mission = tmp_path / "mission.yaml"
    told = (
        "nodes:\n  a: {start: true, see: {position: [1, 2]}}\n  d: {see: {doorway: [4, 2], facing: 90}, width: 0.9}\n"
    )
    walls = "walls: [[0, 0, 8, 0], [8, 0, 8, 4], [8, 4, 0, 4], [0, 4, 0, 0], [4, 0, 4, 1.55], [4, 2.45, 4, 4]]\n"
    (tmp_path / "nine.yaml").write_text(walls)
    mission.write_text(f"mission: nine\nmap: nine.yaml\n{told}ways: [[a, d]]\n")
    with_map = ("--map", tmp_path / "nine.yaml")
    for words in ((), ("--door-width", "0.7,1.3"), (*with_map, "--door-width", "0.7,1.3"), with_map):
        said = command("build", mission, *words, "--profile", "paper", "--out", tmp_path / "m.phxm").stderr
        assert (said == "") == ("--door-width" in words), (words, said)
    for said in ("0.7", "1,2,3", "wide,door", "3,1", "nan,1"):
        assert isinstance(command("audit", "--map", "drawn:1", "--door-width", said).exception, UsageError), said


def test_a_mission_with_doors_of_nine_tenths_of_a_metre_is_lived(tmp_path: Path) -> None:
    words = ("--door-width", "0.7,1.3")
    built = command("build", "--map", "drawn:1", *words, "--profile", "paper", "--out", tmp_path / "m.phxm")
    assert "a door of" not in built.stderr
    lived = json.loads(command("run", tmp_path / "m.phxm", "--world", "drawn:1", *words, "--json").stdout)
    assert (lived["completed"], lived["decoded"], lived["nodes"]) == (1, 21, 21)
    assert lived["false_fixes"] == lived["false_decodes"] == 0


def test_robots_see_with_the_lidar_that_is_said() -> None:
    def lived(*words: str) -> dict[str, object]:
        told: dict[str, object] = json.loads(command("run", "delivery", "--profile", "paper", "--json", *words).stdout)
        return told

    short, wide = ("--duration", "25"), ("--lidar", "360,720,12,0.02")
    usual, same = lived(*short), lived(*short, "--lidar", "270")
    assert usual["digest"] == same["digest"] != lived(*short, *wide)["digest"]
    around = lived(*wide)
    assert around["completed"] == 1
    assert around["false_fixes"] == around["false_decodes"] == 0
    # The usual one has found the first door, and the second, in that time.
    assert usual["decoded"] == 3
    assert lived(*short, "--lidar", "270,1080,0.5")["decoded"] == 1, "who sees half a metre finds no door"
    for said in ("", "270,many", "400", "nan", "270,1", "270,1080,30,0.01,5", "270,1080,0.1"):
        assert isinstance(command("run", "delivery", "--lidar", said).exception, UsageError), said


def test_robots_with_another_lidar_audit_each_other() -> None:
    words = ("--profile", "paper", "--defence", "hardened", "--robots", "3", "--lidar", "360,720", "--duration", "60")
    told = json.loads(command("run", "office", *words, "--json").stdout)
    assert told["audits"]["passed"] > 0
    assert (told["audits"]["refused"], told["in_safe_mode"]) == (0, [])


def test_a_map_is_explored_as_far_as_the_lidar_shows_it() -> None:
    def names(*words: str) -> set[str]:
        told = json.loads(command("audit", "--map", "drawn:57", "--profile", "paper", "--json", *words).stdout)
        return {node["name"].rstrip("0123456789") for node in told["nodes"]}

    assert "room" in names()
    assert "room" not in names("--lidar", "270,1080,2")


def test_an_audit_of_what_nobody_can_begin_to_guess_gives_no_time_for_the_whole() -> None:
    def whole(*words: str) -> list[str]:
        (line,) = [row for row in command("audit", *words).stdout.splitlines() if row.startswith("all readable nodes")]
        return line.split()[5:]

    assert whole("office") == ["-", "-"]
    assert "-" not in whole("office", "--profile", "paper")


@pytest.mark.parametrize("words", [("audit",), ("draw", "--out", "x.svg")])
def test_without_mission_and_map_it_is_said_what_to_give(words: tuple[str, ...]) -> None:
    error = command(*words).exception
    assert isinstance(error, UsageError)
    assert f"nothing to {words[0]}" in str(error)
    start = command(words[0], "office", "--start", "1,1", *words[1:]).exception
    assert isinstance(start, UsageError)


def test_locks_that_take_long_are_counted_in_a_log_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = chain(tmp_path, 64)
    said = command("build", file, "--out", tmp_path / "m.phxm").stderr
    assert re.findall(r"(\d+) of 64 locks", said) == ["64"], "nobody waited for the others"
    monkeypatch.setattr(terminal, "EVERY_S", 0.0)
    said = command("build", file, "--out", tmp_path / "m.phxm").stderr
    assert re.findall(r"(\d+) of 64 locks", said) == ["16", "32", "48", "64"]
    assert "locks" not in command("build", chain(tmp_path, 8), "--out", tmp_path / "m.phxm").stderr
