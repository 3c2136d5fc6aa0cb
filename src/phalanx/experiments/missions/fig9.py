"""Encoded graphs Fig. 9: four robots explore the office; they share which hashes they found, never what they saw."""

from __future__ import annotations

import numpy as np

from phalanx.experiments.plot import BLUE, GREEN, ORANGE, VERMILION, Picture, draw_walls
from phalanx.experiments.statement import Statement, quantiles
from phalanx.experiments.table import Table, seed_of
from phalanx.sim.building.floorplan import DEFAULT, load_floorplan

from .drive import office
from .explore import COLUMNS, LANDMARKS, ROBOTS, cases, ends, measure_case

__all__ = ["COLUMNS", "cases", "compare", "draw", "measure_case"]

COLOURS = (BLUE, ORANGE, GREEN, VERMILION)
TEAM, ERROR, TOLD = COLUMNS.index("team"), COLUMNS.index("error_m"), COLUMNS.index("told")


def compare(table: Table) -> list[Statement]:
    """What §VI-C says of Fig. 9, and ours."""
    last = [ends(rows) for rows in table.cases.values()]
    team = np.array([rows[:, TEAM].max() for rows in last])
    met = np.array([np.count_nonzero(rows[:, TOLD]) for rows in last], float)
    errors_m = np.array([rows[:, ERROR].max() for rows in table.cases.values()])
    return [
        Statement(
            what=f"landmarks of {LANDMARKS} that the team found",
            paper="the environment is explored",
            ours=quantiles(team, ".0f"),
            agrees=bool(np.all(team == LANDMARKS)),
            why="all, in every seed",
        ),
        Statement(
            what=f"robots of {ROBOTS} that were told of hashes by another",
            paper="share their progress upon meeting",
            ours=quantiles(met, ".0f"),
            agrees=bool(np.all(met >= 2)),
            why="at least one meeting in every seed",
        ),
        Statement(
            what="largest error of any robot's pose, m",
            paper="",
            ours=quantiles(errors_m, ".2f"),
            agrees=bool(np.all(errors_m < 0.5)),
            why="within the paper's search of ±0.5 m at all times; Stage-type noise (0.03, 0.05)",
        ),
    ]


def draw(table: Table, picture: Picture) -> None:
    """The paths of the first seed on the floor plan, and landmarks found over time."""
    ground, over_time = picture.subplots(1, 2, width_ratios=(6, 5))
    rows = table.cases[min(table.cases, key=seed_of)]
    draw_walls(ground, load_floorplan(DEFAULT).walls)
    places = [node.place for node in office().nodes if node.place]
    ground.plot(*zip(*places, strict=True), "o", mfc="none", mec="0.4", ms=5, label="encoded landmarks")
    for number, colour in enumerate(COLOURS):
        own = rows[rows[:, 1] == number]
        ground.plot(own[:, 2], own[:, 3], color=colour, linewidth=1.5, label=f"robot {number + 1}")
        over_time.plot(own[:, 0], own[:, 4], color=colour, label=f"robot {number + 1}")
        over_time.plot(own[:, 0], own[:, 4] + own[:, TOLD], color=colour, linestyle=":")
    over_time.plot([], [], color="0.4", linestyle=":", label="with those told by others")
    over_time.axhline(LANDMARKS, color="0.6", linewidth=0.8)
    over_time.set(xlabel="time (s)", ylabel="landmarks found", ylim=(0, LANDMARKS + 4))
    ground.legend(fontsize=8, loc="upper left", bbox_to_anchor=(0, 1.08), ncols=3, frameon=False)
    over_time.legend(fontsize=8, loc="upper left")
