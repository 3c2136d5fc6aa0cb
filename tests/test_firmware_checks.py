"""What is too long for every run: proofs at their larger sizes, and ten minutes of any calls and any bytes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).parent.parent / "firmware"


def run(*words: str) -> str:
    done = subprocess.run([sys.executable, *words], cwd=FIRMWARE, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_all_proofs_hold_and_each_can_fail():
    said = run("prove.py", "--all")
    assert "can fail" in said
    assert "DOES NOT HOLD" not in said


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_ten_minutes_of_anything_find_nothing():
    done = subprocess.run(["make", "fuzz", "FUZZ_S=600"], cwd=FIRMWARE, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "any calls: nothing found" in done.stdout
