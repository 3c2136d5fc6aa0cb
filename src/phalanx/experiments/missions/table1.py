"""Encoded graphs Table I: how the knowledge of the office is divided among four robots that explore it together."""

from __future__ import annotations

import numpy as np

from phalanx.experiments.plot import BLUE, Picture, boxes
from phalanx.experiments.statement import Statement, quantiles
from phalanx.experiments.table import Rows, Table

from .explore import COLUMNS, KNOWS_M, LANDMARKS, ROBOTS, cases, ends, measure_case

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
    out, area_pct = [], 100 * _ends(table, AREA)
    for words, papers, ours, near, why in (
        (f"hashes found of {LANDMARKS}", PAPER_FOUND, _ends(table, FOUND), 2, "the paper's routes are not known"),
        (
            "area known, %",
            PAPER_AREA_PCT,
            area_pct,
            10,
            f"floor swept within {KNOWS_M:g} m; the paper says not how it counts",
        ),
    ):
        out += [
            Statement(
                what=f"{words}, robot {rank + 1} by rank",
                paper=str(paper),
                ours=quantiles(ours[:, rank], ".0f"),
                agrees=abs(float(np.median(ours[:, rank])) - paper) <= near,
                why=f"median within {near}: {why}",
            )
            for rank, paper in enumerate(sorted(papers))
        ]
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
        boxes(axes, list(values.T), BLUE, positions=ranks, widths=0.4)
        axes.plot([], [], color=BLUE, label="phalanx, box and 5 to 95 % of seeds")
        axes.plot(ranks, sorted(paper), "o", mfc="none", mec="black", ms=7, label="paper")
        axes.set(xlabel="robot, by rank", ylabel=words, ylim=(0, None))
        axes.legend(fontsize=8, loc="lower right")
