"""Mistakes made by rule in the auditor are found by its tests: some here, all of them in the long check."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

HERE = Path(__file__).parent


def score(*options: str) -> str:
    words = [sys.executable, str(HERE / "mutate.py"), *options]
    done = subprocess.run(words, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    print(done.stdout.splitlines()[-1])
    return done.stdout


@pytest.mark.timeout(1200)
def test_some_mistakes_are_found():
    said = score("--take", "8", "--seed", "1")
    found, of, equal = map(int, re.search(r"(\d+) of (\d+) mistakes found; (\d+) more", said).groups())
    assert found == of == 8 - equal


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_all_mistakes_are_found_or_change_nothing():
    found, of = map(int, re.search(r"(\d+) of (\d+) mistakes found", score()).groups())
    assert found == of > 500
