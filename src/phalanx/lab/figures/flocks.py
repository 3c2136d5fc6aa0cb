"""Plots of RoboRebound Figs. 2, 8 and 9: for each case, distances to the goal over time, and positions."""

from __future__ import annotations

import numpy as np

from phalanx.papers.bti.flock import (
    CASES,
    HONEST,
    LIAR,
    STOPPED,
    Flock,
    FlockRun,
    FlockRuns,
    mean_distances_m,
    read_reference,
    runs_of,
)
from phalanx.papers.bti.liars import FIG2, FIG8, FIG9
from phalanx.papers.table import Table

from .plot import BLUE, GREEN, GREY, VERMILION, Axes, Picture, banded, draw_obstacles, legend_above

COLOUR = {HONEST: BLUE, LIAR: VERMILION, STOPPED: GREY}
LABELS = {HONEST: "honest", LIAR: "compromised", STOPPED: "in Safe Mode"}
# Distance from the goal at which the paper's attacker keeps the flock, RoboRebound §5.3.
PAPER_Z_M = 150.0
MARGIN_M = 40.0


def draw_flock(flock: Flock, table: Table, picture: Picture) -> str:
    """Draw distances over time and positions for each case. Source: RoboRebound Fig. 8, Fig. 9."""
    runs = runs_of(table)
    seeds = runs.seeds()
    rows = picture.subplots(len(CASES), 2, width_ratios=(7, 5))
    for case, (over_time, ground) in zip(CASES, rows, strict=True):
        run = runs.runs[case, seeds[0]]
        _draw_over_time(over_time, runs, flock, run)
        _draw_ground(ground, flock, run)
        for axes in (over_time, ground):
            legend_above(axes, columns=2)
    hollow = "; hollow: an independent script" if flock.reference else ""
    return (
        f"medians and bands of {len(seeds)} seeds ({seeds[0]} to {seeds[-1]}), single robots of seed {seeds[0]}"
        f"{hollow}\nphalanx {table.version}"
    )


def _draw_over_time(axes: Axes, table: FlockRuns, flock: Flock, run: FlockRun) -> None:
    goal_m = flock.scenario(run.case, run.seed).goal_m
    distances_m = run.distances_m(goal_m)
    axes.plot(run.times_s, distances_m[:, ~run.liars], color=BLUE, alpha=0.25, linewidth=0.7)
    axes.plot(run.times_s, distances_m[:, run.liars], color=VERMILION, linewidth=1.2)
    if run.liars.any():
        label = "the compromised robot" if run.liars.sum() == 1 else f"the {run.liars.sum()} compromised robots"
        axes.plot([], [], color=VERMILION, linewidth=1.2, label=label)
        _shade(axes, run)
    means_m = mean_distances_m(table, run.case, goal_m)
    banded(axes, run.times_s, means_m, BLUE, "mean of correct robots, median of seeds", "5 to 95 % of seeds")
    if flock.reference:
        reference = read_reference()[flock.reference[run.case]]
        axes.plot(reference[:, 0], reference[:, 1], "o", mfc="none", mec="black", ms=4, label="independent reference")
    axes.axhline(PAPER_Z_M, color="0.4", linewidth=0.8, linestyle=":")
    axes.text(0, PAPER_Z_M, " paper's z = 150 m", fontsize=7.5, color="0.35", va="bottom")
    axes.set(xlabel="time (s)", ylabel=f"distance to the goal (m), {_case_label(run)}")
    axes.set_xlim(0, run.times_s[-1])
    axes.set_ylim(0, None)


def _shade(axes: Axes, run: FlockRun) -> None:
    """Shade the time in which compromised robots act, as in the paper."""
    lies = [robot for robot in run.summary["compromised"] if robot["first_deviation_s"] is not None]
    if lies:
        begin_s = min(robot["first_deviation_s"] for robot in lies)
        end_s = max(run.times_s[-1] if robot["safe_mode_s"] is None else robot["safe_mode_s"] for robot in lies)
        label = "it lies" if len(lies) == 1 else "they lie"
        axes.axvspan(begin_s, end_s, color=VERMILION, alpha=0.15, linewidth=0, label=label)


def _draw_ground(axes: Axes, flock: Flock, run: FlockRun) -> None:
    scenario = flock.scenario(run.case, run.seed)
    goal_m, start_m = scenario.goal_m, run.positions_m[0]
    corners_m = draw_obstacles(axes, scenario.obstacles)
    axes.plot(start_m[:, 0], start_m[:, 1], "o", mfc="none", mec=BLUE, ms=3.5, label="at the start")
    for state in (HONEST, LIAR, STOPPED):
        there_m = run.positions_m[-1, run.states[-1] == state]
        if len(there_m):
            label = f"at {run.times_s[-1]:g} s, {LABELS[state]}"
            axes.plot(there_m[:, 0], there_m[:, 1], "o", color=COLOUR[state], ms=3.5, label=label)
    axes.plot(*goal_m, "x", color=GREEN, ms=9, mew=2.5, label="goal")
    axes.set_aspect("equal")
    shown_m = np.vstack((run.positions_m.reshape(-1, 2), goal_m, *corners_m))
    (left_m, bottom_m), (right_m, top_m) = shown_m.min(axis=0) - MARGIN_M, shown_m.max(axis=0) + MARGIN_M
    axes.set(xlabel="x (m)", ylabel="y (m)", xlim=(left_m, right_m), ylim=(bottom_m, top_m))


def _case_label(run: FlockRun) -> str:
    liars = int(run.liars.sum())
    return "all honest" if not liars else "with a liar" if liars == 1 else f"with {liars} liars"


def draw_fig2(table: Table, picture: Picture) -> str:
    """Draw RoboRebound Fig. 2."""
    return draw_flock(FIG2, table, picture)


def draw_fig8(table: Table, picture: Picture) -> str:
    """Draw RoboRebound Fig. 8."""
    return draw_flock(FIG8, table, picture)


def draw_fig9(table: Table, picture: Picture) -> str:
    """Draw RoboRebound Fig. 9."""
    return draw_flock(FIG9, table, picture)
