"""docs/guides/own-controller.md: its layout is the byte table's, and its code runs."""

from __future__ import annotations

import ast
import dataclasses
import os
import re
import struct
import subprocess
import sys

import pytest

from commands import ROOT
from phalanx.cli.main import run_command
from phalanx.robot import Command, Reading, State
from phalanx.wire.table import ACCELERATION, SENSOR, STATE

PAGE = (ROOT / "docs" / "guides" / "own-controller.md").read_text()
LETTERS = {"u8": "B", "u16": "H", "u64": "Q", "f32": "f"}


@pytest.mark.parametrize("column, record", [(2, SENSOR), (3, STATE), (4, ACCELERATION)])
def test_the_layout_is_the_byte_table_s(column, record):
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]] for line in re.findall(r"^\| \d+ \|.*$", PAGE, re.MULTILINE)
    ]
    told = [row for row in rows if row[column]]
    assert told[0][column] == f"0x{record.tag:02X}"
    assert [row[1] for row in told[1:]] == [field.type for field in record.fields]
    form = "<" + "".join(LETTERS[row[1]] for row in told)
    assert f"`{form}`" in PAGE
    assert struct.calcsize(form) == record.size
    assert [int(row[0]) for row in told] == [struct.calcsize(form[: k + 1]) for k in range(len(told))]


FIRST, EXPERIMENT = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def test_the_first_controller_runs_and_can_be_audited(tmp_path, monkeypatch):
    (tmp_path / "first.py").write_text(FIRST)
    monkeypatch.chdir(tmp_path)
    assert run_command(["sim", "run", "flock-12", "--duration", "5", "--controller", "first.py"]) == 0
    assert run_command(["sim", "check", "first.py"]) == 0


def test_the_example_is_short():
    text = (ROOT / "examples" / "own_controller.py").read_text()
    (memory, controller) = (node for node in ast.parse(text).body if isinstance(node, ast.ClassDef))
    docstrings = sum(
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) for node in ast.walk(ast.parse(text))
    )
    lines = {node.lineno for each in (memory, controller) for node in ast.walk(each) if hasattr(node, "lineno")}
    assert 10 < len(lines) - docstrings + 1 <= 25


@pytest.mark.parametrize("kind", [Reading, Command, State], ids=lambda kind: kind.__name__)
def test_the_page_has_the_fields_of_the_dataclasses(kind):
    (row,) = re.findall(rf"^\| `{kind.__name__}` \|(.*?)\|", PAGE, re.MULTILINE)
    told = re.findall(r"`(\w+)`", row)
    filled_in = ["id", "t"] if kind is Command else []
    assert sorted(told + filled_in) == sorted(field.name for field in dataclasses.fields(kind))


def test_the_experiment_records_and_draws(tmp_path):
    pytest.importorskip("matplotlib")
    (tmp_path / "experiment.py").write_text(EXPERIMENT)
    paths = os.pathsep.join((str(ROOT / "examples"), os.environ.get("PYTHONPATH", "")))
    done = subprocess.run(
        [sys.executable, "experiment.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    honest, audited, bare = done.stdout.splitlines()[::2]
    assert done.stdout.splitlines()[1::2] == ["    stopped by mistake: [], for want of a quorum: []"] * 3
    assert honest.endswith("from the goal, []")
    assert re.search(r"'safe_mode_s': \d+", audited)
    assert "'safe_mode_s': None" in bare
    honest_m, audited_m, bare_m = (int(re.search(r": (\d+) m from", line)[1]) for line in (honest, audited, bare))
    assert abs(audited_m - honest_m) <= 3
    assert bare_m > 1.8 * honest_m, "one sees the point"
    assert (tmp_path / "own.mcap").read_bytes().startswith(b"\x89MCAP0")
    assert (tmp_path / "own.png").read_bytes().startswith(b"\x89PNG")
