"""`phalanx reproduce`: measures a figure, says how ours compares, and draws it."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import click

from phalanx.experiments.library import FIGURES
from phalanx.experiments.plot import draw
from phalanx.experiments.statement import report
from phalanx.experiments.table import measure, read_table

from .commands.runs import tell_of_compiling
from .login import read_login
from .run import run
from .terminal import Progress, end_status_line, print_json, stopped, warn_if_nothing_is_drawn


def reproduce(figure: str, out: Path, as_json: bool, **said: Any) -> int:
    """Measures the figure of that name, compares, draws; 1 if it was stopped."""
    chosen, progress = FIGURES[figure], Progress()
    chosen.check(said)
    if chosen.has_login:
        said["login"] = read_login(said.pop("broker_login"))
    body = chosen.body
    tell_of_compiling()  # only what was just imported may need it
    warn_if_nothing_is_drawn()
    csv = chosen.csv(out)

    def tell(done: float, of: int) -> None:
        progress.tell(f"{int(done)} of {of} {chosen.counted}", done / of)

    if inspect.iscoroutinefunction(getattr(body, "measure", None)):
        finished = run(body.measure(out, tell, **said))
    else:
        try:
            measure(out, chosen, said["seeds"], tell)
            finished = True
        except KeyboardInterrupt:
            finished = False
    if not finished:
        stopped(f"whole {chosen.counted} are", csv)
        return 1
    end_status_line()
    table = read_table(csv, chosen.name)
    told = report(chosen, table)
    if as_json:
        print_json({"rows": told.rows, "csv": str(csv), **told.more, "version": table.version})
    else:
        click.echo("\n".join(told.lines))
    for path in draw(csv, chosen):
        click.echo(f"drawn: {path}", err=True)
    return 0
