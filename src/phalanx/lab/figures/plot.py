"""Common style and saving of all figures: without a display, and by atomic replacement."""

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

# "module:function" by figure, imported on demand: draws the table into an empty picture, returns the footer or None.
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
# Okabe and Ito's palette: distinguishable with colour blindness, and in greyscale.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, GREY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#828282"


def draw(csv: Path, figure: Figure) -> tuple[Path, Path]:
    """Draw the figure from its CSV, and return the paths of the PNG and the SVG beside it.

    Raises: UsageError: no such CSV, or not a CSV of this figure. Unavailable: no matplotlib, or the disk is full.
    """
    table = read_table(csv, figure.name)
    picture = blank(*figure.size_in)
    footer = drawing(figure.name)(table, picture)
    if footer is None:
        cases = list(table.cases)
        footer = f"{len(cases)} cases, {cases[0]} to {cases[-1]}; phalanx {table.version}"
    return finish(picture, figure.about, footer, csv)


def drawing(name: str) -> Callable[[Table, Picture], str | None]:
    """Return the function that draws the figure of that name."""
    found = DRAWN_BY[name]
    draw_function: Callable[[Table, Picture], str | None] = (
        resolve_name(f"{__package__}.{found}") if isinstance(found, str) else found
    )
    return draw_function


def finish(picture: Picture, title: str, footer: str, path: Path) -> tuple[Path, Path]:
    """Add title, footer and grid, and save as PNG and SVG with the base name of `path`; return both paths.

    Raises: Unavailable: the disk is full.
    """
    for axes in picture.axes:
        # A faint grid, and no lines on the sides without a scale.
        axes.grid(alpha=0.25, linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    picture.suptitle(title, x=0.01, ha="left")
    picture.text(0.01, 0.01, footer, fontsize=7.5, color="0.35")
    picture.tight_layout(rect=(0, 0.04, 1, 0.99))
    return _save(picture, path)


def legend_above(axes: Axes, columns: int = 1) -> None:
    """Place the legend above the axes, where it covers no data."""
    axes.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0, 1.0), ncols=columns, frameon=False, borderaxespad=0.2)


def lines_in(colour: str) -> dict[str, Any]:
    """Return arguments that draw all lines of a box plot in one colour."""
    return {part: {"color": colour} for part in ("boxprops", "medianprops", "whiskerprops", "capprops")}


def boxes(axes: Axes, values: Sequence[NDArray[np.float64]], colour: str, **more: Any) -> None:
    """Draw a box for each array, with whiskers from 5 to 95 %; `more` goes to `boxplot`."""
    axes.boxplot(values, whis=(5, 95), showfliers=False, **lines_in(colour), **more)


def banded(
    axes: Axes, along: NDArray[np.float64], values: NDArray[np.float64], colour: str, label: str, band_label: str = ""
) -> None:
    """Draw the median over the seeds and the 5 to 95 % band of values (S, T)."""
    middle, low, high = band(values)
    axes.fill_between(along, low, high, color=colour, alpha=0.3, linewidth=0, label=band_label or None)
    axes.plot(along, middle, color=colour, linewidth=1.4, label=label)


def draw_walls(axes: Axes, walls_m: NDArray[np.float64]) -> None:
    """Draw a building's walls, (W, 4) segments in metres."""
    for x0, y0, x1, y1 in walls_m.tolist():
        axes.plot((x0, x1), (y0, y1), color="0.7", linewidth=1)
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")


def draw_obstacles(axes: Axes, obstacles: Sequence[Disc | Box]) -> list[tuple[float, float]]:
    """Draw a scenario's obstacles, and return two opposite corners of each."""
    corners: list[tuple[float, float]] = []
    from matplotlib.patches import Circle, Rectangle  # noqa: PLC0415  # optional

    for each in obstacles:
        style: dict[str, Any] = {"color": "0.8", "zorder": 0.5}
        if isinstance(each, Disc):
            axes.add_patch(Circle((each.x_m, each.y_m), each.radius_m, **style))
            corners += [(each.x_m + side, each.y_m + side) for side in (-each.radius_m, each.radius_m)]
        else:
            corners += [(each.left_m, each.bottom_m), (each.right_m, each.top_m)]
            axes.add_patch(Rectangle(corners[-2], each.right_m - each.left_m, each.top_m - each.bottom_m, **style))
    return corners


def blank(width_in: float, height_in: float) -> Picture:
    """Return an empty picture. Raises: Unavailable: matplotlib is missing."""
    try:
        # Without pyplot, and so without a display or global state.
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415  # optional
        from matplotlib.figure import Figure as Drawn  # noqa: PLC0415
    except ImportError as error:
        raise Unavailable("matplotlib is not installed, which is needed to draw", MATPLOTLIB_HINT) from error
    picture = Drawn(figsize=(width_in, height_in))
    FigureCanvasAgg(picture)
    return picture


def _save(picture: Picture, path: Path) -> tuple[Path, Path]:
    png, svg = path.with_suffix(".png"), path.with_suffix(".svg")
    for target in (png, svg):
        partial = target.with_suffix(f".{os.getpid()}{target.suffix}")
        try:
            picture.savefig(partial, dpi=150)
            partial.replace(target)
        except OSError as error:
            raise Unavailable(f"cannot write {target}: {error.strerror}") from error
        finally:
            partial.unlink(missing_ok=True)
    return png, svg
