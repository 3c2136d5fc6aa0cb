"""Logs of real lasers: surveyed, then lived; here of a robot that drives the same way twice through our office."""

from __future__ import annotations

import json
import math
import sys
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from commands import ROOT
from phalanx.config.lidar import LidarConfig
from phalanx.mission.landmarks.lidar import Lidar
from phalanx.papers.missions.drive import PATH_M, SPEED_MPS, poses_along
from phalanx.world.building.floorplan import load_floorplan
from scripts import loaded

EVERY, TICKS = 5, 500  # a scan each half second, for fifty


@pytest.fixture(scope="module")
def lasers():
    return loaded(ROOT / "scripts" / "mission_lasers.py")


def log_of(path: Path, wheels: float = 1.01) -> Path:
    """A log as gmapping writes it: after each scan, odometry goes on from the scan's corrected pose."""
    plan, chance = load_floorplan("office_40x40"), np.random.default_rng(0)
    lidar = Lidar(plan.walls, LidarConfig(beams=360, fov_rad=math.pi))
    lines, here = ["# message formats defined: PARAM SYNC ODOM FLASER"], None
    for _ in range(2):
        for tick, ((x, y, heading), (way, turn)) in enumerate(islice(poses_along(plan, PATH_M, SPEED_MPS), TICKS)):
            if here is not None and tick:
                a, b, c = here
                here = a + wheels * way * math.cos(c + turn / 2), b + wheels * way * math.sin(c + turn / 2), c + turn
                lines.append("ODOM {} {} {} 0 0 0 0.5 robot 0.5".format(*here))
            if tick % EVERY == 0:
                ranges = np.where(np.isfinite(seen := lidar.sweep((x, y, heading), chance).ranges_m), seen, 81.91)
                told = " ".join(f"{value:.2f}" for value in ranges)
                lines.append(f"FLASER 360 {told} {x} {y} {heading} {x} {y} {heading} 0.5 robot 0.5")
                lines.append(f"ODOM {x} {y} {heading} 0 0 0 0 robot 0")
                here = x, y, heading
    path.write_text("\n".join(lines))
    return path


def test_what_was_surveyed_is_decoded_when_the_robot_comes_again(lasers, tmp_path, monkeypatch, capsys):
    log = log_of(tmp_path / "office.log")
    assert lasers.read(log)[-1].moved[0] > 1.005 * math.dist(*(s.pose[:2] for s in lasers.read(log)[-2:]))
    monkeypatch.setattr(sys, "argv", ["lasers", str(log), "--json", "--picture", str(tmp_path / "paths.png")])
    assert lasers.main() == 0
    row = json.loads(capsys.readouterr().out)
    assert row["scans"] == TICKS // EVERY
    assert row["decoded"] >= 3
    assert row["false_fixes"] == 0
    assert row["error_m_max"] < 0.3
    assert (tmp_path / "paths.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("text", "words"), [("ODOM 1 2", "x.log:1: no line of"), ("PARAM a b", "0 scans"), ("", "0 scans")]
)
def test_what_is_no_log_is_told_in_a_line(lasers, tmp_path, text, words):
    (tmp_path / "x.log").write_text(text)
    with pytest.raises(SystemExit, match=words):
        lasers.read(tmp_path / "x.log")
