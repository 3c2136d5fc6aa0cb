"""Draw a mission: walls, landmarks, ways, and the recorded paths of robots."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from phalanx.errors import Unavailable, UsageError
from phalanx.mission import Landmark, Mission
from phalanx.mission.landmarks.floorplan import FloorPlan
from phalanx.papers.figure import MATPLOTLIB_HINT
from phalanx.world.missions.report import Report

from .plot import BLUE, GREEN, ORANGE, PURPLE, VERMILION

FORMATS = (".png", ".svg")
COLOURS = {
    "doorway": BLUE,
    "room": GREEN,
    "concave_left": VERMILION,
    "concave_right": VERMILION,
    "corner_convex": ORANGE,
    "qr": PURPLE,
}
OTHER = "#000000"
ARROW_M = 0.8
# Paths in a report's trace, in the order after its time.
PATHS = (("true path", "black", "-", 1.6), ("estimate", VERMILION, "--", 1.0), ("odometry alone", "#56B4E9", ":", 1.0))


def check_drawable(out: Path) -> None:
    """Check that a picture can be drawn. Raises: UsageError: neither PNG nor SVG. Unavailable: no matplotlib."""
    if out.suffix.lower() not in FORMATS:
        raise UsageError(f"{out} is neither PNG nor SVG", "use --out mission.svg")
    if importlib.util.find_spec("matplotlib") is None:
        raise Unavailable("matplotlib is not installed, which is needed to draw", MATPLOTLIB_HINT)


def draw_mission(mission: Mission, plan: FloorPlan | None, out: Path, reports: Sequence[Report] = ()) -> None:
    """Draw a mission with the traces of `reports`, on a floor plan if given. Raises: UsageError, Unavailable."""
    check_drawable(out)
    from matplotlib.figure import Figure  # noqa: PLC0415  # optional

    figure = Figure(figsize=(9, 9), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlabel="x (m)", ylabel="y (m)", title=mission.name, aspect="equal")
    if plan is not None:
        for x0, y0, x1, y1 in plan.walls:
            axes.plot([x0, x1], [y0, y1], color="0.3", linewidth=1.5, zorder=1)
    _draw_ways(axes, mission)
    _draw_nodes(axes, mission)
    _draw_paths(axes, reports)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    x0, y0, x1, y1 = plan.bounds if plan is not None else mission.box_m
    axes.set_xlim(x0 - 1, x1 + 1)
    axes.set_ylim(y0 - 1, y1 + 1)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(out, dpi=150, metadata={"Date": None} if out.suffix.lower() == ".svg" else None)
    except OSError as error:
        raise Unavailable(f"cannot write {out}: {error.strerror}", "choose another --out") from error


def _draw_ways(axes: Any, mission: Mission) -> None:
    places = {node.name: node.place for node in mission.nodes}
    for way in mission.ways:
        source, target = places[way.source], places[way.target]
        if source is not None and target is not None:
            style = {"arrowstyle": "-|>", "color": "0.6", "linewidth": 0.8, "shrinkA": 6, "shrinkB": 6}
            axes.annotate("", target, source, arrowprops=style, zorder=2)


def _draw_nodes(axes: Any, mission: Mission) -> None:
    shown: set[str] = set()
    for node in mission.nodes:
        for thing in (thing for alias in node.see for thing in alias if isinstance(thing, Landmark)):
            label = None if thing.type in shown else thing.type.replace("_", " ")
            shown.add(thing.type)
            axes.plot(thing.x_m, thing.y_m, "o", color=COLOURS[thing.type], markersize=5, label=label, zorder=3)
            if thing.orientation_rad is not None:
                xs = [thing.x_m, thing.x_m + ARROW_M * math.cos(thing.orientation_rad)]
                ys = [thing.y_m, thing.y_m + ARROW_M * math.sin(thing.orientation_rad)]
                axes.plot(xs, ys, color=COLOURS[thing.type], linewidth=1, zorder=3)
        if node.place is not None:
            axes.annotate(node.name, node.place, (4, 4), textcoords="offset points", fontsize=7, zorder=4)
            if node.start or node.final:
                axes.plot(*node.place, "s" if node.start else "*", color=OTHER, markersize=9, mfc="none", zorder=3)


def _draw_paths(axes: Any, reports: Sequence[Report]) -> None:
    for report in reports:
        paths = np.array([[pose[:2] for pose in step[1:]] for step in report.trace])
        for which, (label, colour, style, width) in enumerate(PATHS):
            once = label if report is reports[0] else None
            x, y = paths[:, which].T
            axes.plot(x, y, style, color=colour, linewidth=width, label=once, zorder=5)
