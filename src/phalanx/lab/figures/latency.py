"""Plot of Qrkey Fig. 4: latency over time, and its distribution."""

from __future__ import annotations

import math
from collections.abc import Sequence

from phalanx.papers.link.fig4_table import (
    KINDS,
    PAPER,
    SLOW_MS,
    Kind,
    Packets,
    Row,
    Summary,
    is_slow,
    packets,
    summarize,
)
from phalanx.papers.table import Table

from .plot import BLUE, VERMILION, Axes, Picture, legend_above

COLOUR: dict[Kind, str] = {"plain": BLUE, "sealed": VERMILION}
SHAPE: dict[Kind, str] = {"plain": "s", "sealed": "D"}
CROSS: dict[Kind, str] = {"plain": "x", "sealed": "+"}
TIME_UNITS = ((3 * 3600, "h", 3600), (180, "min", 60), (0, "s", 1))
MANY_POINTS = 20_000


def draw_fig4(table: Table, picture: Picture) -> str:
    """Draw latency over time and its distribution. Source: Qrkey Fig. 4; the paper's points from the text of §V."""
    rows = packets(table)
    over_time, distribution = picture.subplots(1, 2, width_ratios=(6, 5))
    summaries = {kind: summarize(rows[kind]) for kind in KINDS}
    _draw_over_time(over_time, table, rows, summaries)
    _draw_distribution(distribution, table, rows, summaries)
    for axes in (over_time, distribution):
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter("")
        legend_above(axes)
    sent = ", ".join(f"{summaries[kind].sent} {kind}" for kind in KINDS)
    return (
        f"{sent} packets of 20 characters, one of each every {table.origin['interval_s']:g} s; "
        f"lost after {table.origin['lost_after_s']:g} s; hollow: the paper's, through HiveMQ\n"
        f"phalanx {table.version}; broker: {table.origin['broker']}"
    )


def _draw_over_time(axes: Axes, table: Table, rows: Packets, summaries: dict[Kind, Summary]) -> None:
    interval_s = table.origin["interval_s"]
    span_s = max(1, *(summary.sent for summary in summaries.values())) * interval_s
    unit, unit_s = next((unit, unit_s) for least_s, unit, unit_s in TIME_UNITS if span_s >= least_s)
    span = span_s / unit_s
    # In order of time, so that neither kind hides the other.
    every = sorted((row for kind in KINDS for row in rows[kind]), key=lambda row: row.seq)
    back = [(row.seq * interval_s / unit_s, row.latency_ms, row.kind) for row in every if row.latency_ms is not None]
    many = len(back) > MANY_POINTS
    axes.scatter(
        [at for at, _, _ in back],
        [latency_ms for _, latency_ms, _ in back],
        s=2 if many else 12,
        c=[COLOUR[kind] for _, _, kind in back],
        alpha=0.4 if many else 0.7,
        linewidths=0,
        rasterized=many,
    )
    lost_ms = table.origin["lost_after_s"] * 1000
    if any(summary.lost for summary in summaries.values()):
        axes.text(0.01 * span, lost_ms, "lost:", va="center", fontsize=8)
    # Means side by side in the margin, because they may coincide.
    for place, kind in zip((1.04, 1.08), KINDS, strict=True):
        lost = [row.seq * interval_s / unit_s for row in rows[kind] if row.outcome in ("lost", "late")]
        axes.plot(lost, [lost_ms] * len(lost), CROSS[kind], color=COLOUR[kind])
        mean_ms = summaries[kind].mean_ms
        outcome = "nothing came back" if mean_ms is None else f"mean {mean_ms:.2f} ms, {len(lost)} lost"
        axes.plot([place * span], [mean_ms or lost_ms], SHAPE[kind], color=COLOUR[kind], label=f"{kind}: {outcome}")
    paper_ms = PAPER["mean_ms"]
    axes.plot(
        [1.12 * span],
        [paper_ms],
        "o",
        mfc="none",
        mec="black",
        label=f"paper: mean {paper_ms} ms, {PAPER['lost']} lost",
    )
    axes.axvline(span, color="0.6", linewidth=0.8)
    axes.text(1.08 * span, 0.985, "means", ha="center", va="top", fontsize=8, transform=axes.get_xaxis_transform())
    axes.axhline(SLOW_MS, color="0.4", linewidth=0.8, linestyle=":")
    axes.set(xlabel=f"time measured ({unit})", ylabel="latency (ms)", yscale="log")
    axes.set_xlim(0, 1.16 * span)
    axes.set_xticks([tick for tick in axes.get_xticks() if 0 <= tick <= span])
    axes.set_ylim(*_latency_limits(table, rows))


def _draw_distribution(axes: Axes, table: Table, rows: Packets, summaries: dict[Kind, Summary]) -> None:
    most = 1
    for kind in KINDS:
        decided = [row for row in rows[kind] if row.outcome != "cut"]
        most = max(most, len(decided))
        latencies, shares_pct = _shares_above(decided)
        slow, share_pct = sum(map(is_slow, decided)), summaries[kind].slow_pct
        label = f"{kind}: {slow} of {len(decided)} above {SLOW_MS:g} ms"
        marker = SHAPE[kind] if share_pct else ""  # zero cannot be drawn on a logarithmic axis
        axes.step(latencies, shares_pct, where="post", color=COLOUR[kind], alpha=0.85)
        axes.plot([SLOW_MS], [share_pct or 100], color=COLOUR[kind], marker=marker, label=label)
    paper_pct = PAPER["slow_pct"]
    label = f"paper: {paper_pct} % of {PAPER['sent']} above {SLOW_MS:g} ms"
    axes.plot([SLOW_MS], [paper_pct], "o", mfc="none", mec="black", label=label)
    axes.axvline(SLOW_MS, color="0.4", linewidth=0.8, linestyle=":")
    axes.set(xlabel="latency (ms)", ylabel="packets above that latency (%)", xscale="log", yscale="log")
    axes.set_xlim(*_latency_limits(table, rows))
    axes.set_ylim(min(50 / most, paper_pct / 2), 150)


def _shares_above(decided: Sequence[Row]) -> tuple[list[float], list[float]]:
    """Return the sorted latencies, and the percentage of packets above each; lost packets count as above all."""
    latencies = sorted(row.latency_ms for row in decided if row.latency_ms is not None)
    shares_pct = [100 * (len(decided) - i) / len(decided) for i in range(1, len(latencies) + 1)]
    return [*latencies[:1], *latencies], [100.0] * bool(latencies) + shares_pct


def _latency_limits(table: Table, rows: Packets) -> tuple[float, float]:
    shown = [row.latency_ms for each in rows.values() for row in each if row.latency_ms]
    some_lost = any(row.outcome in ("lost", "late") for each in rows.values() for row in each)
    least = min([*shown, PAPER["mean_ms"]])
    most = max([*shown, SLOW_MS, table.origin["lost_after_s"] * 1000 * some_lost])
    # Whole decades, so that there are at least two labelled ticks.
    return 10.0 ** math.floor(math.log10(least / 1.2)), 10.0 ** math.ceil(math.log10(most * 1.2))
