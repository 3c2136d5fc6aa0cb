"""Compare the papers' statements with our measurements: as text lines, JSON, and one page of all figures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .figure import Figure
from .table import Table

LOW, HIGH = 0.05, 0.95
# Fewer seeds give no verdict: one seed in ten is often an outlier.
LEAST_SEEDS = 10
NO_VERDICT = "no verdict with fewer than ten seeds"
# Figures and tables of the papers that cannot be measured here.
NOT_MEASURED = (
    ("Qrkey Figs. 1 to 3, 5, 6, Table I", "pictures of the protocol, the robot and the page; its topics"),
    ("Encoded graphs Figs. 1 to 7", "drawings of the method"),
    ("RoboRebound Figs. 1, 3, 4", "photographs and a wiring diagram"),
    ("RoboRebound Fig. 5b", "bytes in and out of a microcontroller: not measured without the hardware"),
    ("RoboRebound Table 3", "parameters; they are the defaults here"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Statement:
    """A statement of the paper or the reference, and our result."""

    what: str  # the compared quantity, with its unit
    paper: str = ""  # the paper's value or wording, or ""
    reference: str = ""  # the independent reference's value, or ""
    ours: str
    agrees: bool | None  # our result meets `asked` within the tolerance in `why`; None: no verdict
    why: str  # the tolerance and its origin; for a disagreement, the reason
    asked: str = "agrees"  # the criterion: our result "agrees", or is "not worse"

    @property
    def differs(self) -> bool:
        """Return whether there is a verdict, and our result fails the criterion."""
        return self.agrees is not None and not self.agrees

    @property
    def verdict(self) -> str:
        """Return the verdict in one or two words."""
        return "-" if self.agrees is None else self.asked if self.agrees else "differs"


@dataclass(frozen=True, slots=True)
class Report:
    """Report of one figure."""

    rows: list[dict[str, Any]]  # for JSON
    lines: list[str]
    more: dict[str, Any]  # further fields of the JSON


def compare(figure: Figure, table: Table) -> list[Statement]:
    """Return the figure's statements, without verdicts if the table has fewer than LEAST_SEEDS seeds."""
    statements: list[Statement] = figure.body.compare(table)
    return [replace(each, agrees=None) for each in statements] if _has_few_seeds(table) else statements


def _has_few_seeds(table: Table) -> bool:
    return table.seeds is not None and table.seeds < LEAST_SEEDS


def report(figure: Figure, table: Table) -> Report:
    """Return the report of a measured figure."""
    if hasattr(figure.body, "report"):
        own: Report = figure.body.report(table)
        return own
    statements = compare(figure, table)
    heads = ("", "paper", "reference", "ours, median (5 … 95 % of seeds)", "", "asked")
    rows = [
        (each.what, each.paper or "-", each.reference or "-", each.ours, each.verdict, each.why) for each in statements
    ]
    widths = [max(len(row[k]) for row in (heads, *rows)) for k in range(len(heads))]
    lines = ["  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)) for row in (heads, *rows)]
    last = f"{NO_VERDICT}: {table.seeds}" if _has_few_seeds(table) else last_line(statements)
    return Report([asdict(each) for each in statements], [*map(str.rstrip, lines), last], {})


def last_line(statements: list[Statement]) -> str:
    """Summarise the agreeing statements by criterion, and the differing ones with their tolerance."""
    met = {
        asked: [each.what for each in statements if each.agrees and each.asked == asked]
        for asked in dict.fromkeys(each.asked for each in statements)
    }
    parts = [f"{asked}: {'; '.join(whats)}" for asked, whats in met.items() if whats]
    differ = [f"{each.what}: {each.ours} (asked: {each.why})" for each in statements if each.differs]
    return ".  ".join([*parts, f"differs: {'; '.join(differ)}" if differ else "nothing differs"])


def quantiles(values: NDArray[np.float64], form: str = ".1f") -> str:
    """Return `median (5 % … 95 %)`; the two quantiles are measured values, not interpolated."""
    low, high = np.quantile(values, (LOW, HIGH), method="nearest")
    return f"{np.median(values):{form}} ({low:{form}} … {high:{form}})"


def band(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the median, the 5 % and the 95 % quantile over the seeds, each (T,)."""
    low, middle, high = np.quantile(values, (LOW, 0.5, HIGH), axis=0)
    return middle, low, high


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """Result of a figure for the page: its statements, or the reason why there are none."""

    figure: Figure
    measured: str = ""  # the extent of the measurement and the version that made it
    statements: Sequence[Statement] = ()
    failure: str = ""

    @property
    def differing(self) -> list[Statement]:
        """Return the statements for which our result fails the criterion."""
        return [each for each in self.statements if each.differs]

    @property
    def agreeing(self) -> int:
        """Return the number of statements for which our result meets the criterion."""
        return sum(bool(each.agrees) for each in self.statements)

    @property
    def verdict(self) -> str:
        """Return the verdict on the figure in one line."""
        if self.failure:
            return f"not measured: {self.failure}"
        if all(each.agrees is None for each in self.statements):
            return NO_VERDICT
        judged = [each for each in self.statements if each.agrees is not None]
        counts = Counter(each.asked for each in judged if each.agrees)
        met = " and ".join(f"{asked} in {n}" for asked, n in counts.items()) or f"{judged[0].asked} in 0"
        differs = f"; differs: {'; '.join(each.what for each in self.differing)}" if self.differing else ""
        return f"{met} of {len(judged)}{differs}"


def page(command: str, version: str, shown: Sequence[Shown]) -> str:
    """Return the page of all figures as Markdown; it links pictures in the same folder."""
    today = datetime.now(UTC).strftime("%-d %B %Y")
    parts = [
        "# The papers' figures and tables, and ours",
        f"{today}, `{command}`, phalanx {version}. Differences are findings; the last column gives the criterion.",
        _table(("figure", "shows", ""), ((each.figure.name, each.figure.about, each.verdict) for each in shown)),
    ]
    for each in shown:
        parts += [f"## {each.figure.name}", f"{each.figure.about}. {each.measured}".rstrip()]
        if each.failure:
            parts.append(f"Not measured: {each.failure}")
            continue
        heads = ("", "the paper", "reference", "ours, median (5 … 95 % of seeds)", "", "asked, or why")
        parts += [
            f"![{each.figure.about}]({each.figure.name}.png)",
            _table(
                heads,
                ((one.what, one.paper, one.reference, one.ours, _bold(one), one.why) for one in each.statements),
            ),
        ]
    parts += ["## Not measured", _table(("what", "is"), NOT_MEASURED)]
    return "\n\n".join(parts) + "\n"


def _bold(statement: Statement) -> str:
    return f"**{statement.verdict}**" if statement.differs else statement.verdict


def _table(heads: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [heads, tuple("---" for _ in heads), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') or ' ' for cell in line)} |" for line in lines)
