"""docs/own-controller.md: its layout is the byte table's, and its experiment runs."""

from __future__ import annotations

import os
import re
import struct
import subprocess
import sys

import pytest

from conftest import ROOT
from phalanx.wire.table import ACCELERATION, SENSOR, STATE

PAGE = (ROOT / "docs" / "own-controller.md").read_text()
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


def test_the_experiment_records_and_draws(tmp_path):
    pytest.importorskip("matplotlib")
    (code,) = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    (tmp_path / "experiment.py").write_text(code)
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
