"""`phalanx reproduce mission-*`: the figures of Encoded graphs §VI."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import click

from phalanx.experiments.missions import (
    fig8a as mission_fig8a,
)
from phalanx.experiments.missions import (
    fig8b as mission_fig8b,
)
from phalanx.experiments.missions import (
    fig8c as mission_fig8c,
)
from phalanx.experiments.missions import (
    fig9 as mission_fig9,
)
from phalanx.experiments.missions import (
    fig10 as mission_fig10,
)
from phalanx.experiments.missions import (
    table1 as mission_table1,
)
from phalanx.experiments.missions.figure import MissionFigure, draw, measure
from phalanx.experiments.missions.table import read_case_table

from .reproduce_bti import NOTES
from .reproduce_bti import _show as show
from .terminal import Progress, end_status_line, print_json, stopped, warn_if_nothing_is_drawn


def _command(figure: MissionFigure) -> click.Command:
    @click.command(
        figure.name,
        help=f"{figure.about}.\n\n{NOTES}",
        epilog=f"Example: phalanx reproduce {figure.name} --seeds {min(figure.seeds, 5)}",
    )
    @click.option(
        "--seeds", type=click.IntRange(1, 10_000), default=figure.seeds, show_default=True, help="Runs of each case."
    )
    @click.option(
        "--out",
        type=click.Path(path_type=Path, file_okay=False),
        default=Path("out"),
        show_default=True,
        help="Folder for the CSV and the figure.",
    )
    @click.option("--json", "as_json", is_flag=True, help="Print JSON.")
    def command(seeds: int, out: Path, as_json: bool) -> int:
        warn_if_nothing_is_drawn()
        try:
            csv = measure(out, figure, seeds, _progress())
        except KeyboardInterrupt:
            stopped("whole cases are", out / f"{figure.name}.csv")
            return 1
        end_status_line()
        table = read_case_table(csv)
        statements = figure.compare(table)
        if as_json:
            print_json({"rows": [asdict(each) for each in statements], "csv": str(csv), "version": table.version})
        else:
            show(statements)
        for path in draw(csv, figure):
            click.echo(f"drawn: {path}", err=True)
        return 0

    return command


MODULES = (mission_fig8a, mission_fig8b, mission_fig8c, mission_fig9, mission_table1, mission_fig10)
MISSION_COMMANDS = tuple(_command(module.FIGURE) for module in MODULES)


def _progress() -> Callable[[int, int], None]:
    progress = Progress()
    return lambda done, of: progress.tell(f"{done} of {of} cases", done / of)
