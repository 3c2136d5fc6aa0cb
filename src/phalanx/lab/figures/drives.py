"""Plots of Encoded graphs Figs. 8, 9 and 10 and Table I: drives through buildings, their errors and times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phalanx.papers.missions import explore, fig8a, fig8b, fig8c, fig10
from phalanx.papers.missions.drive import office, path_errors_m
from phalanx.papers.table import Table, seed_of
from phalanx.world.building.floorplan import DEFAULT, load_floorplan
from phalanx.world.building.odometry import NoiseModel

from .plot import BLUE, GREEN, GREY, ORANGE, VERMILION, Axes, Picture, banded, boxes, draw_walls, lines_in

# Paths to draw: prefix of the columns, colour, label.
Ways = tuple[tuple[str, str, str], ...]
WAYS_8A: Ways = (
    ("odometry", ORANGE, "odometry alone"),
    ("doorways", GREEN, "doorways"),
    ("all", BLUE, "all landmarks"),
)
WAYS_10: Ways = (("odometry", ORANGE, "odometry alone"), ("hash", BLUE, "with codes"))
COLOURS = (BLUE, ORANGE, GREEN, VERMILION)


def _draw_paths(table: Table, ways: Ways, walls_m: NDArray[np.float64], ground: Axes, over_time: Axes) -> None:
    """Draw the first case's paths on the floor plan, and over time the errors of all cases of the same length."""
    first = min(table.cases, key=seed_of)
    times_s = table.column(first, "t_s")
    draw_walls(ground, walls_m)
    ground.plot(table.column(first, "true_x_m"), table.column(first, "true_y_m"), color="black", lw=3, label="truth")
    for way, colour, label in ways:
        x, y = (table.column(first, f"{way}_{axis}_m") for axis in "xy")
        ground.plot(x, y, color=colour, linewidth=1.2, label=label)
        errors_m = [errors_m for errors_m in path_errors_m(table, way) if len(errors_m) == len(times_s)]
        banded(over_time, times_s, np.array(errors_m), colour, label)
    over_time.set(xlabel="time (s)", ylabel="error (m); median and 5 to 95 % of seeds", yscale="log")


def draw_fig8a(table: Table, picture: Picture) -> None:
    """Draw the paths on the floor plan, and the errors over time."""
    ground, over_time = picture.subplots(1, 2, width_ratios=(5, 6))
    _draw_paths(table, WAYS_8A, load_floorplan(DEFAULT).walls, ground, over_time)
    over_time.axhline(fig8a.ZERO_M, color=GREY, linewidth=0.8, linestyle=":", label="paper's virtually zero, 0.15 m")
    over_time.set_ylim(1e-3, 10)
    for axes in (ground, over_time):
        axes.legend(fontsize=8, loc="upper left")


def draw_fig8b(table: Table, picture: Picture) -> None:
    """Draw box plots of odometry and encoded landmarks, one panel per setting."""
    for axes, (model, reach_m) in zip(
        picture.subplots(1, len(fig8b.SETTINGS), sharey=True), fig8b.SETTINGS, strict=True
    ):
        _draw_setting(axes, table, model, reach_m)
    picture.axes[0].set_ylabel("error (m); quantiles over a drive, medians of seeds")
    picture.axes[0].set_ylim(-0.1, 3.8)
    picture.axes[0].legend(fontsize=8, loc="upper left")


def _draw_setting(axes: Axes, table: Table, model: NoiseModel, reach_m: float) -> None:
    for way, colour, offset in (("odometry", ORANGE, -0.2), ("hash", BLUE, 0.2)):
        boxes = []
        for level in fig8b.LEVELS:
            low, first, middle, third, high = (
                float(np.median(fig8b.over_seeds(table, model, reach_m, level, f"{way}_p{100 * share:.0f}_m")))
                for share in fig8b.SHARES[:5]
            )
            boxes.append({"whislo": low, "q1": first, "med": middle, "q3": third, "whishi": high, "fliers": []})
        places = np.arange(len(fig8b.LEVELS)) + offset
        axes.bxp(boxes, positions=places, widths=0.34, showfliers=False, **lines_in(colour))
        axes.plot([], [], color=colour, label={"odometry": "odometry alone", "hash": "encoded landmarks"}[way])
    axes.axvspan(2.5, 4.5, color="0.93", zorder=0)
    axes.text(2.55, 3.3, "beyond the\npaper's limit", fontsize=7, color="0.35")
    axes.set_xticks(range(len(fig8b.LEVELS)), [f"{t:g}\n{r:g}" for t, r in fig8b.LEVELS])
    axes.set_xlabel(f"sigma_t, sigma_r\n{model.value}, features to {reach_m:g} m")


def draw_fig8c(table: Table, picture: Picture) -> None:
    """Draw times by grid size, compiled and plain."""
    axes = picture.subplots(1, 2, sharey=True)
    for panel, column, code in zip(axes, ("plain_s", "compiled_s"), ("plain Python, hashlib", "compiled"), strict=True):
        for offset, colour, kinds in (
            (-0.2, VERMILION, [fig8c.EXTRACTION] * len(fig8c.GRIDS_MM)),
            (0.2, BLUE, [f"grid {grid_mm}" for grid_mm in fig8c.GRIDS_MM]),
        ):
            values, places = (
                [fig8c.all_of(table, kind, column) for kind in kinds],
                np.arange(len(fig8c.GRIDS_MM)) + offset,
            )
            boxes(panel, values, colour, positions=places, widths=0.34, manage_ticks=False)
        panel.set_xticks(range(len(fig8c.GRIDS_MM)), [f"{grid_mm / 1000:g}" for grid_mm in fig8c.GRIDS_MM])
        panel.set(xlabel=f"grid (m); {code}", yscale="log")
    axes[0].set_ylabel("time for one scan (s); box and 5 to 95 %")
    axes[0].plot([], [], color=VERMILION, label="landmarks of the scan")
    axes[0].plot([], [], color=BLUE, label="hash search")
    axes[0].legend(fontsize=8, loc="lower right")


def draw_fig9(table: Table, picture: Picture) -> None:
    """Draw the paths of the first seed on the floor plan, and the landmarks found over time."""
    ground, over_time = picture.subplots(1, 2, width_ratios=(6, 5))
    rows = table.cases[min(table.cases, key=seed_of)]
    draw_walls(ground, load_floorplan(DEFAULT).walls)
    places = [node.place for node in office().nodes if node.place]
    ground.plot(*zip(*places, strict=True), "o", mfc="none", mec="0.4", ms=5, label="encoded landmarks")
    for number, colour in enumerate(COLOURS):
        own = rows[rows[:, 1] == number]
        ground.plot(own[:, 2], own[:, 3], color=colour, linewidth=1.5, label=f"robot {number + 1}")
        over_time.plot(own[:, 0], own[:, 4], color=colour, label=f"robot {number + 1}")
        over_time.plot(own[:, 0], own[:, 4] + own[:, explore.TOLD], color=colour, linestyle=":")
    over_time.plot([], [], color="0.4", linestyle=":", label="including those received from others")
    over_time.axhline(explore.LANDMARKS, color="0.6", linewidth=0.8)
    over_time.set(xlabel="time (s)", ylabel="landmarks found", ylim=(0, explore.LANDMARKS + 4))
    ground.legend(fontsize=8, loc="upper left", bbox_to_anchor=(0, 1.08), ncols=3, frameon=False)
    over_time.legend(fontsize=8, loc="upper left")


def draw_table1(table: Table, picture: Picture) -> None:
    """Draw our values as boxes over the seeds, and the paper's as hollow markers."""
    for axes, values, paper, label in zip(
        picture.subplots(1, 2),
        (explore.values_at_end(table, explore.FOUND), 100 * explore.values_at_end(table, explore.AREA)),
        (explore.PAPER_FOUND, explore.PAPER_AREA_PCT),
        (f"hashes found of {explore.LANDMARKS}", "area known (%)"),
        strict=True,
    ):
        ranks = np.arange(1, explore.ROBOTS + 1)
        boxes(axes, list(values.T), BLUE, positions=ranks, widths=0.4)
        axes.plot([], [], color=BLUE, label="phalanx, box and 5 to 95 % of seeds")
        axes.plot(ranks, sorted(paper), "o", mfc="none", mec="black", ms=7, label="paper")
        axes.set(xlabel="robot, by rank", ylabel=label, ylim=(0, None))
        axes.legend(fontsize=8, loc="lower right")


def draw_fig10(table: Table, picture: Picture) -> None:
    """Draw the paths, the errors over time, and the time of each stage."""
    plan, _ = fig10.office_with_codes()
    ground, over_time, stages = picture.subplots(1, 3, width_ratios=(5, 4, 4))
    ground.plot(
        [c.x_m for c in plan.codes], [c.y_m for c in plan.codes], "s", mfc="none", mec="0.3", ms=5, label="codes"
    )
    _draw_paths(table, WAYS_10, plan.walls, ground, over_time)
    over_time.axhline(fig10.PAPER_MAX_M, color="0.4", linewidth=0.8, linestyle=":", label="paper's largest, 0.413 m")
    over_time.set_ylim(1e-4, 10)
    boxes(stages, [fig10.times_s(table, stage) for stage in fig10.STAGES], BLUE)
    labels = [
        f"{name.removesuffix('_s').upper()}\n{stage.replace(', ', chr(10))}" for name, stage in fig10.STAGES.items()
    ]
    stages.set_xticks(range(1, 1 + len(fig10.STAGES)), labels, fontsize=7)
    stages.set(ylabel="time for one picture (s)", yscale="log")
    ground.legend(fontsize=8, loc="upper left", bbox_to_anchor=(0, 1.09), ncols=4, frameon=False)
    over_time.legend(fontsize=8, loc="upper left")
