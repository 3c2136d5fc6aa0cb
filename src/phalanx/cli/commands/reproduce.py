"""`phalanx reproduce`: the papers' figures, ours beside theirs; one command for each figure there is."""

from __future__ import annotations

from functools import partial, update_wrapper
from typing import Any

import click

from phalanx.cli.options import PROCESSES, json_option, login_option, option, out_folder_option, runs, together
from phalanx.papers.figure import FIGURES, SEEDS, Figure

NOTES = (
    "After Ctrl-C the same command continues. It keeps the runs that are in the folder already, and draws when all are "
    "there."
)
FINDINGS = (
    " Ends with 0 when it is drawn, whether or not ours agrees with the paper: the last line says. With fewer than ten "
    "seeds it does not judge."
)


quick_option = option("--quick", help="Measure less, for instance two seeds, unless a number is given.", is_flag=True)


dealing_options = together(
    option(
        "--scheduler",
        metavar="ADDRESS",
        help="Address of a dask scheduler whose workers measure, as tcp://10.0.0.1:8786.",
    ),
    option(
        "--workers",
        type=PROCESSES,
        help="Measure in this many processes. Default: in this one.",
        metavar="N",
    ),
)


@click.group(epilog="Example: phalanx reproduce link-fig4 --duration 600")
def reproduce() -> None:
    """Measure a figure of one of the papers and draw ours beside it."""


@reproduce.command("all", epilog="Example: phalanx reproduce all --quick --out out/papers")
@quick_option
@dealing_options
@out_folder_option
@json_option
@runs("reproduce", "reproduce_all")
def reproduce_all() -> None:
    """Measure all figures and tables, and write one page: what each paper says, ours, and whether they agree.

    The page is reproduction.md, beside the CSVs and pictures. Each figure goes on where it was stopped, and one that
    cannot be measured does not end the others. Figures that time something are measured here, whatever --workers and
    --scheduler say. Ends with 1 if it was stopped, or one could not be measured.
    """


def _command(figure: Figure) -> click.Command:
    measure: Any = runs("reproduce", "reproduce")(lambda: None)
    command = update_wrapper(partial(measure, figure=figure.name), measure)
    own = [
        option(f"--{each.name}", help=f"{each.help}  [default: {each.default}]", type=type(each.default))
        for each in figure.options
    ]
    dealt = [] if figure.alone else [dealing_options]
    command = together(*[login_option] * figure.has_login, *own, quick_option, *dealt, out_folder_option, json_option)(
        command
    )
    example = f"Example: phalanx reproduce {figure.name} {figure.example}"
    notes = NOTES + FINDINGS * (SEEDS in figure.options)
    return click.command(figure.name, help=f"{figure.about}.\n\n{notes}", epilog=example)(command)


for each in FIGURES.values():
    reproduce.add_command(_command(each))
