"""A mission run: robots that know only the encoded graph, from their start until done, held or out of time.

Robots do not hinder each other (each sees the building and who walks there, not the others), and what is drawn for one
depends on the seed and its number alone. Those that cannot hear each other each live in a world of their own, so the
digest of a run is the same however many processes share the work.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from multiprocessing import get_context
from multiprocessing.connection import Connection

from phalanx.errors import Unavailable
from phalanx.mission import Walker

from .report import Report
from .setup import MissionRun
from .world import MissionWorld, walkers_of

CHUNK_S = 2.0


def run_mission(
    run: MissionRun, workers: int = 1, on_progress: Callable[[float], None] = lambda _share: None
) -> list[Report]:
    """Run a mission and return the outcome of each robot.

    Args:
        workers: processes that share robots which cannot hear each other.
        on_progress: called with the share of the work that is done; of the first process's robots.
    Raises: Unavailable: one of the processes was killed.
    """
    if not run.alone:
        return _live(run, range(run.robots), on_progress)
    workers = max(1, min(workers, run.robots))
    if workers == 1:
        return _each(run, range(run.robots), on_progress)
    shares = [range(k, run.robots, workers) for k in range(workers)]
    context = get_context("spawn")
    with ExitStack() as others:
        pipes = []
        for share in shares[1:]:
            pipe, theirs = context.Pipe(duplex=False)
            process = context.Process(target=_elsewhere, args=(theirs, run, share), daemon=True)
            process.start()
            theirs.close()  # theirs alone now, so that it ends with them
            others.callback(process.join)
            others.callback(process.terminate)
            pipes.append(pipe)
        reports = _each(run, shares[0], on_progress)
        for pipe in pipes:
            reports += _told(pipe)
    return sorted(reports, key=lambda report: report.robot)


def _elsewhere(pipe: Connection, run: MissionRun, numbers: range) -> None:
    """The body of another process: what became of these robots, or what went wrong, into the pipe."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for whoever called
    try:
        pipe.send(_each(run, numbers))
    except Exception as error:  # noqa: BLE001 - whoever called raises it
        pipe.send(error)


def _told(pipe: Connection) -> list[Report]:
    try:
        told: list[Report] | Exception = pipe.recv()
    except (EOFError, OSError) as error:
        raise Unavailable("a process that lived some of the robots was killed", "is there memory enough?") from error
    if isinstance(told, Exception):
        raise told
    return told


def _each(run: MissionRun, numbers: range, on_progress: Callable[[float], None] = lambda _share: None) -> list[Report]:
    """The reports of these robots, each of which lives by itself, but for what another has searched in vain."""
    walkers = walkers_of(run)

    def live(done: int, number: int) -> Report:
        (report,) = _live(run, (number,), lambda share: on_progress((done + share) / len(numbers)), walkers)
        return report

    return [live(*each) for each in enumerate(numbers)]


def _live(
    run: MissionRun, numbers: Sequence[int], on_progress: Callable[[float], None], walkers: Sequence[Walker] = ()
) -> list[Report]:
    """The reports of these robots, who live in one world."""
    world = MissionWorld(run, numbers, walkers=walkers)
    now_s = 0.0
    while now_s < run.duration_s and not world.over:
        now_s = min(now_s + CHUNK_S, run.duration_s)
        world.advance(now_s)
        on_progress(now_s / run.duration_s)
    on_progress(1.0)
    return world.finish()
