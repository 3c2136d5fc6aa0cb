"""Jobs dealt out by dask to processes of this machine, or of a cluster that there is; a figure's cases among them."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import signal
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import forkserver, get_context
from typing import Any

from phalanx.errors import PhalanxError, Unavailable, UsageError
from phalanx.experiments.figure import Figure
from phalanx.experiments.table import EachCase
from phalanx.experiments.version import version
from phalanx.sim.signals import handled_by

SWEEP_HINT = "pip install '.[sweep]' in a clone"
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
    """What a job came to that ended with an exception: a line that says why."""

    why: str


def key_of(*said: object) -> str:
    """Of a run that this is all of: two of the same key are one."""
    return hashlib.sha256(repr(said).encode()).hexdigest()[:24]


def deal_cases(scheduler: str | None, workers: int | None) -> EachCase:
    """What measures a figure's cases as `run_sweep` makes runs, for `phalanx.experiments.table.measure`.

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
                raise Unavailable(f"the scheduler at {scheduler} went away", "the same command goes on")
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
    """What the first jobs came to, or `Failed`: of as many as fit into `TASK_S`, of one at least."""
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
    """What a job ended with, as a line."""
    if isinstance(error, PhalanxError):
        return str(error)
    if type(error).__name__ == "KilledWorker":
        return f"{DEATHS} processes died of it, one after the other"
    return f"{type(error).__name__}: {error}".splitlines()[0]


def get_ready() -> None:
    """What processes of this machine are forked from begins to import what they need, while we do something else."""
    context = get_context("forkserver")
    context.set_forkserver_preload(["distributed", f"{__package__}.cluster"])
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
