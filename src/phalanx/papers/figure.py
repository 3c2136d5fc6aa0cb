"""Registry of the reproduced figures and tables of the papers, one record each.

The module that measures and compares a figure is imported on demand; the record holds only its name. Rows go to a CSV
(table.py), and `phalanx.lab.figures` draws the figure from the CSV alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from phalanx.errors import UsageError

MATPLOTLIB_HINT = "make setup, or pip install '.[reproduce]' in a clone"


@dataclass(frozen=True, slots=True)
class Option:
    """An option of a figure's command."""

    name: str  # on the command line, without the dashes
    default: float | str  # also determines the option's type
    help: str
    least: float = 0.0  # bounds of a numeric option
    most: float = float("inf")


SEEDS = Option("seeds", 20, "Runs of each case.", 1, 10_000)
QUICK = {"seeds": 2}


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure or table of a paper.

    Most figures are measured case by case. Their `body` has

    - `COLUMNS`;
    - `cases(seeds)`: the cases' names, in the order to measure them;
    - `measure_case(case, tell)`: the rows of one case, optionally with a dict of further results;
    - `compare(table)`: the statements;
    - `origin()`, optional: the settings, besides the version, that must agree for two measurements to share a file.

    The others have `measure(folder, on_progress, **options)`, which returns the CSV's path, and `report(table)`.
    """

    name: str  # of the command and of the files
    made_by: Any  # the body: a module of this package, "module:name" in one, or an object
    about: str  # one line with its place in the paper
    _: KW_ONLY
    example: str = "--seeds 5"
    options: tuple[Option, ...] = (SEEDS,)
    quick: Mapping[str, float | str] = field(default_factory=lambda: QUICK)  # option values for --quick
    has_login: bool = False  # accepts a broker's login
    # Measures durations, so that nothing else may run meanwhile.
    alone: bool = False
    counted: str = "cases"  # unit of the progress display
    size_in: tuple[float, float] = (11.0, 5.5)

    @property
    def body(self) -> Any:
        """Return the module or object that measures and compares this figure."""
        return resolve_name(f"{__package__}.{self.made_by}") if isinstance(self.made_by, str) else self.made_by

    def csv(self, folder: Path) -> Path:
        """Return the path of the figure's CSV in `folder`."""
        return folder / f"{self.name}.csv"

    def option_values(self, given: Mapping[str, Any], *, quick: bool = False) -> dict[str, Any]:
        """Return the values of all options: as given, else as in the quick form if `quick`, else the default."""
        small = self.quick if quick else {}
        return {each.name: small.get(each.name, each.default) for each in self.options} | dict(given)

    def check(self, given: Mapping[str, Any]) -> None:
        """Check the bounds of numeric options. Raises: UsageError: a number is out of bounds."""
        for option in self.options:
            value = given.get(option.name, option.default)
            if not isinstance(value, str) and not option.least <= value <= option.most:
                raise UsageError(f"{option.name} {value:g} is out of range", f"use {option.least:g} to {option.most:g}")


_flock = partial(Figure, counted="runs", size_in=(11.0, 8.4))
_FIGURES = (
    Figure(
        "link-fig4",
        "link.fig4",
        "Packets lost and late through a broker, plain and sealed (Qrkey Fig. 4)",
        options=(
            Option("broker", "mosquitto", "mosquitto, or a mqtt(s):// or ws(s):// URL."),
            Option(
                "duration",
                60.0,
                "Seconds to measure for, earlier runs into the same folder included; the paper's is 54000.",
                1.0,
                30 * 86_400.0,
            ),
        ),
        quick={"duration": 10.0},
        has_login=True,
        alone=True,
        example="--broker mqtts://broker.hivemq.com:8883 --duration 54000 (the paper's)",
        counted="packets of each kind",
        size_in=(11.0, 5.4),
    ),
    _flock(
        "bti-fig2",
        "bti.liars:FIG2",
        "Ten of 125 robots lie among obstacles, and the flock stays away (RoboRebound Fig. 2)",
    ),
    Figure(
        "bti-fig5", "bti.loads:FIG5", "Cost of a MAC and a hash on microcontrollers (RoboRebound Fig. 5a)", alone=True
    ),
    Figure("bti-table1", "bti.loads:TABLE1", "Worst load of the a-node, call by call (RoboRebound Table 1)"),
    Figure("bti-table2", "bti.loads:TABLE2", "Worst load of the s-node, call by call (RoboRebound Table 2)"),
    _flock(
        "bti-fig6",
        "bti.fig6",
        "Bandwidth and storage of audits, by f_max and T_audit (RoboRebound Fig. 6)",
        size_in=(12.0, 5.8),
    ),
    _flock(
        "bti-fig7",
        "bti.fig7",
        "Bandwidth and storage of audits, by density and size of the flock (RoboRebound Fig. 7)",
        size_in=(12.0, 8.6),
    ),
    _flock(
        "bti-fig8", "bti.liars:FIG8", "One robot lies and is not stopped: the flock stays away (RoboRebound Fig. 8)"
    ),
    _flock("bti-fig9", "bti.liars:FIG9", "One robot lies and is stopped: the flock arrives (RoboRebound Fig. 9)"),
    Figure(
        "mission-fig8a",
        "missions.fig8a",
        "A path of 150 s recovered by odometry and by encoded landmarks (Encoded graphs Fig. 8a)",
        size_in=(12.0, 6.0),
    ),
    Figure(
        "mission-fig8b",
        "missions.fig8b",
        "Localisation error for growing noise of the odometry (Encoded graphs Fig. 8b)",
        size_in=(16.0, 5.5),
    ),
    Figure(
        "mission-fig8c",
        "missions.fig8c",
        "Time to find landmarks in a scan and to search their hashes (Encoded graphs Fig. 8c)",
        alone=True,
    ),
    Figure(
        "mission-fig9",
        "missions.explore:FIG9",
        "Four robots explore together and share hashes alone (Encoded graphs Fig. 9)",
        size_in=(12.0, 6.5),
    ),
    Figure(
        "mission-table1",
        "missions.explore:TABLE1",
        "How knowledge is divided among four exploring robots (Encoded graphs Table I)",
    ),
    Figure(
        "mission-fig10",
        "missions.fig10",
        "An office with QR codes, by camera (Encoded graphs Fig. 10)",
        alone=True,
        size_in=(16.0, 6.0),
    ),
)
FIGURES = {figure.name: figure for figure in _FIGURES}
