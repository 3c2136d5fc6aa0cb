"""RoboRebound Fig. 7: bandwidth and storage by density of the flock (a, b), and by its size at one spacing (c, d).

f_max is 2. At 64 m a robot in a corner has three neighbours: enough tokens to keep running, but no quorum.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from phalanx.config import BtiConfig
from phalanx.papers.statement import Statement
from phalanx.papers.table import Rows, Table, seed_of
from phalanx.scenarios.scenario import Scenario

from . import costs

COLUMNS = costs.COLUMNS
F_MAX = 2
SPACINGS_M, SIZES = (4, 8, 16, 32, 64), (16, 36, 64, 100)
LARGER = (144, 196, 256, 324)
T_AUDIT_S = 4.0  # as in the paper
BANDWIDTH, STORAGE = "audit_bytes_per_s", "stored_bytes"
NEAR = 0.1  # largest relative difference of the log growth from the paper's estimate


def point(robots: int, spacing_m: int) -> str:
    """Return the name of a point, without the seed."""
    return f"{robots} robots;{spacing_m} m"


def cases(seeds: int) -> list[str]:
    """Return the cases of (a) and (b), then those that only (c) and (d) need."""
    dense = [point(robots, spacing_m) for robots in SIZES for spacing_m in SPACINGS_M]
    return costs.cases_of([*dense, *(point(robots, SPACINGS_M[-1]) for robots in LARGER)], seeds)


def scenario_of(case: str) -> Scenario:
    """Return the scenario of a case: the grid of robots as it starts towards (500, 500)."""
    robots, spacing, _ = case.split(";")
    base = Scenario(name="bti-fig7", duration_s=costs.DURATION_S, bti=BtiConfig(f_max=F_MAX), seed=seed_of(case))
    return base.with_options(robots=int(robots.split()[0]), spacing_m=float(spacing.split()[0]))


def origin() -> dict[str, str]:
    """Return the settings that must be equal for two measurements to share a CSV."""
    return {"scenario": repr(scenario_of(f"{point(SIZES[0], SPACINGS_M[0])};seed 0"))}


def measure_case(case: str, tell: Callable[[float], None]) -> Rows:
    """Run one case and return its row."""
    return costs.measure_costs(scenario_of(case), tell)


def compare(table: Table) -> list[Statement]:
    """Compare our measurements with the statements about Fig. 7 in §5.2."""
    near, far = ([point(robots, spacing_m) for robots in SIZES] for spacing_m in (SPACINGS_M[0], SPACINGS_M[-1]))
    sizes = [point(robots, SPACINGS_M[-1]) for robots in (*SIZES, *LARGER)]
    statements = []
    for column, quantity, parts in ((BANDWIDTH, "audits sent, kB/s", "a c"), (STORAGE, "kept, kB", "b d")):
        of_near, of_far, of_sizes = (costs.medians(table, points, column) for points in (near, far, sizes))
        dense, constant = parts.split()
        hundred = of_sizes[SIZES.index(100)]
        statements += [
            Statement(
                what=f"{dense}: {quantity}, 16 to 100 robots at 4 m",
                paper="higher for the larger",
                ours=_kilo(of_near),
                agrees=bool((np.diff(of_near) > 0).all()),
                why="each more than the one before: all robots are in range of each other",
            ),
            Statement(
                what=f"{dense}: {quantity}, 16 to 100 robots at 64 m",
                paper="the effect disappears",
                ours=_kilo(of_far),
                agrees=bool(of_far[-1] / of_far[0] <= (of_near[-1] / of_near[0]) / 2),
                why="the ratio of 100 to 16 robots is at most half of that at 4 m; the rest is due to edges",
            ),
            Statement(
                what=f"{constant}: {quantity}, 16 to 324 robots at 64 m",
                paper="levels off, with a small increase by the edges",
                ours=_kilo(of_sizes),
                agrees=bool(of_sizes[-1] - hundred <= (hundred - of_sizes[0]) / 2),
                why="from 100 to 324 robots it grows at most half as much as from 16 to 100",
            ),
        ]
    points = list(dict.fromkeys([*near, *far, *sizes]))
    ratio = costs.medians(table, points, "log_bytes_per_s") / papers_log(table, points)
    statements.append(
        Statement(
            what="growth of the log, relative to the paper's estimate for as many neighbours",
            paper="1",
            ours=f"{ratio.min():.2f} to {ratio.max():.2f}",
            agrees=bool(np.abs(ratio - 1).max() <= NEAR),
            why=f"every median within {NEAR:.0%}: entries of 34, 26 and 34 bytes (§5.2)",
        )
    )
    return [*statements, costs.check_no_harm(table)]


def _kilo(values: NDArray[np.float64]) -> str:
    return " ".join(f"{each / 1000:.2f}" for each in values)


def papers_log(table: Table, points: list[str]) -> NDArray[np.float64]:
    """Return (P,) log growth in bytes per second, estimated by the paper for the measured number of neighbours."""
    return np.array([costs.paper_log_bytes_per_s(each) for each in costs.medians(table, points, "neighbours")])
