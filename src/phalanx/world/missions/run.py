"""Run a mission: robots that know only the encoded graph, from the start until done, held or out of time.

Robots do not obstruct each other: each senses the building and walking people, not the other robots. A robot's random
draws depend only on the seed and its number. Robots that are not in radio range of each other run in separate worlds,
so the digest of a run does not depend on the number of processes.
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
        workers: number of processes, for robots that are not in range of each other.
        on_progress: receives the completed share of the first process's work.
    Raises: Unavailable: one of the processes was killed.
    """
    if not run.alone:
        return _run(run, range(run.robots), on_progress)
    workers = max(1, min(workers, run.robots))
    if workers == 1:
        return _each(run, range(run.robots), on_progress)
    shares = [range(k, run.robots, workers) for k in range(workers)]
    context = get_context("spawn")
    with ExitStack() as others:
        pipes = []
        for share in shares[1:]:
            pipe, child_end = context.Pipe(duplex=False)
            process = context.Process(target=_elsewhere, args=(child_end, run, share), daemon=True)
            process.start()
            child_end.close()  # only the child holds it now, so that EOF shows its end
            others.callback(process.join)
            others.callback(process.terminate)
            pipes.append(pipe)
        reports = _each(run, shares[0], on_progress)
        for pipe in pipes:
            reports += _receive(pipe)
    return sorted(reports, key=lambda report: report.robot)


def _elsewhere(pipe: Connection, run: MissionRun, numbers: range) -> None:
    """Run some robots in another process, and send their reports, or the exception, into the pipe."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is handled by the parent
    try:
        pipe.send(_each(run, numbers))
    except Exception as error:  # noqa: BLE001 - the parent raises it
        pipe.send(error)


def _receive(pipe: Connection) -> list[Report]:
    try:
        received: list[Report] | Exception = pipe.recv()
    except (EOFError, OSError) as error:
        raise Unavailable("a process that ran some of the robots was killed", "check the free memory") from error
    if isinstance(received, Exception):
        raise received
    return received


def _each(run: MissionRun, numbers: range, on_progress: Callable[[float], None] = lambda _share: None) -> list[Report]:
    """Run each robot in its own world; they share only the cache of failed searches."""
    walkers = walkers_of(run)

    def run_one(done: int, number: int) -> Report:
        (report,) = _run(run, (number,), lambda share: on_progress((done + share) / len(numbers)), walkers)
        return report

    return [run_one(*each) for each in enumerate(numbers)]


def _run(
    run: MissionRun, numbers: Sequence[int], on_progress: Callable[[float], None], walkers: Sequence[Walker] = ()
) -> list[Report]:
    """Run these robots in one world, and return their reports."""
    world = MissionWorld(run, numbers, walkers=walkers)
    now_s = 0.0
    while now_s < run.duration_s and not world.over:
        now_s = min(now_s + CHUNK_S, run.duration_s)
        world.advance(now_s)
        on_progress(now_s / run.duration_s)
    on_progress(1.0)
    return world.finish()
