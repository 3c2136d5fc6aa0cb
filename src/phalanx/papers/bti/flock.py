"""Run the flock of RoboRebound §5.3 over many seeds, with compromised robots and without: Figures 2, 8 and 9.

The figures are drawn from their CSV alone: distance to the goal over time, and the final positions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phalanx.errors import UsageError
from phalanx.papers.statement import Statement
from phalanx.papers.table import Rows, Table, read_data
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.play import ctrl_c_between_steps
from phalanx.world.scenarios.run import Run

CASES = ("honest", "attacked")
COLUMNS = ("t_s", "robot", "state", "x_m", "y_m")
HONEST, LIAR, STOPPED = STATES = 0, 1, 2  # values of the column `state`
EVERY_S = 5.0
# A run advances in steps of this length, so that it can report progress and respond to Ctrl-C.
STEP_S = 1.0


def cases(seeds: int) -> list[str]:
    """Return the cases ordered by seed."""
    return [f"{case} seed {seed}" for seed in range(seeds) for case in CASES]


def split(case: str) -> tuple[str, int]:
    """Return the kind of a case (`honest` or `attacked`) and its seed."""
    kind, _, seed = case.split(" ")
    return kind, int(seed)


def _states(run: Run) -> NDArray[np.int8]:
    states = np.full(len(run.ids), HONEST, np.int8)
    lying = [robot["robot"] - 1 for robot in run.summary()["compromised"] if robot["first_deviation_s"] is not None]
    states[lying] = LIAR
    states[run.in_safe_mode] = STOPPED
    return states


@dataclass(frozen=True, slots=True)
class FlockRun:
    """Recorded trajectory and summary of one run."""

    case: str  # honest or attacked
    seed: int
    times_s: NDArray[np.float64]  # (T,)
    positions_m: NDArray[np.float64]  # (T, N, 2)
    states: NDArray[np.int8]  # (T, N) int8: HONEST, LIAR, STOPPED
    summary: dict[str, Any]  # as printed by `phalanx sim run --json`, without the time series

    @property
    def liars(self) -> NDArray[np.bool_]:
        """Return (N,) flags of the compromised robots."""
        liars = np.zeros(self.positions_m.shape[1], bool)
        liars[[robot["robot"] - 1 for robot in self.summary["compromised"]]] = True
        return liars

    def distances_m(self, goal_m: tuple[float, float]) -> NDArray[np.float64]:
        """Return (T, N) distances to the goal. Source: RoboRebound Fig. 8."""
        distances: NDArray[np.float64] = np.sqrt(((self.positions_m - np.array(goal_m)) ** 2).sum(axis=2))
        return distances


@dataclass(frozen=True, slots=True)
class FlockRuns:
    """Runs of one table, by case and seed."""

    runs: dict[tuple[str, int], FlockRun]

    def seeds(self) -> list[int]:
        """Return the seeds for which every case was measured."""
        cases = {case for case, _ in self.runs}
        seeds = {seed for _, seed in self.runs}
        return sorted(seed for seed in seeds if all((case, seed) in self.runs for case in cases))

    def of(self, case: str) -> list[FlockRun]:
        """Return the runs of a case, by ascending seed."""
        return [self.runs[case, seed] for seed in self.seeds()]


def runs_of(table: Table) -> FlockRuns:
    """Parse the runs in a table. Raises: UsageError: a case is not a valid flock run."""
    try:
        return FlockRuns({split(case): _run(case, rows, table.kept[case]) for case, rows in table.cases.items()})
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise UsageError(f"a case of {table.figure} is not a valid flock run: {error}", "measure it again") from error


def _run(case: str, rows: Rows, summary: dict[str, Any]) -> FlockRun:
    robots = int(summary["robots"])
    each = rows.reshape(-1, robots, len(COLUMNS))
    in_order = (each[:, :, 1] == np.arange(1, robots + 1)).all() and np.isin(each[:, :, 2], STATES).all()
    if not (np.isfinite(rows).all() and in_order):
        raise ValueError(case)
    return FlockRun(*split(case), each[:, 0, 0], each[:, :, 3:], each[:, :, 2].astype(np.int8), summary)


def mean_distances_m(
    table: FlockRuns, case: str, goal_m: tuple[float, float], *, of_the_honest_in_both: bool = True
) -> NDArray[np.float64]:
    """Return (S, T) mean distances to the goal of the honest robots, by seed. Source: RoboRebound Fig. 8.

    By default only robots that are honest in both cases count, so that the same robots are compared.
    """
    counted = table.of("attacked" if of_the_honest_in_both else case)
    runs = zip(table.of(case), counted, strict=True)
    return np.array([run.distances_m(goal_m)[:, ~same.liars].mean(axis=1) for run, same in runs])


def read_reference() -> dict[str, NDArray[np.float64]]:
    """Return the series of data/flock_reference.csv, each (T, 4): t_s; mean, least, greatest distance (honest), m.

    Source: an independent flocking script; see the header of the CSV.
    """
    series: dict[str, list[list[float]]] = {}
    for row in read_data("flock_reference.csv"):
        numbers = [float(row[name]) for name in ("t_s", "mean_m", "least_m", "most_m")]
        series.setdefault(row["series"], []).append(numbers)
    return {name: np.array(rows) for name, rows in series.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Flock:
    """Definition of one flock figure: its scenario, reference series and comparison."""

    COLUMNS = COLUMNS
    cases = staticmethod(cases)
    check = staticmethod(runs_of)

    name: str  # of the built-in scenario
    reference: Mapping[str, str]  # by case, the series of data/flock_reference.csv to draw beside ours, if any
    find: Callable[[FlockRuns], list[Statement]]  # compares the runs with the paper and the independent reference

    def scenario(self, case: str, seed: int) -> Scenario:
        """Return the built-in scenario; for the honest case without its attack."""
        chosen = replace(find_scenario(self.name), seed=seed)
        return chosen if case == "attacked" else replace(chosen, attacks=())

    def origin(self) -> dict[str, Any]:
        """Return the settings that must be equal for two measurements to share a CSV: scenario and sampling."""
        return {"scenario": repr(self.scenario("attacked", 0)), "every_s": EVERY_S}

    def measure_case(self, case: str, tell: Callable[[float], None]) -> tuple[Rows, dict[str, Any]]:
        """Run one case. Return a row per sample and robot, and the summary without series and machine speed."""
        kind, seed = split(case)
        scenario = self.scenario(kind, seed)
        run, rows = Run(scenario), []
        with ctrl_c_between_steps() as check:
            for sample in range(math.floor(scenario.duration_s / EVERY_S) + 1):
                t_s = sample * EVERY_S
                while run.now_s < t_s:
                    run.advance(min(run.now_s + STEP_S, t_s))
                    tell(run.now_s / scenario.duration_s)
                    check()
                rows.append(np.column_stack([np.full(len(run.ids), t_s), run.ids, _states(run), run.positions_m]))
        drop = ("distance_series", "real_time_factor")
        return np.concatenate(rows), {key: value for key, value in run.summary().items() if key not in drop}

    def compare(self, table: Table) -> list[Statement]:
        """Compare the runs in a table with the paper and the reference."""
        return self.find(runs_of(table))
