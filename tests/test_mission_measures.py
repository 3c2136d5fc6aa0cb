"""Scripts that measure missions, or draw what is seen: they can fail, and they draw what others measured."""

from __future__ import annotations

import runpy
import sys
from types import SimpleNamespace

import pytest

from commands import ROOT
from phalanx.mission import Profile
from phalanx.world.missions.report import Report

SCANS = ROOT / "tests" / "data" / "scans"


def lived(robot: int, *, done: bool = True, false_fixes: int = 0) -> Report:
    report = Report(robot, done=done, t_s=500.0, false_fixes=false_fixes)
    report.pose_error_m, report.odometry_error_m = [0.1], [2.0]
    return report


@pytest.mark.parametrize(
    ("reports", "verdicts"),
    [
        ([lived(i) for i in range(50)], (True, True)),
        ([lived(i, done=i > 0) for i in range(50)], (True, True)),
        ([lived(i, done=i > 1) for i in range(50)], (False, True)),
        ([lived(i, false_fixes=i // 49) for i in range(50)], (True, False)),
    ],
    ids=["all well", "98 %", "96 %", "a false fix"],
)
def test_seeds_that_do_not_complete_the_mission_or_are_wrong_fail_the_benchmark(
    reports: list[Report], verdicts: tuple[bool, bool], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import bench_mission_run

    class Pool:
        def __init__(self, _count: int) -> None: ...

        def __enter__(self):
            return self

        def __exit__(self, *_: object) -> None: ...

        def map(self, _live: object, _seeds: range, chunksize: int) -> list[Report]:
            assert chunksize
            return reports

    monkeypatch.setattr(bench_mission_run, "get_context", lambda _: SimpleNamespace(Pool=Pool))
    rows = bench_mission_run.bench_seeds(Profile.PAPER, 50)
    assert tuple(row.holds for row in rows if row.limit is not None) == verdicts
    monkeypatch.setattr(sys, "argv", ["bench", "--seeds", "50"])
    assert bench_mission_run.main() == (0 if all(verdicts) else 1)
    assert ("EXCEEDED" in capsys.readouterr().out) == (not all(verdicts))


@pytest.mark.parametrize(
    "source", [SCANS / "pythonrobotics_lidar01.csv", SCANS / "hokuyo_handheld.npz", "office_40x40"]
)
def test_landmarks_are_drawn_of_a_scan_of_many_scans_and_of_a_map(source: object, tmp_path, monkeypatch) -> None:
    out = tmp_path / "out.png"
    monkeypatch.setattr(sys, "argv", ["plot_landmarks.py", str(source), str(out)])
    runpy.run_path(str(ROOT / "scripts" / "plot_landmarks.py"), run_name="__main__")
    assert out.read_bytes().startswith(b"\x89PNG")
    assert out.stat().st_size > 10_000
