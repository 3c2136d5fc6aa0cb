"""The runs behind Figures 8 and 9: a CSV that grows by whole runs, and what is counted in it.

    # phalanx bti-fig8 {origin as JSON}
    case,seed,t_s,robot,state,x_m,y_m
    honest,0,0,1,honest,0.000,0.000           one line a robot and sample; state: honest, liar, stopped
    # end {case, seed and the run's summary as JSON}

Only this file reads or writes that CSV (growing_table.py says how). Lines that no `# end` follows belong to a run that
was cut short.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phalanx.errors import UsageError
from phalanx.experiments.growing_table import ELSEWHERE, GrowingTable, read_growing_table

HONEST, LIAR, STOPPED = 0, 1, 2
STATES = ("honest", "liar", "stopped")
COLUMNS = "case,seed,t_s,robot,state,x_m,y_m"
END = "# end "


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Where runs come from. All of it must agree for two measurements to share a file.

    Args:
        figure: bti-fig8 or bti-fig9.
        scenario: what was run, all of it, as text.
        every_s: from one sample to the next.
        version: of the program, with its commit if known: another one may run the same scenario otherwise.
    """

    figure: str
    scenario: str
    every_s: float
    version: str = ""


@dataclass(frozen=True, slots=True)
class FlockRun:
    """One run.

    Args:
        case: honest or attacked.
        seed: of the run.
        times_s: (T,).
        positions_m: (T, N, 2).
        states: (T, N) int8: HONEST, LIAR, STOPPED.
        summary: as `phalanx sim run --json`, less the series.
    """

    case: str
    seed: int
    times_s: NDArray[np.float64]
    positions_m: NDArray[np.float64]
    states: NDArray[np.int8]
    summary: dict[str, Any]

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
class FlockTable:
    """A CSV's origin and runs, by case and seed."""

    origin: Origin
    runs: dict[tuple[str, int], FlockRun]

    def seeds(self) -> list[int]:
        """Those of which each case is there."""
        cases = {case for case, _ in self.runs}
        seeds = {seed for _, seed in self.runs}
        return sorted(seed for seed in seeds if all((case, seed) in self.runs for case in cases))


def read_flock_table(path: Path) -> FlockTable:
    """The table in a CSV.

    Raises: UsageError: no such file, or not one of ours. Unavailable: it cannot be read.
    """
    return _parse(path, read_growing_table(path))[0]


class FlockFile(GrowingTable):
    """The CSV while it grows, by whole runs.

    Args:
        path: made if it is not there, with its folder.
        origin: where the runs will come from.
    """

    def __init__(self, path: Path, origin: Origin) -> None:
        super().__init__(path, f"{_mark(origin)}{json.dumps(asdict(origin))}\n{COLUMNS}\n")
        self.done: set[tuple[str, int]] = set()
        self._origin = origin

    def append(self, run: FlockRun) -> None:
        """Write a run, now."""
        lines = [
            f"{run.case},{run.seed},{t_s:g},{robot},{STATES[state]},{x_m:.3f},{y_m:.3f}\n"
            for t_s, positions, states in zip(run.times_s, run.positions_m, run.states, strict=True)
            for robot, ((x_m, y_m), state) in enumerate(zip(positions, states, strict=True), start=1)
        ]
        end = {"case": run.case, "seed": run.seed, **run.summary}
        self._write("".join(lines) + END + json.dumps(end) + "\n")
        self.done.add((run.case, run.seed))

    def _whole(self, data: bytes) -> int:
        table, whole = _parse(self.path, data)
        for name in ("figure", "scenario", "every_s", "version"):
            if getattr(table.origin, name) != getattr(self._origin, name):
                raise UsageError(f"{self.path} was measured with another {name}", ELSEWHERE)
        self.done = set(table.runs)
        return whole


def _mark(origin: Origin) -> str:
    return f"# phalanx {origin.figure} "


def _parse(path: Path, data: bytes) -> tuple[FlockTable, int]:
    """The table, and how many bytes of the file it takes."""
    lines = _whole_lines(path, data)
    origin, whole = _parse_head(path, lines)
    runs: dict[tuple[str, int], FlockRun] = {}
    rows: list[list[str]] = []
    for number, line, end in lines:
        try:
            if not line.startswith(END):
                rows.append(_row(line))
                continue
            run = _run(rows, json.loads(line.removeprefix(END)))
        except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
            raise UsageError(f"line {number} of {path} is not one of ours", ELSEWHERE) from error
        runs[run.case, run.seed] = run
        rows, whole = [], end
    return FlockTable(origin, runs), whole


def _whole_lines(path: Path, data: bytes) -> Iterator[tuple[int, str, int]]:
    at = 0
    for number, line in enumerate(data[: data.rfind(b"\n") + 1].split(b"\n")[:-1], start=1):
        at += len(line) + 1
        try:
            yield number, line.decode(), at
        except UnicodeDecodeError as error:
            raise UsageError(f"{path} is not a CSV of ours", ELSEWHERE) from error


def _parse_head(path: Path, lines: Iterator[tuple[int, str, int]]) -> tuple[Origin, int]:
    first, second = next(lines, (1, "", 0)), next(lines, (2, "", 0))
    try:
        origin = Origin(**json.loads(first[1].partition("{")[1] + first[1].partition("{")[2]))
        if not first[1].startswith(_mark(origin)) or second[1] != COLUMNS:
            raise ValueError
    except (ValueError, TypeError) as error:
        raise UsageError(f"{path} is not a CSV of ours", ELSEWHERE) from error
    return origin, second[2]


def _row(line: str) -> list[str]:
    row = line.split(",")
    if len(row) != len(COLUMNS.split(",")):
        raise ValueError(line)
    return row


def _run(rows: list[list[str]], summary: dict[str, Any]) -> FlockRun:
    case, seed, robots = str(summary.pop("case")), int(summary.pop("seed")), int(summary["robots"])
    if {(row[0], int(row[1])) for row in rows} != {(case, seed)}:
        raise ValueError(case)
    places = np.array([[float(row[2]), float(row[5]), float(row[6])] for row in rows]).reshape(-1, robots, 3)
    if [int(row[3]) for row in rows] != list(range(1, robots + 1)) * len(places) or not np.isfinite(places).all():
        raise ValueError(case)
    return FlockRun(
        case=case,
        seed=seed,
        times_s=places[:, 0, 0],
        positions_m=places[:, :, 1:],
        states=np.array([STATES.index(row[4]) for row in rows], np.int8).reshape(-1, robots),
        summary=summary | {"seed": seed},
    )
