"""Distribute jobs with dask to processes of this machine or a cluster: runs of a sweep, or cases of a figure."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import sys
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import forkserver, get_context
from typing import Any

from phalanx.errors import PhalanxError, Unavailable, UsageError
from phalanx.papers.figure import Figure
from phalanx.papers.table import EachCase, version
from phalanx.scenarios.own import find_attacks, find_controller, mistakes_in
from phalanx.world.scenarios.play import run_scenario
from phalanx.world.scenarios.run import Run
from phalanx.world.signals import handled_by

from .plan import SWEEP_HINT, Job, Plan, key_of
from .store import Store, outcome

CONNECT_S = 15.0
# When a worker dies, dask gives its task to another one; DEATHS in a row are no coincidence.
DEATHS = 5
# Dask needs some milliseconds per task, which may be longer than a run. So a task has several runs, for about this time
# and at most this many. Some more tasks wait for each process, so that it never idles.
TASK_S, MOST_IN_TASK = 0.3, 64
AHEAD = 2
ALONE = " alone"
SETTINGS = {
    "distributed.scheduler.allowed-failures": DEATHS - 1,
    "distributed.worker.profile.enabled": False,  # it samples each worker a hundred times per second
    "distributed.worker.multiprocessing-method": "forkserver",
}
# One thread per worker process, because a run keeps one processor busy.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@dataclass(frozen=True, slots=True)
class Failed:
    """Result of a job that ended with an exception: the reason in one line."""

    why: str


def run_sweep(
    sweep: Plan,
    store: Store,
    scheduler: str | None = None,
    workers: int | None = None,
    on_progress: Callable[[int, int], None] = lambda _done, _of: None,
    *,
    run: Callable[[Any], dict[str, Any]] | None = None,
) -> list[str]:
    """Run all jobs that the store does not have yet, and add their rows to it.

    Args:
        scheduler: address of a dask scheduler; None for processes of this machine, which accept no other client.
        workers: number of these processes; None for one per processor.
        on_progress: receives the number of completed runs and the total.
        run: makes a job's row; called in a worker process.
    Returns: a line for each run that failed; the store has the others.
    Raises: UsageError: an invalid sweep. Unavailable: dask is not installed; no scheduler, or it went away; a disk is
        full. KeyboardInterrupt: Ctrl-C. In all cases the store keeps the completed runs.
    """
    jobs = {job.key: job for job in sweep.jobs}
    todo = [job for key, job in jobs.items() if key not in store.done]
    on_progress(len(jobs) - len(todo), len(jobs))
    if not todo:
        return []
    if scheduler is None:
        start_fork_server()
        _check_first(todo[0])
    failed: list[str] = []
    left = len(todo)
    for key, row in run_jobs({job.key: job for job in todo}, run or run_job, scheduler, workers):
        if isinstance(row, Failed):
            failed.append(f"{_label(jobs[key])}: {row.why}")
        else:
            store.add(jobs[key], row)
        left -= 1
        on_progress(len(jobs) - left, len(jobs))
    return failed


def run_job(job: Job) -> dict[str, Any]:
    """Run a job and return its row for the store. Output of a user's own file goes to stderr."""
    assert job.scenario, "every run of a sweep has a scenario"
    with contextlib.redirect_stdout(sys.stderr), mistakes_in(job.attack, job.controller):
        scenario, own = find_controller(job.controller, job.scenario)
        if job.attack:
            scenario = scenario.with_options(attacks=find_attacks([job.attack]))
        begun_s = time.thread_time()
        run = run_scenario(scenario, controller=own)
        return outcome(run.summary(), time.thread_time() - begun_s)


def _check_first(job: Job) -> None:
    """Report errors that concern all jobs once, before processes start."""
    if not job.scenario:  # a scorecard's attack outside flocks
        return
    with mistakes_in(job.attack, job.controller):
        Run(*find_controller(job.controller, job.scenario))


def _label(job: Job) -> str:
    return ", ".join(f"{name} {value}" for name, value in (*job.point, ("seed", job.seed)))


def cases_with_dask(scheduler: str | None, workers: int | None) -> EachCase:
    """Return an `EachCase` for `phalanx.papers.table.measure` that uses the scheduler of `run_sweep`.

    Raises: UsageError: both are given. The `EachCase` raises Unavailable after all other cases if one failed.
    """
    _check(scheduler, workers)

    def each(figure: Figure, todo: Sequence[str], _on_progress: Callable[[float], None]) -> Iterator[tuple[str, Any]]:
        jobs = {key_of(figure.name, version(), case): (figure, case) for case in todo}
        failed: list[str] = []
        for key, measured in run_jobs(jobs, _measure_case, scheduler, workers) if jobs else ():
            case = jobs[key][1]
            if isinstance(measured, Failed):
                failed.append(f"{case}: {measured.why}")
            else:
                yield case, measured
        if failed:
            raise Unavailable(f"{len(failed)} of {len(todo)} failed, as {failed[0]}", "the others are measured")

    return each


def _measure_case(job: tuple[Figure, str]) -> Any:
    figure, case = job
    return figure.body.measure_case(case, lambda _share: None)


def run_jobs(
    jobs: Mapping[str, Any], run: Callable[[Any], Any], scheduler: str | None, workers: int | None
) -> Iterator[tuple[str, Any]]:
    """Run the jobs, and yield each job's key and its result or `Failed`, in order of completion."""
    with _client(scheduler, workers) as (dask, client):
        # When a worker dies, every task on that worker is suspect; each suspect job is retried in a task of its own.
        waiting, suspects = deque(jobs.items()), deque[tuple[str, Any]]()
        of: dict[str, Sequence[tuple[str, Any]]] = {}  # by task
        processes, size = max(1, len(client.scheduler_info(n_workers=-1)["workers"])), 1

        def submit(given: Sequence[tuple[str, Any]], more: str = "") -> Any:
            future = client.submit(_make, run, given, key=given[0][0] + more, pure=False)
            of[future.key] = given
            return future

        def submit_more() -> list[Any]:
            submitted = []
            while waiting and len(of) < AHEAD * processes:
                count = min(size, -(-len(waiting) // (AHEAD * processes)))
                submitted.append(submit([waiting.popleft() for _ in range(count)]))
            if suspects and not of:
                submitted.append(submit([suspects.popleft()], ALONE))
            return submitted

        going = dask.as_completed(submit_more(), loop=client.loop)
        for future in going:
            given = of.pop(future.key)
            if future.status == "cancelled":
                raise Unavailable(f"the scheduler at {scheduler} went away", "run the same command again to continue")
            if future.status == "finished":
                results = future.result()
                yield from zip((key for key, _ in given), results, strict=False)
                waiting.extendleft(reversed(given[len(results) :]))
                size = min(2 * size, MOST_IN_TASK) if len(results) == len(given) else len(results)
            elif future.key.endswith(ALONE):
                yield given[0][0], Failed(error_line(future.exception()))
            else:
                suspects.extend(given)
            going.update(submit_more())


def _make(run: Callable[[Any], Any], jobs: Sequence[tuple[str, Any]]) -> list[Any]:
    """Run jobs in order for about `TASK_S`, at least one; return their results or `Failed`."""
    results: list[Any] = []
    until_s = time.perf_counter() + TASK_S
    for _, job in jobs:
        try:
            results.append(run(job))
        except Exception as error:  # noqa: BLE001 - a user's file may raise anything
            results.append(Failed(error_line(error)))
        if time.perf_counter() >= until_s:
            break
    return results


def error_line(error: BaseException | None) -> str:
    """Return the exception of a job as one line."""
    if isinstance(error, PhalanxError):
        return str(error)
    if type(error).__name__ == "KilledWorker":
        return f"{DEATHS} processes in a row died while running it"
    return f"{type(error).__name__}: {error}".splitlines()[0]


def start_fork_server() -> None:
    """Start the fork server of this machine, which imports the workers' modules in the background."""
    context = get_context("forkserver")
    context.set_forkserver_preload(["distributed", __name__])
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update({name: one for name, one in ONE_THREAD.items() if not before[name]})
    try:
        forkserver.ensure_running()
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]


def _check(scheduler: str | None, workers: int | None) -> None:
    if scheduler and workers:
        raise UsageError("--workers with --scheduler", "omit --workers: a scheduler has its own workers")


@contextlib.contextmanager
def _client(scheduler: str | None, workers: int | None) -> Iterator[tuple[Any, Any]]:
    """Yield the dask module and a client. SIGTERM acts like Ctrl-C, so that dask can end its processes."""
    _check(scheduler, workers)
    with contextlib.ExitStack() as stack:
        stack.enter_context(handled_by(signal.default_int_handler, signal.SIGTERM))
        if scheduler is None:
            start_fork_server()
        try:
            dask: Any = import_module("distributed")
        except ImportError as error:
            raise Unavailable("dask.distributed is not installed", SWEEP_HINT) from error
        # Its messages duplicate ours, or concern failures that we handle.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        stack.enter_context(warnings.catch_warnings())
        warnings.filterwarnings(
            "ignore", "(?s)(Creating scratch|Port [0-9]+ is already)"
        )  # on a slow disk, or while a second sweep runs
        stack.enter_context(import_module("dask").config.set(SETTINGS))
        address: Any = scheduler
        if scheduler is None:
            # A client of a worker can run any code as this user: use certificates that exist only for this run.
            address = stack.enter_context(
                dask.LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    security=True,
                    dashboard_address=None,
                    worker_dashboard_address=None,
                    silence_logs=logging.CRITICAL,
                )
            )
        try:
            client = stack.enter_context(dask.Client(address, timeout=CONNECT_S, set_as_default=False))
        except (OSError, TimeoutError, ValueError) as error:
            raise Unavailable(f"no dask scheduler at {scheduler}", "use an address like tcp://10.0.0.1:8786") from error
        yield dask, client
