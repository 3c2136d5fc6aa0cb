"""Scenario files: where a mistake is, what the built-in ones say, and that schema and page agree with the reader."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

import phalanx
from phalanx.attacks import IN_FLOCKS
from phalanx.config import BtiConfig
from phalanx.config.builtin import built_in
from phalanx.config.flock import Box, Disc, FlockConfig
from phalanx.config.radio import RadioConfig
from phalanx.errors import UsageError
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.file import (
    MOST_BYTES,
    SCHEMA_NAME,
    find_scenario,
    parse_scenario,
    read_scenario,
    scenario_schema,
)
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.play import run_scenario

DATA = Path(phalanx.__file__).parent / "data"
SPOOF = AttackSpec(name="spoof")
TWICE = "attacks:\n  - {name: spoof, robot: 2}\n  - {name: jam, robot: 3}\n  -\n    name: spoof\n    at_s: 3\n    robot: 2\n"
AVOIDED = "flock: {c1_beta: 1}\nobstacles:\n  - {x_m: 1, y_m: 2, radius_m: 1}\n"


def refused(text: str | bytes) -> tuple[int, str, str]:
    """Line, complaint and hint of a file's first mistake."""
    with pytest.raises(UsageError) as error:
        parse_scenario(text if isinstance(text, bytes) else text.encode(), "f.yaml")
    place, line, what = re.fullmatch(r"(f\.yaml)(?::(\d+))?: (.*)", str(error.value), re.DOTALL).groups()
    assert place == "f.yaml"
    return int(line or 0), what, error.value.hint


class TestFile:
    def test_everything_a_file_can_say(self):
        scenario = parse_scenario(
            b"""
about: all of it
robots: 9
grid_step_m: 1e1
d_m: 8.5
goal_m: [-50, 5.5]
duration_s: 20
defence: paper
seed: 7
n_max: 8
contact_m: 0.5
attacks:
  - {name: spoof, robot: 2, at_s: 3, until_s: 4, options: {strong: 1}}
  - name: spoof
    until_s: ~
obstacles:
  - {x_m: 1, y_m: 2, radius_m: 3}
  - {left_m: 1, bottom_m: 2, right_m: 3, top_m: 4}
bti: {f_max: 2}
flock: {c1_beta: 1}
radio: {exponent: 2.5}
""",
            "dir/nine.yaml",
        )
        assert scenario == Scenario(
            name="nine",
            about="all of it",
            robots=9,
            grid_step_m=10.0,
            d_m=8.5,
            goal_m=(-50.0, 5.5),
            duration_s=20.0,
            defence="paper",
            seed=7,
            n_max=8,
            contact_m=0.5,
            attacks=(
                AttackSpec(name="spoof", robot=2, at_s=3.0, until_s=4.0, options={"strong": 1}),
                AttackSpec(name="spoof"),
            ),
            obstacles=(Disc(x_m=1, y_m=2, radius_m=3), Box(left_m=1, bottom_m=2, right_m=3, top_m=4)),
            bti=BtiConfig(f_max=2),
            flock=FlockConfig(c1_beta=1.0),
            radio=RadioConfig(exponent=2.5),
        )
        assert isinstance(scenario.d_m, float)
        assert isinstance(scenario.flock.c1_beta, float)

    @pytest.mark.parametrize(
        "text, line, what, allowed",
        [
            ("", 0, "empty", "robots"),
            ("# nothing\n", 0, "empty", "robots"),
            ("- robots\n", 1, "scenario is a list", "KEY: VALUE"),
            ("\nrobots: many\n", 2, "robots is 'many'", "a whole number"),
            ("robots: 2.5\n", 1, "robots is '2.5'", "a whole number"),
            ("robots: 0x10\n", 1, "robots is '0x10'", "a whole number"),
            ("robots: '9'\n", 1, "robots is '9'", "a whole number"),
            (f"robots: {'9' * 5000}\n", 1, f"robots is '{'9' * 40}…'", "a whole number"),
            ("seed: 1\nrobots: 0\n", 2, "0 robots", "1 to 65535"),
            ("seed: 1\nrobts: 9\n", 2, "no 'robts'", "did you mean robots? allowed: name"),
            ("robots: 9\nseed: 3\nrobots: 8\n", 3, "'robots' twice", "line 1"),
            ("defence: yes\n", 1, "defence is 'yes'", "none, paper, hardened"),
            ("name: 12\n", 1, "name is '12'", "text"),
            ("goal_m: [1]\n", 1, "goal_m is a list", "a list of 2 numbers"),
            ("goal_m: [1,\n   .nan]\n", 2, "goal_m is '.nan'", "a number"),
            ("goal_m: 5\n", 1, "goal_m is '5'", "a list of 2 numbers"),
            ("seed: ~\n", 1, "seed is '~'", "a whole number"),
            ("attacks: {}\n", 1, "attacks is a mapping", "a list"),
            ("attacks: [spof]\n", 1, "attacks[0] is 'spof'", "- name: spoof"),
            ("attacks:\n  - robot: 3\n", 2, "attacks[0] has no name", "needed: name"),
            ("attacks:\n  - robot: 2\n    name: spoff\n", 3, "no attack 'spoff'", "did you mean spoof?"),
            ("name: x\nattacks:\n  - name: spoof\n  - name: spoof\n    robot: 99\n", 5, "spoof in robot 99", "1 to 25"),
            (TWICE, 7, "two attacks in robot 2", "one attack per robot"),
            (
                "robots: 1\nattacks:\n  - name: spoof\n  - name: jam\n",
                4,
                "2 attacks for 1 robots",
                "one attack per robot",
            ),
            ("attacks:\n  - name: spoof\n    at_s: 9\n    until_s: 3\n", 4, "until_s is 3", "after 9 s"),
            ("attacks:\n  - name: spoof\n    options:\n      a: [1]\n", 4, "a is a list", "a number or text"),
            ("bti:\n  t_val_ms: 9000\n  f_max: 99\n", 3, "f_max is 99", "1 to 15"),
            ("bti:\n  n_max: 9\n", 2, "no 'n_max'", "write n_max beside bti, not below it"),
            ("robots: 9\ncontroller: own.py:Mine\n", 2, "no controller 'own.py:Mine'", "--controller own.py:Mine"),
            ("bti:\n  state_bytes: 9\n", 2, "no 'state_bytes'", "allowed: f_max"),
            ("flock:\n\n  d_m: 9\n", 3, "no 'd_m'", "write d_m beside flock, not below it"),
            ("radio:\n  tries: 3\n  mcs: 40\n", 3, "mcs is 40", "0 to 11"),
            ("radio:\n  tries: 3\n  sensitivity_dbm: 150\n  mcs: 3\n", 3, "radio range is", "check gain and loss"),
            ("bti:\n  f_max: 3\n  t_audit_ms: 9000\n  delta_ms: 9\n", 3, "t_val is 10 s", "1.5 times"),
            ("seed: 1\nrobots: 65535\ngrid_step_m: 1e4\nd_m: 5\n", 3, "the grid's edge", "0 to 1e+06"),
            ("obstacles:\n  - {x_m: 1, y_m: 2}\n", 2, "obstacles[0] has x_m, y_m", "x_m, y_m, radius_m or left_m"),
            ("robots: 9\nobstacles:\n  - {x_m: 1, y_m: 2, radius_m: 1}\n", 3, "obstacles have no effect", "c1_beta"),
            (AVOIDED + "  - x_m: 1\n    y_m: 2\n    radius_m: -1\n", 6, "radius_m is -1", "0 to 1e+06"),
            (AVOIDED + "  - {left_m: 4, bottom_m: 2,\n     right_m: 3, top_m: 4}\n", 5, "right_m is 3", "4 to 1e+06"),
            (AVOIDED + "  - {x_m: 1e7, y_m: 2, radius_m: 1}\n", 4, "disc's middle", "0 to 1e+06"),
            ("? [a]\n: b\n", 1, "a list in scenario is not a key", "use text"),
            ("robots: 9\n  seed: 3\n", 2, "not YAML", ""),
            ("goal_m: [1, 2\n", 1, "not YAML", ""),
            ("--- {}\n--- {}\n", 2, "not YAML", ""),
            ("robots: !!python/object/apply:os.system [ls]\n", 1, "robots is a list", "a whole number"),
            (b"seed: 1\nname: \xff\n", 2, "not UTF-8", "UTF-8"),
            (b"seed: \x00", 0, "not YAML", ""),
            (b"[" * 60_000, 1, "nested too deep", ""),
            (b"#" * (MOST_BYTES + 1), 0, "longer than 64 KiB", ""),
        ],
    )
    def test_a_mistake_is_told_with_file_line_and_what_is_allowed(self, text, line, what, allowed):
        found_line, complaint, hint = refused(text)
        assert found_line == line
        assert what in complaint
        assert allowed in hint

    def test_a_list_too_long_is_told_in_a_moment(self):
        line, what, _ = refused("attacks: [&a {name: spoof}" + ",*a" * 5_000 + "]\n")
        assert (line, what) == (1, "5001 attacks for 25 robots")

    @settings(max_examples=60, deadline=None)
    @given(st.binary(max_size=200) | st.text("{}[]:-,&*!|>'\"%@#? \nabrots:129e.~", max_size=200).map(str.encode))
    @example(b"&a [*a]")
    @example(b"attacks: &a [{name: spoof, options: *a}]")
    @example(b"<<: {robots: 3}")
    @example(b"a: &a [x]\nb: &b [*a,*a,*a]\nc: &c [*b,*b,*b]\nd: [*c,*c,*c]")
    def test_no_bytes_raise_anything_else(self, data):
        try:
            parse_scenario(data, "f.yaml")
        except UsageError as error:
            assert str(error).startswith("f.yaml")

    @settings(max_examples=30, deadline=None)
    @given(st.data())
    def test_a_good_file_with_a_few_bytes_changed_raises_nothing_else(self, data):
        text = bytearray((DATA / "scenarios" / "bti-fig9.yaml").read_bytes())
        for _ in range(data.draw(st.integers(1, 4))):
            text[data.draw(st.integers(0, len(text) - 1))] = data.draw(st.integers(0, 255))
        try:
            parse_scenario(bytes(text), "f.yaml")
        except UsageError as error:
            assert str(error).startswith("f.yaml")

    def test_a_file_that_is_not_there(self, tmp_path):
        with pytest.raises(UsageError, match="no file"):
            read_scenario(tmp_path / "none.yaml")
        with pytest.raises(UsageError, match="no scenario 'bti-fg9'") as error:
            find_scenario("bti-fg9")
        assert "did you mean bti-fig9?" in error.value.hint


class TestBuiltIn:
    def test_those_of_the_paper_are_as_in_the_paper(self):
        for name, defence in (("bti-fig8", "none"), ("bti-fig9", "hardened")):
            scenario = find_scenario(name)
            assert scenario == Scenario(name=name, about=scenario.about, defence=defence, attacks=(SPOOF,))
            assert max(map(max, scenario.starts_m)) == 100

    def test_each_is_named_as_its_file_and_says_what_it_shows(self):
        assert {"bti-fig8", "bti-fig9", "flock-12", "grid-324"} <= set(built_in("scenarios"))
        for name in built_in("scenarios"):
            scenario = find_scenario(name)
            assert scenario.name == name
            assert scenario.about

    def test_one_can_be_copied_and_run_from_a_file(self, tmp_path):
        path = tmp_path / "mine.yml"
        path.write_bytes((DATA / "scenarios" / "grid-324.yaml").read_bytes())
        assert find_scenario(str(path)) == find_scenario("grid-324")


class TestSchema:
    def test_the_committed_schema_is_what_the_code_gives(self):
        committed = json.loads((DATA / SCHEMA_NAME).read_text())
        assert committed == scenario_schema(), "run: phalanx sim schema > src/phalanx/data/scenario.schema.json"

    def test_the_built_in_files_point_at_it(self):
        for path in (DATA / "scenarios").glob("*.yaml"):
            target = re.match(r"# yaml-language-server: \$schema=(\S+)\n", path.read_text())[1]
            assert (path.parent / target).resolve() == (DATA / SCHEMA_NAME).resolve()

    def test_the_schema_allows_what_the_reader_allows(self):
        """Each key alone, with its default or something of its type: the reader takes it; an unknown one, it refuses."""
        properties = scenario_schema()["properties"]
        samples = {"integer": 5, "number": 5.5, "string": "hardened", "array": [], "object": {}}
        for key, shape in properties.items():
            value = shape.get("default", samples.get(shape.get("type"), 5))
            if key in ("goal_m", "area_m"):
                value = [1.0, 2.0]
            if key == "duration_s":
                value = 1
            parse_scenario(yaml.safe_dump({key: value}).encode(), "f.yaml")
            for wrong in [["x"], {"x": "y"}] if shape.get("type") not in ("array", "object") else [True, "x"]:
                refused(yaml.safe_dump({key: wrong}))

    def test_every_key_is_explained(self):
        schema = scenario_schema()
        sections = [schema, *(schema["properties"][name] for name in ("bti", "flock", "guard", "radio"))]
        sections.append(schema["properties"]["attacks"]["items"])
        for section in sections:
            for key, shape in section["properties"].items():
                assert shape.get("description"), key


class TestPage:
    PAGE = (Path(__file__).parent.parent / "docs" / "reference" / "scenarios.md").read_text()

    def test_its_example_is_a_scenario(self):
        (example,) = re.findall(r"^```yaml\n(.*?)^```$", self.PAGE, re.MULTILINE | re.DOTALL)
        scenario = parse_scenario(example.encode(), "nine.yaml")
        assert (scenario.robots, scenario.bti.f_max, len(scenario.obstacles)) == (9, 2, 1)
        assert scenario.attacks[0].name in IN_FLOCKS

    def test_its_words_on_reading_a_recording_read_one(self, tmp_path, monkeypatch, capsys):
        script = re.findall(r"^```python\n(.*?)^```$", self.PAGE, re.MULTILINE | re.DOTALL)[0]
        run_scenario(Scenario(robots=2, duration_s=1.0, defence="none"), tmp_path / "fig9.mcap")
        monkeypatch.chdir(tmp_path)
        exec(script, {})
        lines = capsys.readouterr().out.splitlines()
        assert {line.split()[1] for line in lines if line[0] != "{"} == {"/scene", "/tf"}, "without audits no verdicts"
        assert sum('"robots"' in line or "'robots'" in line for line in lines) == 5

    def test_its_table_has_every_key_and_the_true_defaults(self):
        rows = re.findall(r"^\| ([a-z_, ]+) \| .* \| (.*) \|$", self.PAGE, re.MULTILINE)
        keys = [key for names, _ in rows for key in names.split(", ")]
        properties = scenario_schema()["properties"]
        assert set(keys) - {"key"} == set(properties)
        for names, defaults in rows:
            for key, told in zip(names.split(", "), defaults.split(", ")):
                if "default" in properties.get(key, ()) and key not in ("name", "about"):
                    default = properties[key]["default"]
                    assert told == (default if isinstance(default, str) else f"{default:g}"), key

    def test_its_words_about_a_mistake_are_the_program_s(self):
        (shown,) = re.findall(r"phalanx: error: nine.yaml:3: (.*)\n", self.PAGE)
        with pytest.raises(UsageError) as error:
            parse_scenario(b"\n\nrobts: 9\n", "nine.yaml")
        assert str(error.value) == f"nine.yaml:3: {shown}"
        assert error.value.hint.startswith("did you mean robots? allowed: name, about, robots, ")
