"""What all figures of the second shield have in common: cases measured one by one, and what is said of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from phalanx.experiments.bti.flock import Statement
from phalanx.experiments.figure import dress_axes, new_figure, save_figure, write_margins
from phalanx.experiments.version import version

from .table import CaseFile, CaseTable, Rows, read_case_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionFigure:
    """One figure or table of the paper.

    Args:
        name: mission-fig8a, ...
        about: what it shows, one line with its place in the paper.
        columns: of the CSV's rows.
        seeds: how many by default.
        cases: of so many seeds, in the order to measure them.
        measure: one case: (rows, columns).
        compare: what the paper says, and ours.
        draw: into an empty figure.
        size_in: of the figure.
    """

    name: str
    about: str
    columns: tuple[str, ...]
    seeds: int
    cases: Callable[[int], list[str]]
    measure: Callable[[str], Rows]
    compare: Callable[[CaseTable], list[Statement]]
    draw: Callable[[CaseTable, Picture], None]
    size_in: tuple[float, float] = (11.0, 5.5)


def measure(
    folder: Path, figure: MissionFigure, seeds: int, on_progress: Callable[[int, int], None] = lambda _done, _of: None
) -> Path:
    """The CSV in `folder` with all cases in it; goes on where an earlier measurement was stopped.

    Raises: UsageError: a CSV of another measurement. Unavailable: the disk is full.
    """
    path = folder / f"{figure.name}.csv"
    todo = figure.cases(seeds)
    with CaseFile(path, figure.name, version(), figure.columns) as file:
        for done, case in enumerate(todo):
            on_progress(done, len(todo))
            if case not in file.done:
                file.append(case, figure.measure(case))
    on_progress(len(todo), len(todo))
    return path


def draw(csv: Path, figure: MissionFigure) -> tuple[Path, Path]:
    """The PNG and the SVG beside `csv`, from it alone.

    Raises: UsageError: no such CSV, or not one of ours. Unavailable: matplotlib is missing, or the disk is full.
    """
    table = read_case_table(csv)
    picture = new_figure(*figure.size_in)
    figure.draw(table, picture)
    for axes in picture.axes:
        dress_axes(axes)
    cases = list(table.cases)
    footer = f"{len(cases)} cases, {cases[0]} to {cases[-1]}; phalanx {table.version}"
    write_margins(picture, figure.about, footer)
    picture.tight_layout(rect=(0, 0.03, 1, 0.98))
    return save_figure(picture, csv)
