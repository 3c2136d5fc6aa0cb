"""What an encoded file does not say: codes on walls, robots' actions, where they begin; and what no world here has."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from phalanx.cli.commands.mission import mission as group
from phalanx.cli.mission.files import Wanted, read_encoded, read_plain
from phalanx.cli.up import _orders
from phalanx.errors import PeerError, UsageError
from phalanx.mission import plain_mission
from phalanx.world.building.floorplan import load_floorplan
from phalanx.world.missions.orders import orders_of_files

NORTH = 1.5708  # as the map says it
RED = {
    "mission": "red",
    "map": "office_40x40",
    "coding": {"delta_mm": 400, "kdf_log2_n": 2},
    "nodes": {
        "start": {"start": True, "see": {"position": [3.0, 1.5]}},
        "lamp": {"see": {"sensor": "red"}, "final": True},
    },
    "ways": [["start", "lamp"]],
}


def command(*words: object) -> Result:
    return CliRunner().invoke(group, [str(word) for word in words], standalone_mode=False)


def built(folder: Path, name: str, *words: str) -> list[str]:
    folder.mkdir(exist_ok=True)
    assert command("build", name, "--out", folder / "m.phxm", *words).exception is None
    return sorted(str(path) for path in folder.glob("m*.phxm"))


@pytest.mark.parametrize(
    ("name", "profile", "lacks"),
    [
        pytest.param("delivery", "sealed", "not in this world: codes on the walls;", marks=pytest.mark.long),
        ("delivery", "paper", "not in this world: actions that robots can do, codes on the walls;"),
        ("inspection", "paper", "robot 2 is not at the start of its mission"),
    ],
)
def test_files_are_lived_where_their_author_furnished_the_world_and_elsewhere_it_is_said_what_is_missing(
    tmp_path: Path, name: str, profile: str, lacks: str
) -> None:
    files, in_time = built(tmp_path, name, "--profile", profile), ("--duration", 120)
    there = command("run", *files, "--furnish", name, *in_time)
    assert there.exception is None
    assert there.return_value == 0
    assert not re.findall(r"^phalanx: ", there.stderr, re.MULTILINE)
    bare = command("run", *files, *in_time)
    assert bare.exception is None
    assert bare.return_value == 1
    assert lacks in bare.stderr
    assert "--furnish" in bare.stderr


def test_each_file_belongs_to_a_part_and_one_key_to_one_file(tmp_path: Path) -> None:
    one, other = built(tmp_path, "inspection", "--profile", "paper")
    wrong = {
        "2 encoded files": ("run", one, other, "--furnish", "delivery"),
        "1 encoded files": ("run", one, "--furnish", "inspection"),
        "--key for 2 files": ("run", one, other, "--key", one),
        "several plain missions": ("run", "office", "delivery"),
        "are for encoded missions": ("run", "office", "--furnish", "office"),
    }
    for says, words in wrong.items():
        error = command(*words).exception
        assert isinstance(error, UsageError), words
        assert says in str(error)


def test_robots_before_visitors_get_the_files_of_both_parts_and_begin_where_these_do(tmp_path: Path) -> None:
    files = tuple(built(tmp_path, "inspection"))
    _, orders = _orders(Wanted(files, "inspection", None, (), "--start-key"), None)
    assert orders is not None
    assert [part.mission for part in orders.parts] == [read_encoded(Path(file)) for file in files]
    assert all(part.key is not None for part in orders.parts)
    assert [part.start for part in orders.parts] == [(3.0, 1.5, NORTH), (4.0, 1.5, NORTH)]
    (alone,) = built(tmp_path / "d", "delivery")
    wanted = (Wanted((alone,), told, None, (), "--start-key") for told in ("delivery", None))
    with_fixtures, bare = (_orders(each, None)[1] for each in wanted)
    assert with_fixtures is not None
    assert bare is not None
    assert [code.text for code in with_fixtures.plan.codes] == ["7d1f0c52a9e84b3666c0e2f1b8d49a07"]
    assert {action.name for action in with_fixtures.pool} == {"pick", "hand_over"}
    assert (bare.plan.codes, bare.pool) == ((), ())
    assert with_fixtures.controller == bare.controller != ()


def test_a_start_that_is_said_goes_before_those_of_the_parts() -> None:
    plain, plan = read_plain("inspection"), load_floorplan("office_40x40")
    with pytest.raises(UsageError, match="0 encoded files"):
        orders_of_files("none", (), plan, plain)
    here = (5.0, 1.5, 0.0)
    orders = orders_of_files("none", ((None, None), (None, None)), plan, plain, here)  # type: ignore[arg-type]
    assert [part.start for part in orders.parts] == [here, here]


def test_a_mission_for_a_sensor_that_no_robot_here_has_is_refused_before_it_runs(tmp_path: Path) -> None:
    (tmp_path / "red.yaml").write_text(repr(RED))  # YAML enough
    (file,) = built(tmp_path, str(tmp_path / "red.yaml"))
    for words in ((tmp_path / "red.yaml",), (file, "--furnish", tmp_path / "red.yaml")):
        error = command("run", *words).exception
        assert isinstance(error, UsageError)
        assert "'lamp' requires the reading 'red'" in str(error)
    unknown = command("run", file)
    assert unknown.return_value == 1
    assert "beacons or other sources of sensor readings" in unknown.stderr


def test_a_node_that_is_known_by_a_landmark_too_needs_no_sensor(tmp_path: Path) -> None:
    door = {"doorway": [9.0, 12.0], "facing": 90}
    either = {**RED, "nodes": {**RED["nodes"], "lamp": {"see": [{"sensor": "red"}, door], "final": True}}}  # type: ignore[dict-item]
    assert len(plain_mission(either).nodes[1].see) == 2
    (tmp_path / "either.yaml").write_text(repr(either))
    told = command("run", tmp_path / "either.yaml")
    assert told.exception is None
    assert told.return_value == 0


def test_what_is_no_mission_is_called_so_by_every_command(tmp_path: Path) -> None:
    file = tmp_path / "x.phxm"
    file.write_bytes(bytes(range(7, 250)))
    told = [command(name, file).exception for name in ("run", "inspect", "verify", "crack")]
    assert all(isinstance(error, PeerError) for error in told), told
    assert {str(error) for error in told} == {f"{file} is not an encoded mission: not a mission file"}
