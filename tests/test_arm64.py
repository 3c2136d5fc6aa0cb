"""The same scenarios give the same digests on an emulated aarch64 as here: a wheel that zig compiled, under QEMU."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent.parent / "scripts"))
import arm64

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]
LIARS = {
    "flock": ("bti-fig9", "--duration", "30"),
    "ring": ("ring-25", "--duration", "20", "--attack", "equivocate:robot=2,at=4"),
    "protocol": ("perimeter", "--duration", "20", "--attack", "spoof:robot=2,at=4"),
}


@pytest.fixture(scope="module")
def machine(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm64")
    arm64.set_up(folder)
    return folder


def summary(words, command, env=None):
    done = subprocess.run(
        [*command, "sim", "run", *words, "--json"], env=env, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


@pytest.mark.parametrize("name", LIARS)
def test_runs_with_liars_have_the_same_digest_on_another_processor(name, machine):
    command, env = arm64.command(machine)
    there = summary(LIARS[name], command, env)
    here = summary(LIARS[name], [sys.executable, "-m", "phalanx"])
    assert here["compromised"][0]["first_deviation_s"] is not None
    assert there["digest"] == here["digest"]
