"""Plots of RoboRebound Figs. 5a, 6 and 7 and Tables 1 and 2: costs of audits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phalanx.papers.bti import costs, fig6, fig7
from phalanx.papers.bti.loads import KINDS, PAPER_MS, TABLE1, TABLE2, TARGETS, Loads, costs_of, milliseconds
from phalanx.papers.statement import band
from phalanx.papers.table import Table

from .plot import BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILION, Axes, Picture, legend_above

COLOURS = (BLUE, GREEN, VERMILION, ORANGE, PURPLE)


def draw_fig6(table: Table, picture: Picture) -> str:
    """Draw bandwidth and storage over T_audit, one line per f_max."""
    over_air, stored = picture.subplots(1, 2)
    along = np.array(fig6.T_AUDIT_S, float)
    for f_max, colour in zip(fig6.F_MAX, COLOURS, strict=True):
        points = [fig6.point(f_max, t_s) for t_s in fig6.T_AUDIT_S]
        _line(over_air, along, table, points, "audit_bytes_per_s", colour, f"audits, f_max {f_max}")
        _line(stored, along, table, points, "stored_bytes", colour, f"f_max {f_max}")
        log_sent = np.full(len(along), (f_max + 1) * costs.paper()["the log"] / 1000)
        over_air.plot(along, log_sent, "s", mfc="none", color=colour, ms=4)
    over_air.axhline(costs.medians(table, [fig6.UNPROTECTED], "app_bytes_per_s")[0] / 1000, color=GREY, label="states")
    over_air.plot([], [], "s", mfc="none", color="black", ms=4, label="paper's log to f_max + 1 auditors")
    stored.plot(
        along,
        costs.paper_stored_bytes(along) / 1000,
        "s",
        mfc="none",
        color="black",
        ms=4,
        label="paper's log and two checkpoints",
    )
    over_air.set(xlabel="T_audit (s)", ylabel="sent per robot, each attempt counted (kB/s)", ylim=(0, None))
    stored.set(xlabel="T_audit (s)", ylabel="largest storage of a robot (kB)", ylim=(0, None))
    for axes in (over_air, stored):
        legend_above(axes, columns=3)
    return _footer(table)


def draw_fig7(table: Table, picture: Picture) -> str:
    """Draw the panels (a) to (d), as in the paper."""
    (a, b), (c, d) = picture.subplots(2, 2)
    for column, dense, constant in ((fig7.BANDWIDTH, a, c), (fig7.STORAGE, b, d)):
        for robots, colour in zip(fig7.SIZES, COLOURS[:4], strict=True):
            points = [fig7.point(robots, spacing_m) for spacing_m in fig7.SPACINGS_M]
            along = np.array(fig7.SPACINGS_M, float)
            _line(dense, along, table, points, column, colour, f"{robots} robots")
            dense.plot(along, _papers(table, points, column), "s", mfc="none", color=colour, ms=4)
        points = [fig7.point(robots, fig7.SPACINGS_M[-1]) for robots in (*fig7.SIZES, *fig7.LARGER)]
        along = np.array((*fig7.SIZES, *fig7.LARGER), float)
        _line(constant, along, table, points, column, BLUE, f"{fig7.SPACINGS_M[-1]} m")
        constant.plot(
            along, _papers(table, points, column), "s", mfc="none", color="black", ms=4, label="paper's estimate"
        )
        what = "sent per robot (kB/s)" if column == fig7.BANDWIDTH else "largest storage of a robot (kB)"
        dense.set(xlabel="spacing (m)", ylabel=what, xscale="log", ylim=(0, None))
        dense.set_xticks(fig7.SPACINGS_M, map(str, fig7.SPACINGS_M))
        dense.minorticks_off()
        constant.set(xlabel="robots", ylabel=what, ylim=(0, None))
    for axes, letter in ((a, "a"), (b, "b"), (c, "c"), (d, "d")):
        axes.set_ylabel(f"{letter}: {axes.get_ylabel()}")
        legend_above(axes, columns=4)
    return _footer(table)


def _papers(table: Table, points: list[str], column: str) -> NDArray[np.float64]:
    """Return the paper's estimates in kB: the log to f_max + 1 auditors, or a round's log and two checkpoints."""
    if column == fig7.BANDWIDTH:
        return (fig7.F_MAX + 1) * fig7.papers_log(table, points) / 1000
    return (
        np.array([costs.paper_stored_bytes(fig7.T_AUDIT_S, n) for n in costs.medians(table, points, "neighbours")])
        / 1000
    )


def _line(
    axes: Axes, along: NDArray[np.float64], table: Table, points: list[str], column: str, colour: str, label: str
) -> None:
    """Draw the median and the 5 to 95 % band over the seeds, in kB, of points along an axis."""
    bands = np.array([band(costs.over_seeds(table, point, column)[:, None]) for point in points])[:, :, 0] / 1000
    axes.fill_between(along, bands[:, 1], bands[:, 2], color=colour, alpha=0.25, linewidth=0)
    axes.plot(along, bands[:, 0], "o-", color=colour, ms=3.5, linewidth=1.3, label=label)


def _footer(table: Table) -> str:
    """Return the caption below the figure."""
    seeds = {case.rpartition(";")[2] for case in table.cases}
    runs = f"median and 5 to 95 % of {len(seeds)} seeds; hollow: values from the paper's text, and sums of them"
    return f"{runs}\nphalanx {table.version}"


def _draw_loads(loads: Loads, table: Table, picture: Picture) -> None:
    """Draw bars for our loads, and hollow markers for the paper's."""
    axes = picture.subplots()
    at = np.arange(len(loads.rows))
    for shift, colour, (target, label) in zip((-0.2, 0.2), (BLUE, VERMILION), TARGETS.items(), strict=True):
        axes.barh(at + shift, loads.loads_pct(table, target), 0.35, color=colour, label=label)
    paper = [call.paper_pct for call in loads.rows]
    axes.plot(paper, at, "o", mfc="none", mec="black", label="paper's PIC32MX")
    axes.set(xlabel="load (% of the time)", yticks=at)
    axes.set_yticklabels([call.name for call in loads.rows])
    axes.invert_yaxis()
    axes.legend(fontsize=8)


def draw_fig5(table: Table, picture: Picture) -> None:
    """Draw our costs as lines, and the paper's as hollow markers."""
    axes = picture.subplots()
    for kind, (name, line) in enumerate(zip(KINDS, ("-", "--"), strict=True)):
        rows = costs_of(table, kind)[0]
        for column, (colour, target) in enumerate(zip((BLUE, VERMILION), TARGETS.values(), strict=True), start=2):
            axes.plot(rows[:, 1], milliseconds(rows[:, column]), line, color=colour, label=f"{name}, {target}")
    for (name, length), ms in PAPER_MS.items():
        axes.plot(length, ms, "o" if name == "mac" else "s", mfc="none", mec="black", label=f"{name}, paper's PIC32MX")
    axes.set(xlabel="bytes", ylabel="ms at 50 MHz, one instruction a cycle", xscale="log", yscale="log")
    axes.legend(fontsize=8)


def draw_table1(table: Table, picture: Picture) -> None:
    """Draw the loads of the a-node."""
    _draw_loads(TABLE1, table, picture)


def draw_table2(table: Table, picture: Picture) -> None:
    """Draw the loads of the s-node."""
    _draw_loads(TABLE2, table, picture)
