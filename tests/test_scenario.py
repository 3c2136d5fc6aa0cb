"""Scenarios: what they may say, where a mistake is, and that a file says no more and no less than the schema."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

import phalanx
from phalanx.config import BtiConfig
from phalanx.config.flock import Box, Disc, FlockConfig
from phalanx.config.radio import RadioConfig
from phalanx.errors import UsageError
from phalanx.robot.attacks import ATTACKS
from phalanx.sim.scenario import AttackSpec, Scenario, parse_attack
from phalanx.sim.scenario_file import (
    MOST_BYTES,
    SCHEMA_NAME,
    built_in_names,
    find_scenario,
    parse_scenario,
    read_scenario,
    scenario_schema,
)

DATA = Path(phalanx.__file__).parent / "data"
SPOOF = AttackSpec(name="spoof")


def refused(text: str | bytes) -> tuple[int, str, str]:
    """Line, complaint and hint of a file's first mistake."""
    with pytest.raises(UsageError) as error:
        parse_scenario(text if isinstance(text, bytes) else text.encode(), "f.yaml")
    place, line, what = re.fullmatch(r"(f\.yaml)(?::(\d+))?: (.*)", str(error.value), re.DOTALL).groups()
    assert place == "f.yaml"
    return int(line or 0), what, error.value.hint


class TestScenario:
    def test_robots_stand_on_a_square_grid_row_by_row(self):
        starts = Scenario().starts_m
        assert starts.shape == (25, 2)
        assert starts[0].tolist() == [0, 0]
        assert starts[1].tolist() == [25, 0]
        assert starts[5].tolist() == [0, 25]
        assert starts[-1].tolist() == [100, 100]

    @pytest.mark.parametrize("robots, edge", [(1, 1), (2, 2), (4, 2), (5, 3), (324, 18), (325, 19)])
    def test_the_last_row_may_be_short_but_nobody_shares_a_place(self, robots, edge):
        scenario = Scenario(robots=robots)
        assert scenario.robots_per_edge == edge
        assert len({tuple(start) for start in scenario.starts_m.tolist()}) == robots
        assert scenario.starts_m.max() <= (edge - 1) * scenario.grid_step_m

    def test_neighbours_provided_for_are_those_in_range_and_half_as_many_again(self):
        assert Scenario().bti.n_max == 24, "all others are in range"
        sparse = Scenario(robots=324, grid_step_m=64.0, bti=BtiConfig(f_max=2))
        assert sparse.bti.n_max == math.ceil(1.5 * math.pi * (116.33 / 64) ** 2) + 4
        assert Scenario(robots=1000, grid_step_m=2.0).bti.n_max == 340
        assert Scenario(robots=2).bti.n_max == BtiConfig().f_max + 1
        assert Scenario(n_max=9).bti.n_max == 9

    def test_the_flock_agrees_with_its_scenario(self):
        scenario = Scenario(
            goal_m=(1.0, 2.0),
            d_m=7.0,
            obstacles=(Disc(x_m=1, y_m=2, radius_m=3), Box(left_m=0, bottom_m=0, right_m=1, top_m=1)),
            flock=FlockConfig(c1_beta=1.0),
            bti=BtiConfig(steps_per_state=3),
        )
        flock = scenario.flock
        assert (flock.goal_m, flock.d_m, flock.n_max, flock.state_every) == ((1.0, 2.0), 7.0, 24, 3)
        assert (len(flock.discs), len(flock.boxes), flock.c1_beta) == (1, 1, 1.0)

    @pytest.mark.parametrize(
        "wrong, complaint",
        [
            ({"robots": 0}, "0 robots"),
            ({"robots": 65_536}, "65536 robots"),
            ({"grid_step_m": 0.0}, "grid_step_m is 0"),
            ({"grid_step_m": math.nan}, "grid_step_m is nan"),
            ({"robots": 65_535, "grid_step_m": 1e4}, "the grid's edge"),
            ({"d_m": -1.0}, "d_m is -1"),
            ({"goal_m": (math.inf, 0.0)}, "goal_m is inf"),
            ({"duration_s": 0.0}, "duration_s is 0"),
            ({"defence": "prayer"}, "no defence 'prayer'"),
            ({"controller": "ants"}, "no controller 'ants'"),
            ({"seed": -1}, "seed is -1"),
            ({"seed": 1 << 32}, "seed is 4294967296"),
            ({"contact_m": -1.0}, "contact_m is -1"),
            ({"n_max": 3}, "n_max is 3"),
            ({"attacks": (AttackSpec(name="spoof", robot=26),)}, "spoof in robot 26"),
            ({"attacks": (AttackSpec(name="spoof", robot=3),) * 2}, "two attacks in robot 3"),
            ({"attacks": (SPOOF,) * 3, "robots": 2}, "3 attacks and 2 robots"),
            ({"attacks": (AttackSpec(name="spoff"),)}, "no 'spoff'"),
            ({"obstacles": (Disc(x_m=0, y_m=0, radius_m=1),)}, "nobody avoids them"),
        ],
    )
    def test_what_is_out_of_range_is_refused(self, wrong, complaint):
        with pytest.raises(UsageError, match=re.escape(complaint)) as error:
            Scenario(**wrong)
        assert error.value.hint

    def test_robots_to_compromise_are_drawn_by_the_seed_and_never_twice(self):
        attacks = (AttackSpec(name="spoof", robot=4), *(SPOOF,) * 24)
        drawn = [attack.robot for attack in Scenario(attacks=attacks).drawn_attacks()]
        assert drawn[0] == 4
        assert sorted(drawn) == list(range(1, 26))
        one = [Scenario(attacks=(SPOOF,), seed=seed).drawn_attacks()[0].robot for seed in range(300)]
        assert one == [Scenario(attacks=(SPOOF,), seed=seed).drawn_attacks()[0].robot for seed in range(300)]
        # A fair draw leaves one of 25 out in 300 tries with a chance of 25 * 0.96^300 = 0.0001.
        assert set(one) == set(range(1, 26))
        assert max(np.bincount(one)) < 30

    def test_the_draw_is_the_same_in_every_version(self):
        # From the shell: sha256sum of `compromised 1 ROBOT`, the three smallest.
        drawn = Scenario(attacks=(SPOOF,) * 3, seed=1).drawn_attacks()
        assert [attack.robot for attack in drawn] == [13, 14, 8]


class TestOptions:
    def test_options_change_what_they_say_and_nothing_else(self):
        before = Scenario(seed=3, goal_m=(9.0, 9.0))
        after = before.with_options(robots=324, spacing_m=64.0, duration_s=5.0, f_max=2, t_audit_s=2.5, t_val_s=8.0)
        assert (after.robots, after.grid_step_m, after.d_m, after.duration_s) == (324, 64, 64, 5)
        assert (after.bti.f_max, after.bti.t_audit_ms, after.bti.t_val_ms, after.bti.n_max) == (2, 2500, 8000, 20)
        assert (after.seed, after.goal_m, after.flock.d_m) == (3, (9.0, 9.0), 64)
        assert before.with_options() == before

    def test_neighbours_are_worked_out_again(self):
        few = Scenario(robots=2)
        assert few.with_options(f_max=8).bti.n_max == 9
        assert few.with_options(robots=200).bti.n_max == 107, "68.02 in range"

    def test_audits_too_rare_for_their_tokens_are_refused(self):
        with pytest.raises(UsageError, match="tokens count for 10000 ms"):
            Scenario().with_options(t_audit_s=8)


class TestAttackWords:
    def test_a_name_alone(self):
        assert parse_attack("spoof") == AttackSpec(name="spoof", robot=None, at_s=15.0, until_s=None, options={})

    def test_robot_times_and_the_attack_s_own_options(self):
        assert parse_attack("spoof:robot=7,at=1.5,until=20,variant=strong,every=0.5") == AttackSpec(
            name="spoof", robot=7, at_s=1.5, until_s=20.0, options={"variant": "strong", "every": 0.5}
        )

    @pytest.mark.parametrize(
        "words",
        """:
        :at=3
        spoof:
        spoof:at
        spoof:at=
        spoof:=3
        spoof:at=3,
        spoof:at=1,at=2
        spoof:at=x
        spoof:robot=x
        spoof:robot=1.5
        spoof:at=-1
        spoof:at=5,until=5
        spoof:until=nan
        spoof:at=inf""".split(),
    )
    def test_what_is_not_of_the_form_is_refused_with_the_form(self, words):
        with pytest.raises(UsageError) as error:
            parse_attack(words)
        assert error.value.hint

    @given(st.text(max_size=40))
    def test_no_words_raise_anything_else(self, words):
        try:
            attack = parse_attack(words)
        except UsageError:
            return
        assert words.startswith(attack.name)


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
  - {name: spoof, robot: 2, at_s: 3, until_s: 4, options: {variant: strong, every_s: 0.5}}
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
                AttackSpec(name="spoof", robot=2, at_s=3.0, until_s=4.0, options={"variant": "strong", "every_s": 0.5}),
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
            ("defence: yes\n", 1, "defence is 'yes'", "none, paper, bound"),
            ("name: 12\n", 1, "name is '12'", "text"),
            ("goal_m: [1]\n", 1, "goal_m is a list", "a list of 2 numbers"),
            ("goal_m: [1,\n   .nan]\n", 2, "goal_m is '.nan'", "a number"),
            ("goal_m: 5\n", 1, "goal_m is '5'", "a list of 2 numbers"),
            ("seed: ~\n", 1, "seed is '~'", "a whole number"),
            ("attacks: {}\n", 1, "attacks is a mapping", "a list"),
            ("attacks:\n  - robot: 3\n", 2, "attacks[0] has no name", "needed: name"),
            ("attacks:\n  - name: spoff\n", 1, "no 'spoff'", "did you mean spoof?"),
            ("attacks:\n  - name: spoof\n    at_s: 9\n    until_s: 3\n", 4, "until_s is 3", "later than 9"),
            ("attacks:\n  - name: spoof\n    options:\n      a: [1]\n", 4, "a is a list", "a number or text"),
            ("bti:\n  t_val_ms: 9000\n  f_max: 99\n", 3, "f_max is 99", "1 to 15"),
            ("bti:\n  n_max: 9\n", 2, "no 'n_max'", "allowed: f_max"),
            ("flock:\n\n  d_m: 9\n", 3, "no 'd_m'", "allowed: kappa"),
            ("radio:\n  tries: 3\n  mcs: 40\n", 3, "mcs is 40", "0 and 11"),
            ("obstacles:\n  - {x_m: 1, y_m: 2}\n", 2, "obstacles[0] has x_m, y_m", "x_m, y_m, radius_m or left_m"),
            ("robots: 9\nobstacles:\n  - {x_m: 1, y_m: 2, radius_m: 1}\n", 2, "nobody avoids them", "c1_beta"),
            ("? [a]\n: b\n", 1, "a list in scenario is not a key", "a word"),
            ("robots: 9\n  seed: 3\n", 2, "not YAML", ""),
            ("goal_m: [1, 2\n", 2, "not YAML", ""),
            ("--- {}\n--- {}\n", 2, "not YAML", ""),
            ("robots: !!python/object/apply:os.system [ls]\n", 1, "robots is a list", "a whole number"),
            (b"seed: 1\nname: \xff\n", 2, "not UTF-8", "UTF-8"),
            (b"seed: \x00", 0, "not YAML", ""),
            (b"[" * 60_000, 0, "not YAML", ""),
            (b"#" * (MOST_BYTES + 1), 0, "longer than 64 KiB", ""),
        ],
    )
    def test_a_mistake_is_told_with_file_line_and_what_is_allowed(self, text, line, what, allowed):
        found_line, complaint, hint = refused(text)
        assert found_line == line
        assert what in complaint
        assert allowed in hint

    @settings(max_examples=300, deadline=None)
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

    @settings(max_examples=100, deadline=None)
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
        for name, defence in (("bti-fig8", "none"), ("bti-fig9", "bound")):
            scenario = find_scenario(name)
            assert scenario == Scenario(name=name, about=scenario.about, defence=defence, attacks=(SPOOF,))
            assert scenario.starts_m.max() == 100

    def test_each_is_named_as_its_file_and_says_what_it_shows(self):
        assert {"bti-fig8", "bti-fig9", "flock-12", "grid-324"} <= set(built_in_names())
        for name in built_in_names():
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
        samples = {"integer": 5, "number": 5.5, "string": "bound", "array": [], "object": {}}
        for key, shape in properties.items():
            value = shape.get("default", samples.get(shape.get("type"), 5))
            if key == "goal_m":
                value = [1.0, 2.0]
            if key == "duration_s":
                value = 1
            parse_scenario(yaml.safe_dump({key: value}).encode(), "f.yaml")
            for wrong in [["x"], {"x": "y"}] if shape.get("type") not in ("array", "object") else [True, "x"]:
                refused(yaml.safe_dump({key: wrong}))

    def test_every_key_is_explained(self):
        schema = scenario_schema()
        sections = [schema, *(schema["properties"][name] for name in ("bti", "flock", "radio"))]
        sections.append(schema["properties"]["attacks"]["items"])
        for section in sections:
            for key, shape in section["properties"].items():
                assert shape.get("description"), key


class TestPage:
    PAGE = (Path(__file__).parent.parent / "docs" / "scenarios.md").read_text()

    def test_its_example_is_a_scenario(self):
        (example,) = re.findall(r"^```yaml\n(.*?)^```$", self.PAGE, re.MULTILINE | re.DOTALL)
        scenario = parse_scenario(example.encode(), "nine.yaml")
        assert (scenario.robots, scenario.bti.f_max, len(scenario.obstacles)) == (9, 2, 1)
        assert scenario.attacks[0].name in ATTACKS

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
