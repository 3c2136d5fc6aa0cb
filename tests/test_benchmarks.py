"""`make bench` measures all that it claims to measure; how fast this machine is, no test says."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
import sys

import pytest

from conftest import ROOT

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture(scope="module")
def report():
    assert shutil.which("chromium"), "apt-get install chromium"
    done = subprocess.run(
        [sys.executable, "benchmarks/bench_link.py", "--quick", "--json"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=150,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    ("section", "least", "words"),
    [
        (1, 2, ["the token", "the whole envelope"]),
        (2, 1, ["command to handler"]),
        (
            3,
            6,
            [
                "gateway,",
                "updates of the whole swarm",
                "animation frames",
                "the map looks different",
                "opened every frame",
                "memory",
            ],
        ),
    ],
)
def test_each_limit_has_its_rows_and_each_row_a_number(report, section, least, words):
    rows = [row for row in report["rows"] if row["section"] == section]
    assert len(rows) >= least
    for row in rows:
        assert math.isfinite(row["measured"])
        assert row["measured"] >= 0
        assert row["limit"] is None or row["holds"] == (
            row["measured"] >= row["limit"] if row["at_least"] else row["measured"] <= row["limit"]
        )
    for word in words:
        assert any(word in row["what"] for row in rows), word


def test_the_swarm_was_really_watched(report):
    rows = {row["what"]: row for row in report["rows"]}
    assert rows["updates of the whole swarm, as visitors saw them"]["measured"] > 0
    assert rows["rejected by visitors"]["measured"] == 0
    (memory,) = (row for what, row in rows.items() if "memory" in what)
    assert memory["limit"] is None, "seconds say nothing about memory"
