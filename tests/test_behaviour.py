"""The recorded behaviour of whole runs holds, and a change of it is found and located (tests/behaviour)."""

from __future__ import annotations

import ast
import subprocess
import sys
from dataclasses import replace

import pytest

from behaviour import digest
from behaviour.cases import (
    BENCHMARKS,
    ERRAND_ATTACKS,
    FILE_ATTACKS,
    FLOCK_ATTACKS,
    PROTOCOL_ATTACKS,
    QUICK,
    SCENARIOS,
    TEAM_ATTACKS,
    all_cases,
)
from commands import ROOT
from phalanx.config.builtin import built_in
from phalanx.robot.adversary.registry import attacks

CASES = all_cases()
ORACLE = [sys.executable, str(ROOT / "scripts" / "oracle.py")]
LINES = ["inputs scenario {}", "0 50000 stop 0 -", "0 60000 stop 2 -", "0 70000 verdict 1 020000000300000005000000"]


def check(name: str) -> None:
    case = CASES[name]
    found = digest.first_difference(case, digest.load(case.group).get(name), digest.digests_of(case))
    hint = f"scripts/oracle.py compare TREE_BEFORE {ROOT} {name} shows the first event"
    assert found is None, f"{found}; {hint}"


@pytest.mark.parametrize("name", sorted(QUICK))
def test_a_quick_case_behaves_as_recorded(name):
    check(name)


@pytest.mark.long
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if not case.is_quick])
def test_every_other_case_behaves_as_recorded(name):
    check(name)


def test_all_bundled_scenarios_missions_and_attacks_are_cases():
    assert set(SCENARIOS) == set(built_in("scenarios"))
    missions = {case.inputs.get("mission") for case in CASES.values()} - {None}
    assert missions == set(built_in("missions"))
    assert {*FLOCK_ATTACKS, *PROTOCOL_ATTACKS, *ERRAND_ATTACKS, *FILE_ATTACKS, *TEAM_ATTACKS} == set(attacks())


def test_all_swarms_of_the_benchmark_are_cases():
    tree = ast.parse((ROOT / "benchmarks" / "bench_bti.py").read_text())
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func) == "Swarm"]
    sizes = {tuple(ast.literal_eval(each) for each in call.args[:4]) for call in calls}
    assert sizes == {row[:4] for row in BENCHMARKS}


def test_each_recording_is_of_a_known_case_and_of_a_clean_tree():
    recorded = {
        name: told for group in {case.group for case in CASES.values()} for name, told in digest.load(group).items()
    }
    assert list(recorded.keys() - CASES.keys()) == []
    assert [name for name, told in recorded.items() if told["commit"].endswith("-dirty")] == []


def test_a_run_that_differs_is_reported_with_its_first_second_and_category():
    case = CASES["scenario/flock-12"]
    short = replace(case, inputs={**case.inputs, "duration_s": 2})
    recorded = {"inputs": short.inputs, "worlds": digest.digests_of(short)}
    assert digest.first_difference(short, recorded, digest.digests_of(short)) is None
    other = replace(short, inputs={**short.inputs, "goal_m": (100.0, 61.0)})
    found = str(digest.first_difference(short, recorded, digest.digests_of(other)))
    assert found.startswith("scenario/flock-12: second 1: bodies differ")
    assert "recorded with other inputs" in str(digest.first_difference(other, recorded, []))


def tree_that_prints(folder, lines: list[str]) -> str:
    (folder / "src" / "phalanx").mkdir(parents=True)
    (folder / "scripts").mkdir()
    (folder / "scripts" / "oracle.py").write_text(f"print({chr(10).join(lines)!r})")
    return str(folder)


def compared(one: str, other: str) -> subprocess.CompletedProcess[str]:
    words = [*ORACLE, "compare", one, other, "scenario/flock-12"]
    return subprocess.run(words, capture_output=True, text=True, check=False)


def test_two_trees_are_compared_event_by_event(tmp_path):
    one = tree_that_prints(tmp_path / "one", LINES)
    same = tree_that_prints(tmp_path / "same", LINES)
    shorter = tree_that_prints(tmp_path / "shorter", LINES[:-1])
    other = tree_that_prints(tmp_path / "other", [*LINES[:2], "0 60000 stop 3 -", LINES[3]])
    assert compared(one, same).stdout == "all 4 lines agree\n"
    assert "ends here" in compared(one, shorter).stdout
    told = compared(one, other)
    assert told.returncode == 1
    assert told.stdout.startswith("2 lines agree")
    assert "0.060000 s  stop  robot 3" in told.stdout
    assert "0.060000 s  stop  robot 4" in told.stdout


def test_the_command_refuses_a_case_that_does_not_exist():
    told = subprocess.run([*ORACLE, "check", "scenario/none-such"], capture_output=True, text=True, check=False)
    assert told.returncode == 1
    assert told.stderr == "no case 'scenario/none-such'; scripts/oracle.py list shows them\n"
