"""`simulate`: run a scenario with one or more seeds in one or more processes, and return arrays."""

from __future__ import annotations

import math
import multiprocessing
import signal
import warnings
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ProcessPoolExecutor, wait
from dataclasses import dataclass, replace
from numbers import Integral, Real
from operator import index
from pathlib import Path
from typing import Any

import numpy as np

from phalanx.errors import UsageError
from phalanx.robot.adversary.attack import Attack
from phalanx.robot.adversary.liar import Liar
from phalanx.robot.controllers.python_controller import Controller
from phalanx.robot.planner import MakePlanner
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.own import find_attacks, find_controller, find_planner
from phalanx.scenarios.scenario import Scenario
from phalanx.world.audited.world import VerdictReader

from .cautions import audit_warnings
from .play import STEP_S, run_scenario
from .result import VERDICT, Result
from .run import Run

# Period of progress reports from other processes, seconds.
LOOK_S = 0.1
OneAttack = str | AttackSpec | Attack | type[Liar]


@dataclass(frozen=True, slots=True)
class _Job:
    scenario: Scenario
    controller: Callable[[int], Controller] | None
    planner: MakePlanner | None
    seeds: tuple[int, ...]
    every_s: float
    record: str | None

    @property
    def looks(self) -> int:
        """Return the number of samples of a run."""
        return math.floor(self.scenario.duration_s / self.every_s + 1e-9) + 1


def simulate(
    scenario: Scenario | str | Path,
    *,
    controller: Callable[[int], Controller] | str | None = None,
    planner: MakePlanner | str | None = None,
    attacks: OneAttack | Sequence[OneAttack] | None = None,
    seeds: Iterable[int] | int | None = None,
    every_s: float = 1.0,
    workers: int = 1,
    record: str | Path | None = None,
    on_progress: Callable[[float], None] = lambda _share: None,
) -> Result:
    """Run a scenario from beginning to end, once for each seed.

    The same scenario, seed and controller give the same numbers, whatever `every_s` and `workers` are. Ctrl-C ends all
    processes between two steps; recordings are complete up to there.

    Args:
        scenario: a scenario, the name of a built-in one, or a YAML file.
        controller: a class derived from `Controller`, or a factory that takes a robot's id; "file.py:Class"; "file.py"
            with kernels; or the name of a bundled one. None for the scenario's.
        planner: adviser of robots with the controller `guard`: a class derived from `Planner`, or a factory that takes
            a robot's id and the goal; or "file.py:Class". None for one that goes straight to the goal.
        attacks: one or several that replace the scenario's own: `AttackSpec`s; texts as for `phalanx sim run --attack`;
            classes derived from `Liar`, or their records. () or "none" for no attack.
        seeds: one run for each; None for the scenario's own.
        every_s: simulated seconds between samples; the first is at 0, the last not after the scenario's end.
        workers: number of processes. More than one are forked: globals that the controller reads have the values
            at the call of `simulate`.
        record: MCAP file to write; with several seeds the name must contain {seed}.
        on_progress: receives the completed share of the work, 0 to 1.
    Raises: UsageError: an invalid argument. Unavailable: no memory or disk left, or a file cannot be read. Exceptions
        of the controller are passed on.
    Warns: before a run whose robots cannot have a quorum, or whose audits will saturate the radio channel.
    """
    _check_kinds(scenario, controller, planner, every_s, workers)
    chosen = scenario if isinstance(scenario, Scenario) else find_scenario(str(scenario))
    if isinstance(attacks, str):
        attacks = (attacks,)
    if attacks is not None:
        chosen = replace(chosen, attacks=find_attacks(attacks if isinstance(attacks, Sequence) else (attacks,)))
    numbers = _numbers(seeds, chosen.seed)
    chosen = replace(chosen, seed=numbers[0])
    if not 0.001 <= every_s <= chosen.duration_s:
        raise UsageError(f"every_s is {every_s:g}", f"use 0.001 to the scenario's {chosen.duration_s:g}")
    if workers < 1:
        raise UsageError(f"{workers} workers", "use 1 or more")
    if record is not None and len(numbers) > 1 and "{seed}" not in str(record):
        raise UsageError(f"one file {record} for {len(numbers)} runs", "use a name with {seed} in it")
    if isinstance(controller, str):
        chosen, controller = find_controller(controller, chosen)
    for caution in audit_warnings(chosen):
        warnings.warn(caution, stacklevel=2)
    advises = find_planner(planner)
    job = _Job(chosen, controller, advises, numbers, float(every_s), None if record is None else str(record))
    workers = min(workers, len(numbers))
    return _joined(job, _here(job, on_progress) if workers == 1 else _forked(job, workers, on_progress))


def _numbers(seeds: Iterable[int] | int | None, own: int) -> tuple[int, ...]:
    try:
        numbers = (own,) if seeds is None else (seeds,) if isinstance(seeds, int) else tuple(map(index, seeds))
    except (TypeError, ValueError) as error:
        raise UsageError(f"seeds is {seeds!r}", "use whole numbers, for example range(20)") from error
    if not numbers:
        raise UsageError("no seeds", "use at least one, for example range(20)")
    if len(set(numbers)) < len(numbers):
        raise UsageError(f"seeds is {seeds!r}", "list each seed once: the same seed gives the same run")
    return numbers


def _check_kinds(scenario: object, controller: object, planner: object, every_s: object, workers: object) -> None:
    can_make = [each is None or isinstance(each, str) or callable(each) for each in (controller, planner)]
    for name, given, right, hint in (
        ("scenario", scenario, isinstance(scenario, Scenario | str | Path), "use a Scenario, or the name of one"),
        ("controller", controller, can_make[0], "use a class"),
        ("planner", planner, can_make[1], "use a class"),
        ("every_s", every_s, isinstance(every_s, Real), "use seconds"),
        ("workers", workers, isinstance(workers, Integral), "use a whole number"),
    ):
        if not right:
            raise UsageError(f"{name} is {given!r}", hint)


def _here(job: _Job, on_progress: Callable[[float], None]) -> list[dict[str, Any]]:
    count = len(job.seeds)
    return [
        _one(job, seed, lambda share, k=k: on_progress((k + share) / count))  # type: ignore[misc]
        for k, seed in enumerate(job.seeds)
    ]


def _one(job: _Job, seed: int, on_share: Callable[[float], None]) -> dict[str, Any]:
    """Run one seed; return arrays (T, …), verdicts and the summary."""
    scenario = replace(job.scenario, seed=seed)
    apart = math.ceil(job.every_s / STEP_S)  # steps per sample
    seen: dict[str, list[Any]] = {"positions_m": [], "velocities_mps": [], "in_safe_mode": []}
    verdicts: list[tuple[int, float, int, int, int]] = []
    steps = 0
    reader: VerdictReader | None = None  # separate, because a recording reads the run's

    def on_step(run: Run) -> None:
        nonlocal steps, reader
        if steps % apart == 0 and steps // apart < job.looks:
            for name, values in seen.items():
                values.append(getattr(run, name))
        steps += 1
        reader = reader or VerdictReader(run.world)
        verdicts.extend((seed, *verdict) for verdict in reader.new())
        on_share(run.now_s / scenario.duration_s)

    record = Path(job.record.replace("{seed}", str(seed))) if job.record else None
    run = run_scenario(scenario, record, on_step, job.controller, job.every_s / apart, planner=job.planner)
    liars = np.isin(run.ids, list(run.compromised))
    arrays = {name: np.stack(values) for name, values in seen.items()}
    return arrays | {"compromised": liars, "verdicts": np.array(verdicts, VERDICT), "summary": run.summary()}


def _joined(job: _Job, runs: list[dict[str, Any]]) -> Result:
    return Result(
        scenario=job.scenario,
        seeds=np.array(job.seeds),
        ids=np.arange(1, job.scenario.robots + 1),
        times_s=np.arange(job.looks, dtype=np.float64) * job.every_s,
        verdicts=np.concatenate([run["verdicts"] for run in runs]),
        summaries=tuple(run["summary"] for run in runs),
        **{
            name: np.stack([run[name] for run in runs])
            for name in ("positions_m", "velocities_mps", "in_safe_mode", "compromised")
        },
    )


# --- several processes ------------------------------------------------------------------------------------------------

# In a forked process: the job, each run's progress, and the event that ends all.
_shared: list[Any] = []


def _begin(job: _Job, shares: Any, ends: Any) -> None:
    # Ctrl-C is handled by the parent, which sets the event.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _shared[:] = job, shares, ends


def _nth(k: int) -> dict[str, Any]:
    job, shares, ends = _shared

    def on_share(share: float) -> None:
        if ends.is_set():
            raise KeyboardInterrupt
        shares[k] = share

    return _one(job, job.seeds[k], on_share)


def _forked(job: _Job, workers: int, on_progress: Callable[[float], None]) -> list[dict[str, Any]]:
    # Forked, not spawned: a class from a notebook has no module that another process could import.
    context = multiprocessing.get_context("fork")
    shares, ends = context.Array("d", len(job.seeds), lock=False), context.Event()
    Run(job.scenario, job.controller, job.planner)  # reports common errors once, before the fork
    with ProcessPoolExecutor(workers, context, _begin, (job, shares, ends)) as pool:
        futures = [pool.submit(_nth, k) for k in range(len(job.seeds))]
        try:
            while wait(futures, LOOK_S, FIRST_EXCEPTION).not_done:
                on_progress(sum(shares) / len(shares))
                for future in futures:
                    if future.done():
                        future.result()
            on_progress(1.0)
            return [future.result() for future in futures]
        except BaseException:  # Ctrl-C too
            ends.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise
