"""The scorecard as pictures, one for each protocol: damage, time to Safe Mode, correct robots stopped."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from phalanx.config.defence import DEFENCES
from phalanx.experiments.plot import BLUE, ORANGE, VERMILION, Axes, blank, finish, legend_above

from .card import Line

COLOURS: dict[str, str] = dict(zip(DEFENCES, (VERMILION, ORANGE, BLUE), strict=True))
WORDS: dict[str, str] = dict(zip(DEFENCES, ("no defence", "as the paper prints it", "ours (bound)"), strict=True))
SHIFT: dict[str, float] = dict(zip(DEFENCES, (-0.25, 0.0, 0.25), strict=True))
# Of what counts as a bite: less is drawn at the axis, more at the edge.
LEAST, MOST = 0.01, 300.0
ROW_IN, HEAD_IN = 0.24, 2.4


def draw_card(folder: Path, table: Sequence[Line], version: str) -> list[Path]:
    """The PNGs and SVGs of all protocols in a table.

    Raises: Unavailable: matplotlib is missing, or the disk is full.
    """
    made: list[Path] = []
    for protocol in dict.fromkeys(line.protocol for line in table):
        of = [line for line in table if line.protocol == protocol]
        name = "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in protocol)
        made += _draw(folder / f"scorecard-{name}", protocol, of, version)
    return made


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
    costs = [line.cost_bytes_per_s for line in of if line.defence == "bound" and line.cost_bytes_per_s]
    cost = f"; audits send {np.median(costs) / 1000:.2f} kB/s a robot" if costs else ""
    footer = f"{runs} runs, {misses} with a promise that was not kept{cost}\nphalanx {version}"
    return finish(picture, f"Every attack on {protocol}, without a defence, with the paper's, with ours", footer, stem)


def _legend(axes: Axes, of: Sequence[Line]) -> None:
    for defence in dict.fromkeys(line.defence for line in of):
        axes.plot([], [], "o-", color=COLOURS[defence], ms=4, label=WORDS[defence])
    legend_above(axes, columns=3)
