"""RoboRebound Fig. 7: bandwidth and storage for denser flocks (a, b), and for larger ones at one spacing (c, d).

f_max is 2: at 64 m a robot in the corner hears three others. Their tokens keep it alive, though it has no quorum.
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
T_AUDIT_S = 4.0  # the paper's
BANDWIDTH, STORAGE = "audit_bytes_per_s", "stored_bytes"
NEAR = 0.1  # by how much the log may differ from the paper's sum


def point(robots: int, spacing_m: int) -> str:
    """Return the name of a point, less its seed."""
    return f"{robots} robots;{spacing_m} m"


def cases(seeds: int) -> list[str]:
    """(a) and (b), and what (c) and (d) have beside."""
    dense = [point(robots, spacing_m) for robots in SIZES for spacing_m in SPACINGS_M]
    return costs.cases_of([*dense, *(point(robots, SPACINGS_M[-1]) for robots in LARGER)], seeds)


def scenario_of(case: str) -> Scenario:
    """So many robots at that spacing, as they set out for (500, 500)."""
    robots, spacing, _ = case.split(";")
    base = Scenario(name="bti-fig7", duration_s=costs.DURATION_S, bti=BtiConfig(f_max=F_MAX), seed=seed_of(case))
    return base.with_options(robots=int(robots.split()[0]), spacing_m=float(spacing.split()[0]))


def origin() -> dict[str, str]:
    """Return the settings that two measurements in one file must share."""
    return {"scenario": repr(scenario_of(f"{point(SIZES[0], SPACINGS_M[0])};seed 0"))}


def measure_case(case: str, tell: Callable[[float], None]) -> Rows:
    """One run."""
    return costs.measure_costs(scenario_of(case), tell)


def compare(table: Table) -> list[Statement]:
    """Compare ours with what §5.2 says of Fig. 7."""
    near, far = ([point(robots, spacing_m) for robots in SIZES] for spacing_m in (SPACINGS_M[0], SPACINGS_M[-1]))
    sizes = [point(robots, SPACINGS_M[-1]) for robots in (*SIZES, *LARGER)]
    told = []
    for column, words, parts in ((BANDWIDTH, "audits sent, kB/s", "a c"), (STORAGE, "kept, kB", "b d")):
        of_near, of_far, of_sizes = (costs.medians(table, points, column) for points in (near, far, sizes))
        dense, constant = parts.split()
        hundred = of_sizes[SIZES.index(100)]
        told += [
            Statement(
                what=f"{dense}: {words}, 16 to 100 robots at 4 m",
                paper="higher for the larger",
                ours=_kilo(of_near),
                agrees=bool((np.diff(of_near) > 0).all()),
                why="each more than the one before: all hear all",
            ),
            Statement(
                what=f"{dense}: {words}, 16 to 100 robots at 64 m",
                paper="the effect disappears",
                ours=_kilo(of_far),
                agrees=bool(of_far[-1] / of_far[0] <= (of_near[-1] / of_near[0]) / 2),
                why="100 robots cost at most half as many times what 16 do as at 4 m: edges are left",
            ),
            Statement(
                what=f"{constant}: {words}, 16 to 324 robots at 64 m",
                paper="levels off, with a small increase by the edges",
                ours=_kilo(of_sizes),
                agrees=bool(of_sizes[-1] - hundred <= (hundred - of_sizes[0]) / 2),
                why="from 100 to 324 robots at most half of what it grows from 16 to 100",
            ),
        ]
    points = list(dict.fromkeys([*near, *far, *sizes]))
    ratio = costs.medians(table, points, "log_bytes_per_s") / papers_log(table, points)
    told.append(
        Statement(
            what="growth of the log, of the paper's sum for so many neighbours",
            paper="1",
            ours=f"{ratio.min():.2f} to {ratio.max():.2f}",
            agrees=bool(np.abs(ratio - 1).max() <= NEAR),
            why=f"every median within {NEAR:.0%}: entries of 34, 26 and 34 bytes (§5.2)",
        )
    )
    return [*told, costs.check_no_harm(table)]


def _kilo(values: NDArray[np.float64]) -> str:
    return " ".join(f"{each / 1000:.2f}" for each in values)


def papers_log(table: Table, points: list[str]) -> NDArray[np.float64]:
    """Return (P,) bytes a second by which logs grow, by the paper's sum for so many neighbours."""
    return np.array([costs.paper_log_bytes_per_s(each) for each in costs.medians(table, points, "neighbours")])
