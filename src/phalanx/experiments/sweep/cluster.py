"""A sweep's runs, made by whichever process is free and kept in its folder."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable
from typing import Any

from phalanx.scenarios.own import find_attacks, find_controller, mistakes_in
from phalanx.sim.scenarios.play import play
from phalanx.sim.scenarios.run import Run

from .dealing import Failed, dealt, get_ready
from .plan import Job, Plan, Planned
from .store import Store, outcome


def run_sweep(
    sweep: Plan,
    store: Store,
    scheduler: str | None = None,
    workers: int | None = None,
    on_progress: Callable[[int, int], None] = lambda _done, _of: None,
    *,
    run: Callable[[Any], dict[str, Any]] | None = None,
) -> list[str]:
    """All runs that the store does not have are made and added to it.

    Args:
        scheduler: address of a dask scheduler; None for processes of this machine, which nobody else can reach.
        workers: how many of these; None for one a processor.
        on_progress: is told how many runs are there, and of how many.
        run: makes a job's row, in whichever process; None for a `Sweep`'s.
    Returns: a line for each run that failed; the others are there.
    Raises: UsageError: of the sweep. Unavailable: dask is not installed; no scheduler there, or it went away; a disk
        is full. Ctrl-C: KeyboardInterrupt. Whatever it is, what came until then is in the store.
    """
    jobs = {job.key: job for job in sweep.jobs}
    todo = [job for key, job in jobs.items() if key not in store.done]
    on_progress(len(jobs) - len(todo), len(jobs))
    if not todo:
        return []
    if scheduler is None:
        get_ready()
        _check(todo[0])
    failed: list[str] = []
    left = len(todo)
    for key, row in dealt({job.key: job for job in todo}, run or run_job, scheduler, workers):
        if isinstance(row, Failed):
            failed.append(f"{_named(jobs[key])}: {row.why}")
        else:
            store.add(jobs[key], row)
        left -= 1
        on_progress(len(jobs) - left, len(jobs))
    return failed


def run_job(job: Job) -> dict[str, Any]:
    """What a run comes to, as a row of the store. What a researcher's own file prints goes to stderr."""
    with contextlib.redirect_stdout(sys.stderr), mistakes_in(job.attack, job.controller):
        scenario, own = find_controller(job.controller, job.scenario)
        if job.attack:
            scenario = scenario.with_options(attacks=find_attacks([job.attack]))
        begun_s = time.thread_time()
        run = play(scenario, controller=own)
        return outcome(run.summary(), time.thread_time() - begun_s)


def _check(job: Any) -> None:
    """Refuse here and once what can be refused, before processes start."""
    if not job.scenario:  # what a scorecard tries beside flocks
        return
    with mistakes_in(job.attack, job.controller):
        Run(*find_controller(job.controller, job.scenario))


def _named(job: Planned) -> str:
    return ", ".join(f"{name} {value}" for name, value in (*job.point, ("seed", job.seed)))
