"""What the papers say and what we found: statements, told as lines, as JSON, and as one page of all figures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .figure import Figure
from .table import Table

LOW, HIGH = 0.05, 0.95
# Of the papers' figures and tables, those that nobody can measure here.
NOT_MEASURED = (
    ("Qrkey Figs. 1 to 3, 5, 6, Table I", "pictures of the protocol, the robot and the page; its topics"),
    ("Encoded graphs Figs. 1 to 7", "drawings of the method"),
    ("RoboRebound Figs. 1, 3, 4", "photographs and a wiring diagram"),
    ("RoboRebound Fig. 5b", "bytes in and out of a microcontroller: nothing here has its wires"),
    ("RoboRebound Table 3", "parameters; they are the defaults here"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Statement:
    """One thing that the paper or the reference says, and what we found."""

    what: str  # what is compared, with its unit
    paper: str = ""  # what the paper says, in words, or ""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """What came of a figure: statements, or why there are none."""

    figure: Figure
    measured: str = ""  # how much of it, and by which version
    statements: Sequence[Statement] = ()
    failure: str = ""

    @property
    def differing(self) -> list[Statement]:
        """Of the statements, those in which ours is another than the paper's."""
        return [each for each in self.statements if not each.agrees]

    @property
    def verdict(self) -> str:
        """In a few words."""
        if self.failure:
            return f"not measured: {self.failure}"
        agree = len(self.statements) - len(self.differing)
        differs = f"; differs: {'; '.join(each.what for each in self.differing)}" if self.differing else ""
        return f"agrees in {agree} of {len(self.statements)}{differs}"


def page(command: str, version: str, shown: Sequence[Shown]) -> str:
    """The page, as Markdown; pictures lie beside it."""
    today = datetime.now(UTC).strftime("%-d %B %Y")
    parts = [
        "# The papers' figures and tables, and ours",
        f"{today}, `{command}`, phalanx {version}. What differs is a finding; the last column says what was asked.",
        _table(("figure", "shows", ""), ((each.figure.name, each.figure.about, each.verdict) for each in shown)),
    ]
    for each in shown:
        parts += [f"## {each.figure.name}", f"{each.figure.about}. {each.measured}".rstrip()]
        if each.failure:
            parts.append(f"Not measured: {each.failure}")
            continue
        heads = ("", "the paper", "reference", "ours, median (5 … 95 %)", "", "asked, or why")
        parts += [
            f"![{each.figure.about}]({each.figure.name}.png)",
            _table(
                heads,
                (
                    (one.what, one.paper, one.reference, one.ours, "agrees" if one.agrees else "**differs**", one.why)
                    for one in each.statements
                ),
            ),
        ]
    parts += ["## Not measured", _table(("what", "is"), NOT_MEASURED)]
    return "\n\n".join(parts) + "\n"


def _table(heads: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [heads, tuple("---" for _ in heads), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') or ' ' for cell in line)} |" for line in lines)
