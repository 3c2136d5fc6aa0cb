"""What Figures 8 and 9 have in common: the flock of RoboRebound §5.3 over many seeds, with a liar and without."""

from __future__ import annotations

import csv
import importlib.resources
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from phalanx.errors import UsageError
from phalanx.experiments.version import version
from phalanx.sim.scenarios.file import find_scenario
from phalanx.sim.scenarios.play import ctrl_c_between_steps
from phalanx.sim.scenarios.run import Run
from phalanx.sim.scenarios.scenario import Scenario

from .flock_table import HONEST, LIAR, STOPPED, FlockFile, FlockRun, FlockTable, Origin

CASES = ("honest", "attacked")
EVERY_S = 5.0
# A run is advanced in steps, so that progress is seen and Ctrl-C heard.
STEP_S = 1.0
LOW, HIGH = 0.05, 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class FlockConfig:
    """What one of the figures measures.

    Args:
        name: bti-fig8 or bti-fig9: of the figure and of the built-in scenario.
        title: above the figure.
        reference: by case, the series of data/flock_reference.csv that belongs beside ours.
        seeds: of each case so many runs, with seeds from 0.
    Raises: UsageError: no seeds.
    """

    name: str
    title: str
    reference: dict[str, str]
    seeds: int = 20

    def __post_init__(self) -> None:
        if not 1 <= self.seeds <= 10_000:
            raise UsageError(f"{self.seeds} seeds", "1 to 10000")

    @property
    def csv_name(self) -> str:
        """Of the CSV in the folder of results."""
        return f"{self.name}.csv"

    def scenario(self, case: str, seed: int) -> Scenario:
        """What runs: the built-in scenario, in the honest case without its attack."""
        chosen = replace(find_scenario(self.name), seed=seed)
        return chosen if case == "attacked" else replace(chosen, attacks=())


@dataclass(frozen=True, slots=True)
class Statement:
    """One thing that the paper or the reference says, and what we found.

    Args:
        what: is compared, with its unit.
        paper: what the paper says, in words.
        reference: what the independent reference has, or "".
        ours: what we measured.
        agrees: whether they agree, by the tolerance named in `why`.
        why: the tolerance, and where it comes from; of a disagreement, the reason.
    """

    what: str
    paper: str
    reference: str
    ours: str
    agrees: bool
    why: str


def measure(folder: Path, config: FlockConfig, on_progress: Callable[[float], None] = lambda _share: None) -> Path:
    """The CSV in `folder`, with all runs in it; goes on where an earlier measurement was stopped.

    Args:
        folder: made if it is not there.
        config: which figure, how many seeds.
        on_progress: called with the share of the work that is done, 0 to 1.
    Raises: UsageError: a CSV of another measurement. Unavailable: the disk is full.
    Source: RoboRebound §5.3.
    """
    path = folder / config.csv_name
    origin = Origin(
        figure=config.name, scenario=repr(config.scenario("attacked", 0)), every_s=EVERY_S, version=version()
    )
    todo = [(seed, case) for seed in range(config.seeds) for case in CASES]
    done = 0

    def tell(share: float) -> None:
        on_progress((done + share) / len(todo))

    with FlockFile(path, origin) as file:
        for seed, case in todo:
            if (case, seed) not in file.done:
                file.append(_run(config, case, seed, tell))
            done += 1
            tell(0.0)
    return path


def _run(config: FlockConfig, case: str, seed: int, on_progress: Callable[[float], None]) -> FlockRun:
    scenario = config.scenario(case, seed)
    run = Run(scenario)
    samples = math.floor(scenario.duration_s / EVERY_S) + 1
    times_s = np.arange(samples, dtype=np.float64) * EVERY_S
    positions_m = np.zeros((samples, scenario.robots, 2))
    states = np.zeros((samples, scenario.robots), np.int8)
    with ctrl_c_between_steps() as check:
        for sample, t_s in enumerate(times_s):
            while run.now_s < t_s:
                run.advance(min(run.now_s + STEP_S, t_s))
                on_progress(run.now_s / scenario.duration_s)
                check()
            positions_m[sample] = run.positions_m
            states[sample] = _states(run)
    summary = {key: value for key, value in run.summary().items() if key not in ("distance_series", "real_time_factor")}
    return FlockRun(case, seed, times_s, positions_m, states, summary)


def _states(run: Run) -> NDArray[np.int8]:
    states = np.full(len(run.ids), HONEST, np.int8)
    lying = [told["robot"] - 1 for told in run.summary()["compromised"] if told["first_deviation_s"] is not None]
    states[lying] = LIAR
    states[run.in_safe_mode] = STOPPED
    return states


def mean_distances_m(
    table: FlockTable, case: str, goal_m: tuple[float, float], *, of_the_honest_in_both: bool = True
) -> NDArray[np.float64]:
    """(S, T): of each seed, the mean distance to the goal of the robots that are honest.

    Args:
        table: of the figure.
        case: honest or attacked.
        goal_m: where the flock goes.
        of_the_honest_in_both: leave out, in the honest case too, the robot that lies in the attacked one, so that the
            same robots are compared.
    Source: RoboRebound Fig. 8.
    """
    rows = []
    for seed in table.seeds():
        run = table.runs[case, seed]
        counted = ~table.runs["attacked" if of_the_honest_in_both else case, seed].liars
        rows.append(run.distances_m(goal_m)[:, counted].mean(axis=1))
    return np.array(rows)


def band(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Median, 5 % and 95 % quantile over the seeds, each (T,)."""
    low, middle, high = np.quantile(values, (LOW, 0.5, HIGH), axis=0)
    return middle, low, high


def at_times(values: NDArray[np.float64], times_s: NDArray[np.float64], t_s: float) -> NDArray[np.float64]:
    """(S,): of (S, T) values those at `t_s`, between two samples in proportion."""
    return np.array([float(np.interp(t_s, times_s, row)) for row in values])


def quantiles(values: NDArray[np.float64], form: str = ".1f") -> str:
    """`median (5 % … 95 %)` in words."""
    low, middle, high = np.quantile(values, (LOW, 0.5, HIGH), method="nearest")
    return f"{middle:{form}} ({low:{form}} … {high:{form}})"


def last_line(statements: list[Statement]) -> str:
    """What agrees with the paper and the reference, what does not, and why."""
    agree = [each.what for each in statements if each.agrees]
    differ = [f"{each.what}: {each.ours} (asked: {each.why})" for each in statements if not each.agrees]
    said = [f"agrees: {'; '.join(agree)}"] if agree else []
    return ".  ".join([*said, f"does not agree: {'; '.join(differ)}" if differ else "nothing disagrees"])


def read_reference() -> dict[str, NDArray[np.float64]]:
    """Each series of data/flock_reference.csv, (T, 4): t_s; mean, least and greatest distance of the honest robots, m.

    Source: an independent flocking script, see the file.
    """
    text = (importlib.resources.files("phalanx") / "data" / "flock_reference.csv").read_text()
    series: dict[str, list[list[float]]] = {}
    for row in csv.DictReader(line for line in text.splitlines() if not line.startswith("#")):
        numbers = [float(row[name]) for name in ("t_s", "mean_m", "least_m", "most_m")]
        series.setdefault(row["series"], []).append(numbers)
    return {name: np.array(rows) for name, rows in series.items()}
