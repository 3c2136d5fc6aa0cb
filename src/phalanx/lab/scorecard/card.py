"""The table of a scorecard: a line for each attack, protocol and defence; its CSV, and a picture for each protocol."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from phalanx.config.defence import DEFENCES
from phalanx.errors import UsageError, did_you_mean
from phalanx.lab.figures.plot import BLUE, ORANGE, VERMILION, Axes, blank, finish, legend_above
from phalanx.net.private_file import write_whole
from phalanx.robot.adversary.registry import attacks as known_attacks

COLOURS: dict[str, str] = dict(zip(DEFENCES, (VERMILION, ORANGE, BLUE), strict=True))
LABELS: dict[str, str] = dict(zip(DEFENCES, ("no defence", "as the paper prints it", "ours (hardened)"), strict=True))
SHIFT: dict[str, float] = dict(zip(DEFENCES, (-0.25, 0.0, 0.25), strict=True))
# Range of the harm axis, relative to the least harm that counts as a bite; values outside are drawn at its ends.
LEAST, MOST = 0.01, 300.0
ROW_IN, HEAD_IN = 0.24, 2.4


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """Results of an attack under a defence in a protocol, over the seeds; None where not measured."""

    protocol: str
    attack: str
    defence: str
    declared: str  # verdict that the attack declares for this defence
    runs: int
    harm: float | None  # median
    harm_worst: float | None
    harm_undefended: float | None  # median with defence none
    harm_unit: str
    bites_from: float  # least harm that the attack counts as a bite
    deviated: int  # compromised robots that deviated from an honest robot's behaviour
    stopped: int  # of these
    stop_median_s: float | None  # from the first deviation to Safe Mode, median over runs of the slowest stop
    stop_worst_s: float | None
    bound_s: float | None
    correct_stopped: int  # number of robots over all runs
    cost_bytes_per_s: float | None  # sent by one robot for audits, each radio attempt counted
    cost_airtime_pct: float | None  # share of the time that these packets occupy the channel
    misses: int  # runs in which a promise was broken
    missed: str  # the broken promises, each with the number of runs


def lines(rows: Iterable[Mapping[str, Any]]) -> list[Line]:
    """Return the table of a store's rows. Of two rows with the same seed the later one counts: its attack was changed.

    Raises: UsageError: a row has an unknown defence.
    """
    newest = {tuple(row[name] for name in ("protocol", "attack", "defence", "seed")): row for row in rows}
    of: dict[tuple[str, str, str], list[Mapping[str, Any]]] = {}
    for (protocol, attack, defence, _), row in newest.items():
        if defence not in DEFENCES:
            raise UsageError(
                f"a saved run has the unknown defence {defence!r}",
                f"{did_you_mean(defence, DEFENCES)}run the sweep again in another folder",
            )
        of.setdefault((protocol, attack, defence), []).append(row)
    order = {name: place for place, name in enumerate(known_attacks())}
    protocols = list(dict.fromkeys(protocol for protocol, _, _ in of))
    points = sorted(
        of, key=lambda at: (protocols.index(at[0]), order.get(at[1], len(order)), at[1], DEFENCES.index(at[2]))
    )
    return [_line(point, of[point], of.get((*point[:2], "none"), [])) for point in points]


def _line(point: tuple[str, str, str], of: list[Mapping[str, Any]], undefended: list[Mapping[str, Any]]) -> Line:
    def values(name: str, rows: list[Mapping[str, Any]] = of) -> list[float]:
        return [row[name] for row in rows if row.get(name) is not None]

    harms, stops, costs = values("harm"), values("slowest_stop_s"), values("audit_bytes_per_s")
    airtimes = values("audit_airtime_pct")
    missed = Counter(promise for row in of for promise in row["missed"].split("; ") if promise)
    protocol, attack, defence = point
    return Line(
        protocol=protocol,
        attack=attack,
        defence=defence,
        declared=of[-1]["declared"],
        runs=len(of),
        harm=median(harms) if harms else None,
        harm_worst=max(harms, default=None),
        harm_undefended=median(values("harm", undefended)) if values("harm", undefended) else None,
        harm_unit=of[-1]["harm_unit"],
        bites_from=of[-1]["bites_from"],
        deviated=sum(row["deviated"] for row in of),
        stopped=sum(row["stopped"] for row in of),
        stop_median_s=median(stops) if stops else None,
        stop_worst_s=max(stops, default=None),
        bound_s=max(values("bound_s"), default=None),
        correct_stopped=sum(row["correct_stopped"] for row in of),
        cost_bytes_per_s=median(costs) if costs else None,
        cost_airtime_pct=median(airtimes) if airtimes else None,
        misses=sum(bool(row["missed"]) for row in of),
        missed="; ".join(f"{promise} ({count})" for promise, count in missed.items()),
    )


def write_csv(path: Path, table: Iterable[Line]) -> None:
    """Write the table as CSV. Raises: Unavailable: the file cannot be written."""
    file = io.StringIO(newline="")
    writer = csv.DictWriter(file, [each.name for each in fields(Line)], lineterminator="\n")
    writer.writeheader()
    for line in table:
        cells = asdict(line).items()
        writer.writerow({name: f"{cell:.6g}" if isinstance(cell, float) else cell for name, cell in cells})
    write_whole(path, file.getvalue().encode(), "choose another folder with --out")


def draw_card(folder: Path, table: Sequence[Line], version: str) -> list[Path]:
    """Draw a PNG and an SVG for each protocol in the table, and return their paths.

    Raises: Unavailable: matplotlib is missing, or the disk is full.
    """
    paths: list[Path] = []
    for protocol in dict.fromkeys(line.protocol for line in table):
        of = [line for line in table if line.protocol == protocol]
        name = "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in protocol)
        paths += _draw(folder / f"scorecard-{name}", protocol, of, version)
    return paths


def _draw(stem: Path, protocol: str, of: Sequence[Line], version: str) -> tuple[Path, Path]:
    attacks = list(dict.fromkeys(line.attack for line in of))
    timed = any(line.stop_worst_s is not None for line in of)
    picture = blank(13.0, HEAD_IN + ROW_IN * len(attacks))
    damage, *others = picture.subplots(1, 3 if timed else 2, sharey=True, width_ratios=(5, 3, 2) if timed else (5, 2))
    places = {attack: place for place, attack in enumerate(attacks)}
    for line in of:
        at, colour = places[line.attack] + SHIFT[line.defence], COLOURS[line.defence]
        if line.harm is not None and line.harm_worst is not None:
            low, high = (min(max(value / line.bites_from, LEAST), MOST) for value in (line.harm, line.harm_worst))
            damage.plot((low, high), (at, at), color=colour, linewidth=1.2)
            damage.plot(low, at, "o", color=colour, ms=4)
        others[-1].barh(at, line.correct_stopped / line.runs, 0.22, color=colour)
        if timed and line.stop_median_s is not None and line.stop_worst_s is not None:
            others[0].plot((line.stop_median_s, line.stop_worst_s), (at, at), color=colour, linewidth=1.2)
            others[0].plot(line.stop_median_s, at, "o", color=colour, ms=4)
        if timed and line.bound_s is not None:
            others[0].plot(line.bound_s, at, "|", color="black", ms=6)
    damage.axvline(1.0, color="0.3", linewidth=0.8, linestyle=":")
    damage.set(xscale="log", xlim=(LEAST, MOST), xlabel="damage to others, 1 = a bite; dot: median, line: to the worst")
    if timed:
        others[0].set(xlabel="first lie to Safe Mode (s); | is the bound", xlim=(0, None))
    others[-1].set(xlabel="correct robots stopped, a run", xlim=(0, None))
    damage.set_yticks(range(len(attacks)), attacks, fontsize=8)
    damage.invert_yaxis()
    _legend(damage, of)
    runs, misses = sum(line.runs for line in of), sum(line.misses for line in of)
    costs = [line.cost_bytes_per_s for line in of if line.defence == "hardened" and line.cost_bytes_per_s]
    cost = f"; audits send {np.median(costs) / 1000:.2f} kB/s a robot" if costs else ""
    footer = f"{runs} runs, {misses} with a broken promise{cost}\nphalanx {version}"
    return finish(picture, f"Every attack on {protocol} without defence, with the paper's, with ours", footer, stem)


def _legend(axes: Axes, of: Sequence[Line]) -> None:
    for defence in dict.fromkeys(line.defence for line in of):
        axes.plot([], [], "o-", color=COLOURS[defence], ms=4, label=LABELS[defence])
    legend_above(axes, columns=3)
