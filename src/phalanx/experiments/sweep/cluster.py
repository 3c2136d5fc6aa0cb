"""A sweep's runs, dealt out by dask to processes of this machine, or of a cluster that there is."""

from __future__ import annotations

import contextlib
import logging
import sys
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

from phalanx.errors import PhalanxError, Unavailable
from phalanx.sim.scenarios.own import find_attacks, find_controller, mistakes_in
from phalanx.sim.scenarios.play import play
from phalanx.sim.scenarios.run import Run

from .plan import Job, Plan, Planned
from .store import SWEEP_HINT, Store, outcome

CONNECT_S = 15.0
# Of a worker that dies, dask gives its run to another; whose death comes so often again is not by chance.
DEATHS = 5
AHEAD = 8  # runs that wait for each process, so that none waits for us


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
        _compile(todo[0])
    failed: list[str] = []
    with _client(scheduler, workers) as (dask, client):
        ahead = AHEAD * max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
        waiting = iter(todo)

        def submit(count: int) -> list[Any]:
            given = [job for _, job in zip(range(count), waiting, strict=False)]
            return [client.submit(run or run_job, job, key=job.key, pure=False) for job in given]

        going = dask.as_completed(submit(ahead), loop=client.loop)
        left = len(todo)
        for future in going:
            job = jobs[future.key]
            if future.status == "finished":
                store.add(job, future.result())
            elif future.status == "cancelled":
                raise Unavailable(f"the scheduler at {scheduler} went away", "the same command goes on")
            else:
                failed.append(f"{_named(job)}: {_said(future.exception())}")
            left -= 1
            on_progress(len(jobs) - left, len(jobs))
            going.update(submit(1))
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


def _compile(job: Any) -> None:
    """Here and once, and not in each process at a time; and what can be refused is refused here."""
    if not job.scenario:  # what a scorecard tries beside flocks
        return
    with mistakes_in(job.attack, job.controller):
        Run(*find_controller(job.controller, job.scenario))


def _named(job: Planned) -> str:
    return ", ".join(f"{name} {value}" for name, value in (*job.point, ("seed", job.seed)))


def _said(error: BaseException | None) -> str:
    if isinstance(error, PhalanxError):
        return str(error)
    if type(error).__name__ == "KilledWorker":
        return f"{DEATHS} processes died of it, one after the other"
    return f"{type(error).__name__}: {error}".splitlines()[0]


@contextlib.contextmanager
def _client(scheduler: str | None, workers: int | None) -> Iterator[tuple[Any, Any]]:
    """Dask's own module, and a client of it."""
    try:
        dask: Any = import_module("distributed")
    except ImportError as error:
        raise Unavailable("dask.distributed is not installed", SWEEP_HINT) from error
    # It logs what we tell in a line, or mend.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with contextlib.ExitStack() as stack:
        stack.enter_context(import_module("dask").config.set({"distributed.scheduler.allowed-failures": DEATHS - 1}))
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
