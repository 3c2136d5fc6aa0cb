"""Run the flock of RoboRebound §5.3 over many seeds, with compromised robots and without: Figures 2, 8 and 9.

They are drawn from their CSV alone: distance to the goal over time, and where everybody ends.
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
HONEST, LIAR, STOPPED = STATES = 0, 1, 2  # what a robot is, in `state`
EVERY_S = 5.0
# A run is advanced in steps, so that progress is seen and Ctrl-C heard.
STEP_S = 1.0


def cases(seeds: int) -> list[str]:
    """Seed by seed."""
    return [f"{case} seed {seed}" for seed in range(seeds) for case in CASES]


def split(case: str) -> tuple[str, int]:
    """(honest or attacked, seed)."""
    kind, _, seed = case.split(" ")
    return kind, int(seed)


def _states(run: Run) -> NDArray[np.int8]:
    states = np.full(len(run.ids), HONEST, np.int8)
    lying = [told["robot"] - 1 for told in run.summary()["compromised"] if told["first_deviation_s"] is not None]
    states[lying] = LIAR
    states[run.in_safe_mode] = STOPPED
    return states


@dataclass(frozen=True, slots=True)
class FlockRun:
    """One run."""

    case: str  # honest or attacked
    seed: int
    times_s: NDArray[np.float64]  # (T,)
    positions_m: NDArray[np.float64]  # (T, N, 2)
    states: NDArray[np.int8]  # (T, N) int8: HONEST, LIAR, STOPPED
    summary: dict[str, Any]  # as `phalanx sim run --json`, less the series

    @property
    def liars(self) -> NDArray[np.bool_]:
        """(N,), who was compromised."""
        liars = np.zeros(self.positions_m.shape[1], bool)
        liars[[told["robot"] - 1 for told in self.summary["compromised"]]] = True
        return liars

    def distances_m(self, goal_m: tuple[float, float]) -> NDArray[np.float64]:
        """(T, N), to the goal. Source: RoboRebound Fig. 8."""
        distances: NDArray[np.float64] = np.sqrt(((self.positions_m - np.array(goal_m)) ** 2).sum(axis=2))
        return distances


@dataclass(frozen=True, slots=True)
class FlockRuns:
    """A table's runs, by case and seed."""

    runs: dict[tuple[str, int], FlockRun]

    def seeds(self) -> list[int]:
        """Those of which each case is there."""
        cases = {case for case, _ in self.runs}
        seeds = {seed for _, seed in self.runs}
        return sorted(seed for seed in seeds if all((case, seed) in self.runs for case in cases))

    def of(self, case: str) -> list[FlockRun]:
        """Return the runs of a case, by ascending seed."""
        return [self.runs[case, seed] for seed in self.seeds()]


def runs_of(table: Table) -> FlockRuns:
    """The runs in a table. Raises: UsageError: a case of it is no run of a flock."""
    try:
        return FlockRuns({split(case): _run(case, rows, table.kept[case]) for case, rows in table.cases.items()})
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise UsageError(f"a case of {table.figure} is no run of a flock: {error}", "measure it again") from error


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
    """(S, T): of each seed, the mean distance to the goal of the robots that are honest; by default of those that are
    so in both cases, so that the same robots are compared. Source: RoboRebound Fig. 8.
    """
    counted = table.of("attacked" if of_the_honest_in_both else case)
    runs = zip(table.of(case), counted, strict=True)
    return np.array([run.distances_m(goal_m)[:, ~same.liars].mean(axis=1) for run, same in runs])


def read_reference() -> dict[str, NDArray[np.float64]]:
    """Each series of data/flock_reference.csv, (T, 4): t_s; mean, least and greatest distance of the honest robots, m.

    Source: an independent flocking script, see the file.
    """
    series: dict[str, list[list[float]]] = {}
    for row in read_data("flock_reference.csv"):
        numbers = [float(row[name]) for name in ("t_s", "mean_m", "least_m", "most_m")]
        series.setdefault(row["series"], []).append(numbers)
    return {name: np.array(rows) for name, rows in series.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Flock:
    """Definition of one of the figures."""

    COLUMNS = COLUMNS
    cases = staticmethod(cases)
    check = staticmethod(runs_of)

    name: str  # of the built-in scenario
    reference: Mapping[str, str]  # by case, the series of data/flock_reference.csv that belongs beside ours, if any
    find: Callable[[FlockRuns], list[Statement]]  # what the paper says, the independent reference, and ours

    def scenario(self, case: str, seed: int) -> Scenario:
        """Return the built-in scenario; in the honest case without its attack."""
        chosen = replace(find_scenario(self.name), seed=seed)
        return chosen if case == "attacked" else replace(chosen, attacks=())

    def origin(self) -> dict[str, Any]:
        """Return the settings that two measurements in one file must share: the whole scenario and the sampling."""
        return {"scenario": repr(self.scenario("attacked", 0)), "every_s": EVERY_S}

    def measure_case(self, case: str, tell: Callable[[float], None]) -> tuple[Rows, dict[str, Any]]:
        """A row for each sample and robot; and the run's summary, less the series and what was the machine's."""
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
        """Return the statements that a table supports."""
        return self.find(runs_of(table))
