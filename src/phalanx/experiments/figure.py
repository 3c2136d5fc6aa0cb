"""How every figure is made, looks and is saved: without a display, and never half-written."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from phalanx.errors import Unavailable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MATPLOTLIB_HINT = "make setup, or pip install matplotlib"
# Okabe and Ito's: told apart by every kind of eye, and in grey.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, GREY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#828282"


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure.

    Raises: Unavailable: matplotlib is missing.
    """
    try:
        # Made without pyplot, and so without a display or any state that others could share.
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415  # optional
        from matplotlib.figure import Figure  # noqa: PLC0415
    except ImportError as error:
        raise Unavailable("matplotlib is not installed: nothing drawn", MATPLOTLIB_HINT) from error
    figure = Figure(figsize=(width_in, height_in))
    FigureCanvasAgg(figure)
    return figure


def dress_axes(axes: Axes) -> None:
    """A faint grid, and no frame where no scale is."""
    axes.grid(alpha=0.25, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def legend_above(axes: Axes, columns: int = 1) -> None:
    """A legend above the axes, where it covers nothing that was measured."""
    axes.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0, 1.0), ncols=columns, frameon=False, borderaxespad=0.2)


def write_margins(figure: Figure, title: str, footer: str) -> None:
    """What it shows, above; where that comes from, below."""
    figure.suptitle(title, x=0.01, ha="left")
    figure.text(0.01, 0.01, footer, fontsize=7.5, color="0.35")


def save_figure(figure: Figure, csv: Path) -> tuple[Path, Path]:
    """The PNG and the SVG beside `csv`.

    Raises: Unavailable: the disk is full.
    """
    png, svg = csv.with_suffix(".png"), csv.with_suffix(".svg")
    for path in (png, svg):
        half_done = path.with_suffix(f".{os.getpid()}{path.suffix}")
        try:
            figure.savefig(half_done, dpi=150)
            half_done.replace(path)
        except OSError as error:
            raise Unavailable(f"cannot write {path}: {error.strerror}") from error
        finally:
            half_done.unlink(missing_ok=True)
    return png, svg
