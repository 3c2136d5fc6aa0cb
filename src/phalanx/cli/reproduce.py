"""`phalanx reproduce`: measure figures, compare them with the papers', and draw them."""

from __future__ import annotations

import inspect
import logging
import signal
from pathlib import Path
from typing import Any

import click

from phalanx.errors import PhalanxError, Unavailable
from phalanx.lab.figures.plot import draw
from phalanx.lab.sweep.dealing import cases_with_dask
from phalanx.net.private_file import write_whole
from phalanx.papers.figure import FIGURES, Figure
from phalanx.papers.statement import Shown, compare, page, report
from phalanx.papers.table import EachCase, measure, measure_serially, read_table, version
from phalanx.world.signals import handled_by

from .credentials import read_login
from .run import run
from .terminal import Progress, end_status_line, print_json, stopped, talk, warn_if_nothing_is_drawn

PAGE = "reproduction.md"
log = logging.getLogger(__name__)


def reproduce(
    figure: str,
    quick: bool,
    out: Path,
    as_json: bool,
    scheduler: str | None = None,
    workers: int | None = None,
    **options: Any,
) -> int:
    """Measure a figure, compare it and draw it. Return 1 if interrupted."""
    chosen = FIGURES[figure]
    login = {"login": read_login(options.pop("broker_login"))} if chosen.has_login else {}
    asked = chosen.option_values({name: value for name, value in options.items() if value is not None}, quick=quick)
    chosen.check(asked)
    warn_if_nothing_is_drawn()
    csv = chosen.csv(out)
    if not _measure(chosen, out, asked | login, _each_case(scheduler, workers)):
        return stopped(_kept(f"complete {chosen.counted} are", csv))
    table = read_table(csv, chosen.name)
    comparison = report(chosen, table)
    if as_json:
        print_json({"rows": comparison.rows, "csv": str(csv), **comparison.more, "version": table.version})
    else:
        click.echo("\n".join(comparison.lines))
    for path in draw(csv, chosen):
        click.echo(f"drawn: {path}", err=True)
    return 0


def _each_case(scheduler: str | None, workers: int | None) -> EachCase:
    return cases_with_dask(scheduler, workers) if scheduler or workers else measure_serially


def reproduce_all(quick: bool, scheduler: str | None, workers: int | None, out: Path, as_json: bool) -> int:
    """Measure every figure and write the page. Return 1 if interrupted, or if a figure failed."""
    each_case = _each_case(scheduler, workers)
    warn_if_nothing_is_drawn()
    path, shown, whole = out / PAGE, list[Shown](), True
    for each in FIGURES.values():
        try:
            found = _show(each, out, measure_serially if each.alone else each_case, quick=quick)
        except PhalanxError as error:
            found = Shown(figure=each, failure=str(error))
        except Exception as error:  # a failure of one figure must not end the others
            log.debug("%s", each.name, exc_info=error)
            found = Shown(figure=each, failure=f"{type(error).__name__}: {error}".splitlines()[0])
        if found is None:
            whole = False
            break
        shown.append(found)
        end_status_line()
        talk(f"{each.name}: {found.verdict}")
        _write(path, page(f"phalanx reproduce all{' --quick' * quick}", version(), shown))
    if as_json:
        rows = [
            {
                "figure": each.figure.name,
                "failure": each.failure or None,
                "statements": len(each.statements),
                "agree": each.agreeing,
            }
            for each in shown
        ]
        print_json({"figures": rows, "page": str(path), "whole": whole})
    if not whole:
        return stopped(_kept(f"{len(shown)} of {len(FIGURES)} figures are", path))
    click.echo(f"page: {path}", err=True)
    return int(any(each.failure for each in shown))


def _show(figure: Figure, out: Path, each_case: EachCase, *, quick: bool) -> Shown | None:
    """Return the result of a figure, or None if interrupted."""
    asked = figure.option_values({}, quick=quick)
    if not _measure(figure, out, asked, each_case, f"{figure.name}: "):
        return None
    csv = figure.csv(out)
    table = read_table(csv, figure.name)
    draw(csv, figure)
    many = f"{len(table.cases)} cases" if table.cases else f"{len(table.lines)} lines"
    measured = f"{many}, phalanx {table.version}."
    return Shown(figure=figure, measured=measured, statements=compare(figure, table))


def _measure(figure: Figure, out: Path, asked: dict[str, Any], each_case: EachCase, begin: str = "") -> bool:
    """Measure a figure and return whether it was completed; existing runs are not repeated."""
    body, progress = figure.body, Progress()

    def show_progress(done: float, of: int) -> None:
        progress.tell(f"{begin}{int(done)} of {of} {figure.counted}", done / of)

    if inspect.iscoroutinefunction(getattr(body, "measure", None)):
        finished = run(body.measure(out, show_progress, **asked))
    else:
        try:
            with handled_by(signal.default_int_handler, signal.SIGTERM):
                measure(out, figure, asked["seeds"], show_progress, each_case)
            finished = True
        except KeyboardInterrupt:
            finished = False
    if finished:
        end_status_line()
    return finished


def _kept(what: str, path: Path) -> str:
    return f"{what} in {path}, run the same command again to continue" if path.exists() else ""


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise Unavailable(f"cannot write {path}: {error.strerror}", "use another folder with --out") from error
    write_whole(path, text.encode(), "use another folder with --out")
