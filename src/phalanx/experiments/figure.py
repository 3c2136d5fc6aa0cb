"""What a figure of a paper is: one record for each.

What is measured, compared and drawn is a module of this package, and only its name stands here until somebody asks: the
list of figures loads none of them. Rows go to a CSV (table.py), and the figure is drawn from the CSV alone (plot.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from phalanx.errors import UsageError

MATPLOTLIB_HINT = "make setup, or pip install '.[reproduce]' in a clone"


@dataclass(frozen=True, slots=True)
class Option:
    """What can be asked of a figure."""

    name: str  # as typed, without the dashes
    default: float | str  # of the type that it takes
    help: str
    least: float = 0.0  # of a number
    most: float = float("inf")


SEEDS = Option("seeds", 20, "Runs of each case.", 1, 10_000)
QUICK = {"seeds": 2}


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One figure or table of a paper.

    What it is made by has `draw(table, picture)`, which draws into an empty picture and returns the footer or None.
    Most figures are measured case by case. Those have

    - `COLUMNS`;
    - `cases(seeds)`: the cases' names, in the order to measure them;
    - `measure_case(case, tell)`: the rows of one, and what else is kept of it if anything is;
    - `compare(table)`: the statements;
    - `origin()`, if more than the version must agree for two measurements to share a file.

    The others have `measure(folder, on_progress, **options)`, the CSV's path, and `report(table)` beside `compare`.
    """

    name: str  # as typed, and of its files
    about: str  # what it shows, one line with its place in the paper
    made_by: Any  # what has that: a module of this package, "module:name" in one, or anything else
    example: str = "--seeds 5"  # options that somebody may want
    options: tuple[Option, ...] = (SEEDS,)  # what can be asked of it
    quick: Mapping[str, float | str] = field(default_factory=lambda: QUICK)  # what is asked for a small form of it
    has_login: bool = False  # whether it asks for a broker's login
    # Whether it measures how long something takes: then nothing may run beside it.
    alone: bool = False
    counted: str = "cases"  # what is counted while it is measured
    size_in: tuple[float, float] = (11.0, 5.5)

    @property
    def body(self) -> Any:
        """What it is made by."""
        return resolve_name(f"{__package__}.{self.made_by}") if isinstance(self.made_by, str) else self.made_by

    def csv(self, folder: Path) -> Path:
        """Where its rows are."""
        return folder / f"{self.name}.csv"

    def asked(self, said: Mapping[str, Any], *, quick: bool = False) -> dict[str, Any]:
        """All that is asked of it: what was said, and where nothing was, the small form's or the default."""
        small = self.quick if quick else {}
        return {each.name: small.get(each.name, each.default) for each in self.options} | dict(said)

    def check(self, said: Mapping[str, Any]) -> None:
        """Numbers are within their bounds. Raises: UsageError: one is not."""
        for option in self.options:
            value = said.get(option.name, option.default)
            if not isinstance(value, str) and not option.least <= value <= option.most:
                raise UsageError(f"{value:g} {option.name}", f"{option.least:g} to {option.most:g}")
