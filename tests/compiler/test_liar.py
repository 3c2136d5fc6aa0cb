"""A flock with a liar, and a mission, give the same events byte for byte compiled and with PHALANX_PURE=1."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent


def events(folder, pure):
    path = folder / f"events-{pure}"
    env = os.environ | {"PHALANX_PURE": pure}
    done = subprocess.run(
        [sys.executable, HERE / "events.py", path], env=env, capture_output=True, text=True, check=True
    )
    return done.stdout.split()[0], path.read_text().split("\n")


def test_a_liar_and_a_mission_give_the_same_events_both_ways(tmp_path):
    (how, compiled), (other, uncompiled) = events(tmp_path, "0"), events(tmp_path, "1")
    assert (how, other) == ("compiled", "uncompiled")
    kinds = {line.split()[2] for line in compiled}
    assert {"body", "packet", "verdict", "chain", "token", "mission", "outcome"} <= kinds
    differing = next((pair for pair in zip(compiled, uncompiled, strict=False) if pair[0] != pair[1]), None)
    assert differing is None
    assert len(compiled) == len(uncompiled)
