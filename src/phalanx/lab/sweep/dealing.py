"""Jobs dealt out by dask to processes of this machine or of a cluster: a sweep's runs, and a figure's cases."""

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
from phalanx.world.scenarios.play import play
from phalanx.world.scenarios.run import Run
from phalanx.world.signals import handled_by

from .plan import SWEEP_HINT, Job, Plan, key_of
from .store import Store, outcome

CONNECT_S = 15.0
# Of a worker that dies, dask gives its run to another; whose death comes so often again is not by chance.
DEATHS = 5
# Dask has some milliseconds of work with a task, and runs can be shorter than that: a task is several of them, for
# about so long and at most so many. One more waits for each process, so that none waits for us.
TASK_S, MOST_IN_TASK = 0.3, 64
AHEAD = 2
ALONE = " alone"
SETTINGS = {
    "distributed.scheduler.allowed-failures": DEATHS - 1,
    "distributed.worker.profile.enabled": False,  # it looks at each worker a hundred times a second
    "distributed.worker.multiprocessing-method": "forkserver",
}
# A process of these has one thread: a run keeps a processor busy.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@dataclass(frozen=True, slots=True)
class Failed:
    """Result of a job that ended with an exception: one line that gives the reason."""

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
    """All runs that the store does not have are made and added to it.

    Args:
        scheduler: address of a dask scheduler; None for processes of this machine, which nobody else can reach.
        workers: how many of these; None for one a processor.
        on_progress: is told how many runs are there, and of how many.
        run: makes a job's row, in whichever process.
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
        _refuse_early(todo[0])
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
    """Run a job and return its row of the store. Output of a researcher's own file goes to stderr."""
    assert job.scenario, "a sweep's runs have one"
    with contextlib.redirect_stdout(sys.stderr), mistakes_in(job.attack, job.controller):
        scenario, own = find_controller(job.controller, job.scenario)
        if job.attack:
            scenario = scenario.with_options(attacks=find_attacks([job.attack]))
        begun_s = time.thread_time()
        run = play(scenario, controller=own)
        return outcome(run.summary(), time.thread_time() - begun_s)


def _refuse_early(job: Job) -> None:
    """Refuse here and once what can be refused, before processes start."""
    if not job.scenario:  # what a scorecard tries beside flocks
        return
    with mistakes_in(job.attack, job.controller):
        Run(*find_controller(job.controller, job.scenario))


def _named(job: Job) -> str:
    return ", ".join(f"{name} {value}" for name, value in (*job.point, ("seed", job.seed)))


def deal_cases(scheduler: str | None, workers: int | None) -> EachCase:
    """Measure a figure's cases with the scheduler of `run_sweep`, for `phalanx.papers.table.measure`.

    Raises: UsageError: both. And there, when all others are measured: Unavailable: a case could not be.
    """
    _check(scheduler, workers)

    def each(figure: Figure, todo: Sequence[str], _tell: Callable[[float], None]) -> Iterator[tuple[str, Any]]:
        jobs = {key_of(figure.name, version(), case): (figure, case) for case in todo}
        failed: list[str] = []
        for key, measured in dealt(jobs, _measure_case, scheduler, workers) if jobs else ():
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


def dealt(
    jobs: Mapping[str, Any], run: Callable[[Any], Any], scheduler: str | None, workers: int | None
) -> Iterator[tuple[str, Any]]:
    """Of each job its key, and what it came to or `Failed`: as they come."""
    with _client(scheduler, workers) as (dask, client):
        # Dask suspects of a death whatever waits for the same process: who is suspected is tried again by itself.
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
                made = future.result()
                yield from zip((key for key, _ in given), made, strict=False)
                waiting.extendleft(reversed(given[len(made) :]))
                size = min(2 * size, MOST_IN_TASK) if len(made) == len(given) else len(made)
            elif future.key.endswith(ALONE):
                yield given[0][0], Failed(why_not(future.exception()))
            else:
                suspects.extend(given)
            going.update(submit_more())


def _make(run: Callable[[Any], Any], jobs: Sequence[tuple[str, Any]]) -> list[Any]:
    """Run the first jobs, as many as fit into `TASK_S` and at least one; return results or `Failed`."""
    made: list[Any] = []
    until_s = time.perf_counter() + TASK_S
    for _, job in jobs:
        try:
            made.append(run(job))
        except Exception as error:  # noqa: BLE001 - whatever a researcher's file raises
            made.append(Failed(why_not(error)))
        if time.perf_counter() >= until_s:
            break
    return made


def why_not(error: BaseException | None) -> str:
    """Return the exception of a job as one line."""
    if isinstance(error, PhalanxError):
        return str(error)
    if type(error).__name__ == "KilledWorker":
        return f"{DEATHS} processes died of it, one after the other"
    return f"{type(error).__name__}: {error}".splitlines()[0]


def get_ready() -> None:
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
        raise UsageError("--workers with --scheduler", "a scheduler has workers of its own")


@contextlib.contextmanager
def _client(scheduler: str | None, workers: int | None) -> Iterator[tuple[Any, Any]]:
    """Dask's own module, and a client of it. SIGTERM ends it as Ctrl-C does: dask has processes and locks to clear."""
    _check(scheduler, workers)
    with contextlib.ExitStack() as stack:
        stack.enter_context(handled_by(signal.default_int_handler, signal.SIGTERM))
        if scheduler is None:
            get_ready()
        try:
            dask: Any = import_module("distributed")
        except ImportError as error:
            raise Unavailable("dask.distributed is not installed", SWEEP_HINT) from error
        # It logs what we tell in a line, or mend.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        stack.enter_context(warnings.catch_warnings())
        warnings.filterwarnings(
            "ignore", "(?s)(Creating scratch|Port [0-9]+ is already)"
        )  # of a slow disk, or a second sweep
        stack.enter_context(import_module("dask").config.set(SETTINGS))
        where: Any = scheduler
        if scheduler is None:
            # Whoever reaches a worker runs what he likes as us: certificates of this run's own, nobody else's.
            where = stack.enter_context(
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
            client = stack.enter_context(dask.Client(where, timeout=CONNECT_S, set_as_default=False))
        except (OSError, TimeoutError, ValueError) as error:
            raise Unavailable(f"no dask scheduler at {scheduler}", "for example tcp://10.0.0.1:8786") from error
        yield dask, client
