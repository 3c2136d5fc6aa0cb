"""What the papers say, and what we found: statements, and how they are told."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .figure import Figure
from .table import Table

LOW, HIGH = 0.05, 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class Statement:
    """One thing that the paper or the reference says, and what we found."""

    what: str  # what is compared, with its unit
    paper: str  # what the paper says, in words
    reference: str = ""  # what the independent reference has, or ""
    ours: str
    agrees: bool  # whether they agree, by the tolerance named in `why`
    why: str  # the tolerance, and where it comes from; of a disagreement, the reason


@dataclass(frozen=True, slots=True)
class Report:
    """What is told of a figure."""

    rows: list[dict[str, Any]]  # for JSON
    lines: list[str]
    more: dict[str, Any]  # what JSON says beside the rows


def report(figure: Figure, table: Table) -> Report:
    """What is told of a figure that was measured."""
    if hasattr(figure.body, "report"):
        own: Report = figure.body.report(table)
        return own
    statements: list[Statement] = figure.body.compare(table)
    heads = ("", "paper", "reference", "ours, median (5 … 95 %)", "", "asked")
    rows = [
        (each.what, each.paper or "-", each.reference or "-", each.ours, "ok" if each.agrees else "NO", each.why)
        for each in statements
    ]
    widths = [max(len(row[k]) for row in (heads, *rows)) for k in range(len(heads))]
    lines = ["  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)) for row in (heads, *rows)]
    return Report([asdict(each) for each in statements], [*map(str.rstrip, lines), last_line(statements)], {})


def last_line(statements: list[Statement]) -> str:
    """What agrees with the paper and the reference, what does not, and why."""
    agree = [each.what for each in statements if each.agrees]
    differ = [f"{each.what}: {each.ours} (asked: {each.why})" for each in statements if not each.agrees]
    said = [f"agrees: {'; '.join(agree)}"] if agree else []
    return ".  ".join([*said, f"does not agree: {'; '.join(differ)}" if differ else "nothing disagrees"])


def quantiles(values: NDArray[np.float64], form: str = ".1f") -> str:
    """`median (5 % … 95 %)` in words."""
    low, middle, high = np.quantile(values, (LOW, 0.5, HIGH), method="nearest")
    return f"{middle:{form}} ({low:{form}} … {high:{form}})"


def band(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Median, 5 % and 95 % quantile over the seeds, each (T,)."""
    low, middle, high = np.quantile(values, (LOW, 0.5, HIGH), axis=0)
    return middle, low, high
