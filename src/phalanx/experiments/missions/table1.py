"""Encoded graphs Table I: how the knowledge of the office is divided among four robots that explore it together."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phalanx.experiments.plot import BLUE, lines_in
from phalanx.experiments.statement import Statement, quantiles
from phalanx.experiments.table import Rows, Table

from .explore import COLUMNS, KNOWS_M, LANDMARKS, ROBOTS, cases, ends, measure_case

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

__all__ = ["COLUMNS", "cases", "compare", "draw", "measure_case"]

# Purple, orange, red, cyan.
PAPER_FOUND = (12, 16, 15, 11)
PAPER_AREA_PCT = (23, 29, 41, 27)
FOUND, AREA = COLUMNS.index("found"), COLUMNS.index("area")


def _ends(table: Table, column: int) -> Rows:
    """(seeds, ROBOTS), each seed's in ascending order: which robot is which is chance."""
    return np.sort([ends(rows)[:, column] for rows in table.cases.values()], axis=1)


def compare(table: Table) -> list[Statement]:
    """Table I, and ours: robots by rank."""
    found, area_pct = _ends(table, FOUND), 100 * _ends(table, AREA)
    out = []
    for rank in range(ROBOTS):
        paper = sorted(PAPER_FOUND)[rank]
        out.append(
            Statement(
                what=f"hashes found of {LANDMARKS}, robot {rank + 1} by rank",
                paper=str(paper),
                ours=quantiles(found[:, rank], ".0f"),
                agrees=abs(float(np.median(found[:, rank])) - paper) <= 4,
                why="median within 4: the paper's routes are not known",
            )
        )
    for rank in range(ROBOTS):
        paper = sorted(PAPER_AREA_PCT)[rank]
        out.append(
            Statement(
                what=f"area known, %, robot {rank + 1} by rank",
                paper=str(paper),
                ours=quantiles(area_pct[:, rank], ".0f"),
                agrees=abs(float(np.median(area_pct[:, rank])) - paper) <= 10,
                why=f"median within 10: floor swept within {KNOWS_M:g} m; the paper says not how it counts",
            )
        )
    most = area_pct.max(axis=1)
    out.append(
        Statement(
            what="most raw knowledge of one robot, %",
            paper="41",
            ours=quantiles(most, ".0f"),
            agrees=bool(np.all(most <= max(PAPER_AREA_PCT))),
            why="no more than the paper's, in every seed",
        )
    )
    return out


def draw(table: Table, picture: Picture) -> None:
    """Ours as boxes over the seeds, the paper's hollow."""
    for axes, values, paper, words in zip(
        picture.subplots(1, 2),
        (_ends(table, FOUND), 100 * _ends(table, AREA)),
        (PAPER_FOUND, PAPER_AREA_PCT),
        (f"hashes found of {LANDMARKS}", "area known (%)"),
        strict=True,
    ):
        ranks = np.arange(1, ROBOTS + 1)
        axes.boxplot(
            list(values.T),
            positions=ranks,
            widths=0.4,
            whis=(5, 95),
            showfliers=False,
            **lines_in(BLUE),
        )
        axes.plot([], [], color=BLUE, label="phalanx, box and 5 to 95 % of seeds")
        axes.plot(ranks, sorted(paper), "o", mfc="none", mec="black", ms=7, label="paper")
        axes.set(xlabel="robot, by rank", ylabel=words, ylim=(0, None))
        axes.legend(fontsize=8, loc="lower right")
