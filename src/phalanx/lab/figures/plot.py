"""How every figure looks and is saved: without a display, and never half-written."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from phalanx.config.flock import Box, Disc
from phalanx.errors import Unavailable
from phalanx.papers.figure import MATPLOTLIB_HINT, Figure
from phalanx.papers.statement import band
from phalanx.papers.table import Table, read_table

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

Axes: TypeAlias = "matplotlib.axes.Axes"
Picture: TypeAlias = "matplotlib.figure.Figure"

# What draws a figure's table into an empty picture, and returns the footer or None: loaded when it is needed.
DRAWN_BY: dict[str, str | Callable[[Table, Picture], str | None]] = {
    "link-fig4": "latency:draw_fig4",
    "bti-fig2": "flocks:draw_fig2",
    "bti-fig5": "audits:draw_fig5",
    "bti-table1": "audits:draw_table1",
    "bti-table2": "audits:draw_table2",
    "bti-fig6": "audits:draw_fig6",
    "bti-fig7": "audits:draw_fig7",
    "bti-fig8": "flocks:draw_fig8",
    "bti-fig9": "flocks:draw_fig9",
    "mission-fig8a": "drives:draw_fig8a",
    "mission-fig8b": "drives:draw_fig8b",
    "mission-fig8c": "drives:draw_fig8c",
    "mission-fig9": "drives:draw_fig9",
    "mission-table1": "drives:draw_table1",
    "mission-fig10": "drives:draw_fig10",
}
# Okabe and Ito's: told apart by every kind of eye, and in grey.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, GREY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#828282"


def draw(csv: Path, figure: Figure) -> tuple[Path, Path]:
    """The PNG and the SVG beside `csv`, from it alone.

    Raises: UsageError: no such CSV, or not one of ours. Unavailable: matplotlib is missing, or the disk is full.
    """
    table = read_table(csv, figure.name)
    picture = blank(*figure.size_in)
    footer = drawing(figure.name)(table, picture)
    if footer is None:
        cases = list(table.cases)
        footer = f"{len(cases)} cases, {cases[0]} to {cases[-1]}; phalanx {table.version}"
    return finish(picture, figure.about, footer, csv)


def drawing(name: str) -> Callable[[Table, Picture], str | None]:
    """Return what draws the figure of that name."""
    found = DRAWN_BY[name]
    called: Callable[[Table, Picture], str | None] = (
        resolve_name(f"{__package__}.{found}") if isinstance(found, str) else found
    )
    return called


def finish(picture: Picture, title: str, footer: str, path: Path) -> tuple[Path, Path]:
    """The PNG and the SVG, called as `path`, of a picture that is drawn.

    Raises: Unavailable: the disk is full.
    """
    for axes in picture.axes:
        # A faint grid, and no frame where no scale is.
        axes.grid(alpha=0.25, linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    picture.suptitle(title, x=0.01, ha="left")
    picture.text(0.01, 0.01, footer, fontsize=7.5, color="0.35")
    picture.tight_layout(rect=(0, 0.04, 1, 0.99))
    return _save(picture, path)


def legend_above(axes: Axes, columns: int = 1) -> None:
    """A legend above the axes, where it covers nothing that was measured."""
    axes.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0, 1.0), ncols=columns, frameon=False, borderaxespad=0.2)


def lines_in(colour: str) -> dict[str, Any]:
    """All lines of a box plot in one colour."""
    return {part: {"color": colour} for part in ("boxprops", "medianprops", "whiskerprops", "capprops")}


def boxes(axes: Axes, values: Sequence[NDArray[np.float64]], colour: str, **more: Any) -> None:
    """A box for each of the values, with whiskers from 5 to 95 %; `more` as for any box plot."""
    axes.boxplot(values, whis=(5, 95), showfliers=False, **lines_in(colour), **more)


def banded(
    axes: Axes, along: NDArray[np.float64], values: NDArray[np.float64], colour: str, label: str, band_label: str = ""
) -> None:
    """The median over the seeds, and the band from 5 to 95 %, of values (S, T)."""
    middle, low, high = band(values)
    axes.fill_between(along, low, high, color=colour, alpha=0.3, linewidth=0, label=band_label or None)
    axes.plot(along, middle, color=colour, linewidth=1.4, label=label)


def draw_walls(axes: Axes, walls_m: NDArray[np.float64]) -> None:
    """A building's walls, (W, 4), on axes for the ground."""
    for x0, y0, x1, y1 in walls_m.tolist():
        axes.plot((x0, x1), (y0, y1), color="0.7", linewidth=1)
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")


def draw_obstacles(axes: Axes, obstacles: Sequence[Disc | Box]) -> list[tuple[float, float]]:
    """A scenario's obstacles, on axes for the ground; two corners of each."""
    corners: list[tuple[float, float]] = []
    from matplotlib.patches import Circle, Rectangle  # noqa: PLC0415  # optional

    for each in obstacles:
        looks: dict[str, Any] = {"color": "0.8", "zorder": 0.5}
        if isinstance(each, Disc):
            axes.add_patch(Circle((each.x_m, each.y_m), each.radius_m, **looks))
            corners += [(each.x_m + side, each.y_m + side) for side in (-each.radius_m, each.radius_m)]
        else:
            corners += [(each.left_m, each.bottom_m), (each.right_m, each.top_m)]
            axes.add_patch(Rectangle(corners[-2], each.right_m - each.left_m, each.top_m - each.bottom_m, **looks))
    return corners


def blank(width_in: float, height_in: float) -> Picture:
    """An empty picture. Raises: Unavailable: matplotlib is missing."""
    try:
        # Made without pyplot, and so without a display or any state that others could share.
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415  # optional
        from matplotlib.figure import Figure as Drawn  # noqa: PLC0415
    except ImportError as error:
        raise Unavailable("matplotlib is not installed: nothing drawn", MATPLOTLIB_HINT) from error
    picture = Drawn(figsize=(width_in, height_in))
    FigureCanvasAgg(picture)
    return picture


def _save(picture: Picture, path: Path) -> tuple[Path, Path]:
    png, svg = path.with_suffix(".png"), path.with_suffix(".svg")
    for made in (png, svg):
        half_done = made.with_suffix(f".{os.getpid()}{made.suffix}")
        try:
            picture.savefig(half_done, dpi=150)
            half_done.replace(made)
        except OSError as error:
            raise Unavailable(f"cannot write {made}: {error.strerror}") from error
        finally:
            half_done.unlink(missing_ok=True)
    return png, svg
