"""`phalanx reproduce bti-fig8` and `bti-fig9`: the figures of RoboRebound §5.3."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import click

from phalanx.experiments.bti import fig8 as bti_fig8
from phalanx.experiments.bti import fig9 as bti_fig9
from phalanx.experiments.bti.flock import FlockConfig, Statement, last_line, measure
from phalanx.experiments.bti.flock_plot import draw_flock
from phalanx.experiments.bti.flock_table import FlockTable, read_flock_table

from .terminal import Progress, end_status_line, print_json, stopped, warn_if_nothing_is_drawn

# Of each of these figures, in its help.
NOTES = (
    "Ctrl-C stops; the same command goes on from there, and only draws when all is there. Runs that an earlier command "
    "left in the same folder count too, also where they are more. Ends with 0 once it has been measured and drawn, "
    "whether or not ours agrees with the paper: NO is a finding, and the last line says why."
)


def _figure(config: FlockConfig, compare: Callable[[FlockTable], list[Statement]], about: str) -> click.Command:
    @click.command(
        config.name,
        help=f"{about}\n\n{NOTES}",
        epilog=f"Example: phalanx reproduce {config.name} --seeds 5",
    )
    @click.option(
        "--seeds", type=int, default=config.seeds, show_default=True, help="Runs with a liar, and as many without."
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
        chosen = replace(config, seeds=seeds)
        warn_if_nothing_is_drawn()
        csv = out / chosen.csv_name
        try:
            measure(out, chosen, _progress(2 * seeds))
        except KeyboardInterrupt:
            stopped("whole runs are", csv)
            return 1
        end_status_line()
        table = read_flock_table(csv)
        statements = compare(table)
        if as_json:
            print_json(
                {"rows": [asdict(each) for each in statements], "csv": str(csv), "version": table.origin.version}
            )
        else:
            _show(statements)
        for path in draw_flock(csv, chosen):
            click.echo(f"drawn: {path}", err=True)
        return 0

    return command


bti_fig8_command = _figure(
    bti_fig8.CONFIG, bti_fig8.compare, "One robot lies and nobody stops it: the flock stays away (RoboRebound Fig. 8)."
)
bti_fig9_command = _figure(
    bti_fig9.CONFIG, bti_fig9.compare, "One robot lies and the others stop it: the flock arrives (RoboRebound Fig. 9)."
)


def _progress(runs: int) -> Callable[[float], None]:
    progress = Progress()
    return lambda share: progress.tell(f"{int(share * runs)} of {runs} runs", share)


def _show(statements: list[Statement]) -> None:
    heads = ("", "paper", "reference", "ours, median (5 … 95 %)", "", "asked")
    rows = [
        (each.what, each.paper or "-", each.reference or "-", each.ours, "ok" if each.agrees else "NO", each.why)
        for each in statements
    ]
    widths = [max(len(row[k]) for row in (heads, *rows)) for k in range(len(heads))]
    for row in (heads, *rows):
        click.echo("  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip())
    click.echo(last_line(statements))
