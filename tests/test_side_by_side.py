"""`make test` makes its parts at the same time, and says of each how it ended."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

from conftest import ROOT

MAKEFILE = """
good:
	@echo one; sleep 0.5; echo two
bad:
	@echo three; sleep 0.2; echo four; exit 3
long:
	@sleep 60 & echo $$! > pid; wait
"""


def side_by_side(folder, *targets):
    (folder / "Makefile").write_text(MAKEFILE)
    return subprocess.Popen(
        [sys.executable, ROOT / "scripts" / "side_by_side.py", *targets], stdout=subprocess.PIPE, text=True, cwd=folder
    )


def lives(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_each_is_told_of_in_one_piece_and_the_failing_one_is_named(tmp_path):
    making = side_by_side(tmp_path, "good", "bad")
    out, _ = making.communicate(timeout=60)
    assert making.returncode == 1
    assert "one\ntwo\n" in out
    assert "three\nfour\n" in out
    ends = out.splitlines()[-2:]
    assert [line.split(",")[0] for line in ends] == ["good: passed", "bad: FAILED"]


def test_all_well_is_exit_0(tmp_path):
    making = side_by_side(tmp_path, "good")
    making.communicate(timeout=60)
    assert making.returncode == 0


def test_ctrl_c_ends_all(tmp_path):
    making = side_by_side(tmp_path, "long", "good")
    while not ((pid := tmp_path / "pid").exists() and pid.read_text().endswith("\n")):
        time.sleep(0.05)
    making.send_signal(signal.SIGINT)
    making.communicate(timeout=60)
    assert making.returncode == 130
    deadline = time.monotonic() + 10
    while lives(int(pid.read_text())):
        assert time.monotonic() < deadline
        time.sleep(0.05)
