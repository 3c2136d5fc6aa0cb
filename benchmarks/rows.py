"""What a benchmark says: one measured number a row, with the limit it is held to, if it has one."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One number.

    Args:
        section: 1 sealing, 2 latency, 3 the large swarm; 0 for what is only good to know.
        what: was measured.
        measured: the number.
        unit: of it.
        limit: what it is held to, or None.
        at_least: the limit is the least, not the most.
        note: how it came about.
    """

    section: int
    what: str
    measured: float
    unit: str
    limit: float | None = None
    at_least: bool = False
    note: str = ""

    @property
    def holds(self) -> bool | None:
        """Whether the limit is kept; None without one."""
        if self.limit is None:
            return None
        return self.measured >= self.limit if self.at_least else self.measured <= self.limit

    def json(self) -> dict[str, Any]:
        return asdict(self) | {"holds": self.holds}


def print_table(rows: Sequence[Row]) -> None:
    wide = max(len(row.what) for row in rows)
    print(f"{'':{wide + 3}} {'measured':>10} {'':8} {'limit':>9}")
    for row in rows:
        limit = "" if row.limit is None else f"{'≥' if row.at_least else '≤'} {row.limit:g}"
        verdict = {True: "holds", False: "EXCEEDED", None: ""}[row.holds]
        number = f"{row.section or '·'} {row.what:{wide}}  {row.measured:10.4g} {row.unit:8} {limit:>9}  {verdict:9}"
        print(f"{number} {row.note}".rstrip())


def timed(job: Callable[[], object], count: int) -> float:
    """Microseconds a call."""
    gc.collect()
    began = time.perf_counter()
    for _ in range(count):
        job()
    return (time.perf_counter() - began) / count * 1e6


def ratio(section: int, what: str, ours: list[float], theirs: list[float], *, limit: float | None = None) -> Row:
    """Ours over theirs: the median over pairs measured one after the other. Both are in microseconds."""
    ratios = [mine / other for mine, other in zip(ours, theirs, strict=True)]
    return Row(
        section=section,
        what=what,
        measured=statistics.median(ratios),
        unit="times",
        limit=limit,
        note=f"{statistics.median(ours):.1f} µs against {statistics.median(theirs):.1f} µs; "
        f"{min(ratios):.2f} to {max(ratios):.2f} in {len(ratios)} pairs",
    )
