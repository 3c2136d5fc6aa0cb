"""RoboRebound Fig. 7: bandwidth and storage for denser flocks (a, b), and for larger ones at one spacing (c, d).

f_max is 2: at 64 m a robot in the corner hears three others. Their tokens keep it alive, though it has no quorum.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from phalanx.config import BtiConfig
from phalanx.papers.plot import BLUE, GREEN, ORANGE, VERMILION, Picture, legend_above
from phalanx.papers.statement import Statement
from phalanx.papers.table import Rows, Table, seed_of
from phalanx.scenarios.scenario import Scenario

from . import costs

COLUMNS = costs.COLUMNS
F_MAX = 2
SPACINGS_M, SIZES = (4, 8, 16, 32, 64), (16, 36, 64, 100)
LARGER = (144, 196, 256, 324)
COLOURS = (BLUE, GREEN, VERMILION, ORANGE)
T_AUDIT_S = 4.0  # the paper's
BANDWIDTH, STORAGE = "audit_bytes_per_s", "stored_bytes"
NEAR = 0.1  # by how much the log may differ from the paper's sum


def _point(robots: int, spacing_m: int) -> str:
    return f"{robots} robots;{spacing_m} m"


def cases(seeds: int) -> list[str]:
    """(a) and (b), and what (c) and (d) have beside."""
    dense = [_point(robots, spacing_m) for robots in SIZES for spacing_m in SPACINGS_M]
    return costs.cases_of([*dense, *(_point(robots, SPACINGS_M[-1]) for robots in LARGER)], seeds)


def scenario_of(case: str) -> Scenario:
    """So many robots at that spacing, as they set out for (500, 500)."""
    robots, spacing, _ = case.split(";")
    base = Scenario(name="bti-fig7", duration_s=costs.DURATION_S, bti=BtiConfig(f_max=F_MAX), seed=seed_of(case))
    return base.with_options(robots=int(robots.split()[0]), spacing_m=float(spacing.split()[0]))


def origin() -> dict[str, str]:
    """Return the settings that two measurements in one file must share."""
    return {"scenario": repr(scenario_of(f"{_point(SIZES[0], SPACINGS_M[0])};seed 0"))}


def measure_case(case: str, tell: Callable[[float], None]) -> Rows:
    """One run."""
    return costs.measure_costs(scenario_of(case), tell)


def compare(table: Table) -> list[Statement]:
    """Compare ours with what §5.2 says of Fig. 7."""
    near, far = ([_point(robots, spacing_m) for robots in SIZES] for spacing_m in (SPACINGS_M[0], SPACINGS_M[-1]))
    sizes = [_point(robots, SPACINGS_M[-1]) for robots in (*SIZES, *LARGER)]
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
    ratio = costs.medians(table, points, "log_bytes_per_s") / _papers_log(table, points)
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


def _papers_log(table: Table, points: list[str]) -> NDArray[np.float64]:
    return np.array([costs.paper_log_bytes_per_s(each) for each in costs.medians(table, points, "neighbours")])


def draw(table: Table, picture: Picture) -> str:
    """(a) to (d), as in the paper."""
    (a, b), (c, d) = picture.subplots(2, 2)
    for column, dense, constant in ((BANDWIDTH, a, c), (STORAGE, b, d)):
        for robots, colour in zip(SIZES, COLOURS, strict=True):
            points = [_point(robots, spacing_m) for spacing_m in SPACINGS_M]
            along = np.array(SPACINGS_M, float)
            costs.line(dense, along, table, points, column, colour, f"{robots} robots")
            dense.plot(along, _papers(table, points, column), "s", mfc="none", color=colour, ms=4)
        points = [_point(robots, SPACINGS_M[-1]) for robots in (*SIZES, *LARGER)]
        along = np.array((*SIZES, *LARGER), float)
        costs.line(constant, along, table, points, column, BLUE, f"{SPACINGS_M[-1]} m")
        constant.plot(along, _papers(table, points, column), "s", mfc="none", color="black", ms=4, label="paper's sum")
        what = "sent by a robot (kB/s)" if column == BANDWIDTH else "kept by a robot, at most (kB)"
        dense.set(xlabel="spacing (m)", ylabel=what, xscale="log", ylim=(0, None))
        dense.set_xticks(SPACINGS_M, map(str, SPACINGS_M))
        dense.minorticks_off()
        constant.set(xlabel="robots", ylabel=what, ylim=(0, None))
    for axes, letter in ((a, "a"), (b, "b"), (c, "c"), (d, "d")):
        axes.set_ylabel(f"{letter}: {axes.get_ylabel()}")
        legend_above(axes, columns=4)
    return costs.footer(table)


def _papers(table: Table, points: list[str], column: str) -> NDArray[np.float64]:
    """The log to f_max + 1 auditors; or a round's log and two checkpoints: kB, by the paper's sums."""
    if column == BANDWIDTH:
        return (F_MAX + 1) * _papers_log(table, points) / 1000
    return np.array([costs.paper_stored_bytes(T_AUDIT_S, n) for n in costs.medians(table, points, "neighbours")]) / 1000
