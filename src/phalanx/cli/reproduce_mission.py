"""`phalanx reproduce mission-*`: the figures of Encoded graphs §VI."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import click

from phalanx.experiments import (
    mission_fig8a,
    mission_fig8b,
    mission_fig8c,
    mission_fig9,
    mission_fig10,
    mission_table1,
)
from phalanx.experiments.mission_figure import MissionFigure, draw, measure
from phalanx.experiments.mission_table import read_case_table

from .reproduce_bti import _show as show
from .terminal import end_status_line, print_json, status_line


def _command(figure: MissionFigure) -> click.Command:
    @click.command(
        figure.name,
        help=f"{figure.about}.\n\nCtrl-C stops; the same command goes on from there, and only draws when all is there.",
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
        if importlib.util.find_spec("matplotlib") is None:
            click.echo(
                "phalanx: warning: matplotlib is not installed, nothing will be drawn; pip install matplotlib", err=True
            )
        try:
            csv = measure(out, figure, seeds, _progress())
        except KeyboardInterrupt:
            end_status_line()
            click.echo(f"stopped; whole cases are in {out}, the same command goes on from there", err=True)
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
    """Progress on stderr: one line that changes in a terminal, at most eleven lines elsewhere."""
    tenth = -1

    def tell(done: int, of: int) -> None:
        nonlocal tenth
        status_line(f"{done} of {of} cases   {100 * done // of} %   Ctrl-C stops")
        if not sys.stderr.isatty() and 10 * done // of != tenth:
            tenth = 10 * done // of
            click.echo(f"{done} of {of} cases", err=True)

    return tell
