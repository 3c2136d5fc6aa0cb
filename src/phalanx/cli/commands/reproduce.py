"""`phalanx reproduce`: measure the papers' figures again; one command for each figure."""

from __future__ import annotations

from functools import partial, update_wrapper
from typing import Any

import click

from phalanx.cli.options import (
    PROCESSES,
    combine_options,
    implemented_by,
    json_option,
    login_option,
    option,
    out_folder_option,
)
from phalanx.papers.figure import FIGURES, SEEDS, Figure

NOTES = (
    "After Ctrl-C the same command continues: it keeps the runs that are already in the folder. The figure is drawn "
    "when all runs are complete."
)
FINDINGS = (
    " The exit code is 0 if the figure is drawn. The last line says whether it agrees with the paper, from ten seeds "
    "on."
)


quick_option = option("--quick", help="Measure less, such as two seeds, unless options set a number.", is_flag=True)


dealing_options = combine_options(
    option(
        "--scheduler",
        metavar="ADDRESS",
        help="Measure on the workers of this dask scheduler, such as tcp://10.0.0.1:8786.",
    ),
    option(
        "--workers",
        type=PROCESSES,
        help="Measure in this many processes. Default: in one.",
        metavar="N",
    ),
)


@click.group(epilog="Example: phalanx reproduce link-fig4 --duration 600")
def reproduce() -> None:
    """Measure a figure of one of the papers and draw it beside the paper's."""


@reproduce.command("all", epilog="Example: phalanx reproduce all --quick --out out/papers")
@quick_option
@dealing_options
@out_folder_option
@json_option
@implemented_by("reproduce", "reproduce_all")
def reproduce_all() -> None:
    """Measure all figures and tables, and write one page that compares each with the paper.

    The page is reproduction.md, beside the CSVs and pictures. Each figure continues where it was interrupted; if one
    cannot be measured, the others still are. Figures that measure times ignore --workers and --scheduler. Exit with 1
    if interrupted, or if a figure could not be measured.
    """


def _command(figure: Figure) -> click.Command:
    measure: Any = implemented_by("reproduce", "reproduce")(lambda: None)
    command = update_wrapper(partial(measure, figure=figure.name), measure)
    own = [
        option(f"--{each.name}", help=f"{each.help}  [default: {each.default}]", type=type(each.default))
        for each in figure.options
    ]
    dealt = [] if figure.alone else [dealing_options]
    command = combine_options(
        *[login_option] * figure.has_login, *own, quick_option, *dealt, out_folder_option, json_option
    )(command)
    example = f"Example: phalanx reproduce {figure.name} {figure.example}"
    notes = NOTES + FINDINGS * (SEEDS in figure.options)
    return click.command(figure.name, help=f"{figure.about}.\n\n{notes}", epilog=example)(command)


for each in FIGURES.values():
    reproduce.add_command(_command(each))
