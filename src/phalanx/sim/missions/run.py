"""A mission run: robots that know only the encoded graph, from their start until done, held or out of time.

Robots do not hinder each other (each sees the building and who walks there, not the others), and what is drawn for one
depends on the seed and its number alone. Those that cannot hear each other each live in a world of their own, so the
digest of a run is the same however many processes share the work.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Sequence
from multiprocessing import get_context
from typing import Any

from .report import Report, figures
from .setup import MissionRun
from .world import MissionWorld

CHUNK_S = 2.0


def run_mission(
    run: MissionRun, workers: int = 1, on_progress: Callable[[float], None] = lambda _share: None
) -> list[Report]:
    """What became of each robot.

    Args:
        workers: processes that share robots which cannot hear each other.
        on_progress: called with the share of the work that is done; of the first process's robots.
    """
    if not run.alone:
        return _live(run, range(run.robots), on_progress)
    workers = max(1, min(workers, run.robots))
    if workers == 1:
        return _each(run, range(run.robots), on_progress)
    shares = [range(k, run.robots, workers) for k in range(workers)]
    # Ctrl-C is for whoever called; leaving the block ends the others.
    with get_context("spawn").Pool(workers - 1, signal.signal, (signal.SIGINT, signal.SIG_IGN)) as pool:
        others = [pool.apply_async(_each, (run, share)) for share in shares[1:]]
        reports = _each(run, shares[0], on_progress)
        for other in others:
            reports += other.get()
    return sorted(reports, key=lambda report: report.robot)


def _each(run: MissionRun, numbers: range, on_progress: Callable[[float], None] = lambda _share: None) -> list[Report]:
    """The reports of these robots, each of which lives by itself."""

    def live(done: int, number: int) -> Report:
        (report,) = _live(run, (number,), lambda share: on_progress((done + share) / len(numbers)))
        return report

    return [live(*each) for each in enumerate(numbers)]


def _live(run: MissionRun, numbers: Sequence[int], on_progress: Callable[[float], None]) -> list[Report]:
    """The reports of these robots, who live in one world."""
    world = MissionWorld(run, numbers)
    now_s = 0.0
    while now_s < run.duration_s and not world.over:
        now_s = min(now_s + CHUNK_S, run.duration_s)
        world.advance(now_s)
        on_progress(now_s / run.duration_s)
    on_progress(1.0)
    return world.finish()


def summary(run: MissionRun, reports: list[Report]) -> dict[str, Any]:
    """A run in figures, as `phalanx mission run --json` prints them."""
    audits = {
        "passed": sum(report.audits_passed for report in reports),
        "refused": sum(report.audits_refused for report in reports),
    }
    audited = {"defence": run.defence, "f_max": run.f_max if run.audited else None, "audits": audits}
    return figures(reports, sum(len(run.part_of(report.robot).mission.nodes) for report in reports)) | audited
