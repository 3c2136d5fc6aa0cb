"""Rules for source files that no linter knows. Which package may import which: pyproject.toml, lint-imports."""

from __future__ import annotations

import ast
import functools
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SRC, COMPILER = ROOT / "src" / "phalanx", ROOT / "phalanx_compiler"
IMPURE = {"recording", "world", "net", "attacks", "gateway", "daemon", "papers", "lab", "bridges", "cli"}
LONGEST = 400
# What auditors replay of a mission knows no function whose last bit depends on a machine, or on a Python.
REPLAYED = ("mission/walk", "mission/pose", "robot/controllers/mission")
EXACT = {"sqrt", "radians", "isnan", "isfinite", "inf", "nan", "pi", "floor", "ceil"}


def modules():
    return sorted(SRC.rglob("*.py"))


def all_modules():
    return [*modules(), *sorted(COMPILER.glob("*.py"))]


@functools.cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def test_importing_phalanx_imports_nothing():
    # lint-imports ranks packages, and `phalanx` itself is above them all.
    imports = [each for each in ast.walk(parsed(SRC / "__init__.py")) if isinstance(each, ast.Import | ast.ImportFrom)]
    assert {each.module for each in imports if isinstance(each, ast.ImportFrom)} == {"typing", "importlib"}
    assert all(isinstance(each, ast.ImportFrom) for each in imports)


def test_protocols_do_not_wait():
    for path in (each for each in modules() if each.relative_to(SRC).parts[0] not in IMPURE):
        assert not any(isinstance(node, ast.AsyncFunctionDef | ast.Await) for node in ast.walk(parsed(path))), path


def test_files_hold_one_concept():
    long = {path.name: n for path in all_modules() if (n := len(path.read_text().splitlines())) > LONGEST}
    assert not long


def test_a_reading_passes_few_files_on_its_way_to_its_token():
    command = [sys.executable, str(ROOT / "scripts" / "files_of_a_reading.py"), "--names"]
    environment = os.environ | {"PHALANX_PURE": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_file_is_named_for_nothing():
    nothing = {"utils.py", "helpers.py", "common.py", "base.py", "misc.py"}
    assert not [path for path in all_modules() if path.name in nothing]


@pytest.mark.parametrize("folder", REPLAYED)
def test_what_is_replayed_of_a_mission_has_the_same_bits_everywhere(folder: str) -> None:
    for path in (SRC / folder).glob("*.py"):
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "math":
                assert node.attr in EXACT, f"{path.name}: math.{node.attr}"
