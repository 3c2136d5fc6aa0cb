"""How every figure is made and saved: without a display, and never half-written."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from phalanx.errors import Unavailable

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure.

    Raises: Unavailable: matplotlib is missing.
    Source: none.
    """
    try:
        # Made without pyplot, and so without a display or any state that others could share.
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415  # optional
        from matplotlib.figure import Figure  # noqa: PLC0415
    except ImportError as error:
        raise Unavailable("matplotlib is not installed: nothing drawn", "pip install matplotlib") from error
    figure = Figure(figsize=(width_in, height_in))
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, csv: Path) -> tuple[Path, Path]:
    """The PNG and the SVG beside `csv`.

    Raises: Unavailable: the disk is full.
    Source: none.
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
