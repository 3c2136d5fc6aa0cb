"""examples/research.ipynb: its cells run one after the other, and say what they say they do."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys

from commands import ROOT

NOTEBOOK = json.loads((ROOT / "examples" / "research.ipynb").read_text())
CODE = ["".join(cell["source"]) for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]


def test_it_is_a_notebook_without_outputs():
    assert (NOTEBOOK["nbformat"], NOTEBOOK["metadata"]["kernelspec"]["language"]) == (4, "python")
    for cell in NOTEBOOK["cells"]:
        assert set(cell) >= {"cell_type", "id", "metadata", "source"}
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None
    doors = re.findall(r"^(?:from|import) (phalanx\S*)", "\n".join(CODE), re.MULTILINE)
    assert set(doors) == {"phalanx.world", "phalanx.lab.tables"}
    assert len({cell["id"] for cell in NOTEBOOK["cells"]}) == len(NOTEBOOK["cells"])


def test_its_cells_run_in_order(tmp_path):
    (tmp_path / "cells.py").write_text("\n".join(CODE))
    paths = os.pathsep.join((str(ROOT / "examples"), os.environ.get("PYTHONPATH", "")))
    done = subprocess.run(
        [sys.executable, "cells.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": paths, "MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        timeout=500,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "led-astray.svg").read_text().startswith("<?xml")
    assert (tmp_path / "robots.parquet").read_bytes().startswith(b"PAR1")
