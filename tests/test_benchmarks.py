"""`make bench` measures all that it claims to measure; how fast this machine is, no test says."""

from __future__ import annotations

import json
import math
import subprocess
import sys

import pytest

from commands import ROOT

pytestmark = [pytest.mark.waits, pytest.mark.slow]


@pytest.fixture(scope="module")
def report():
    done = subprocess.run(
        [sys.executable, "benchmarks/bench_link.py", "--quick", "--json"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=150,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.long
@pytest.mark.parametrize(
    ("section", "least", "words"),
    [
        (1, 2, ["the token", "the whole envelope"]),
        (2, 1, ["command to handler"]),
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
