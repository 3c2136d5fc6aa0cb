"""Make the pictures and tables of docs/guides/protocols.md again: python scripts/protocols.py [NAME …]

Each protocol runs with its own attack and a few general ones, from 15 s on, under each defence, beside the same run
without an attack. The picture shows the robots' paths under the protocol's own attack, unprotected and protected.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from phalanx.attacks import IN_PROTOCOLS
from phalanx.config.defence import DEFENCES
from phalanx.config.flock import Box
from phalanx.lab.figures.plot import BLUE, GREY, VERMILION
from phalanx.scenarios.attack_spec import AttackSpec
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.scenario import PROTOCOLS
from phalanx.world.scenarios.run import Run

IMAGES = Path(__file__).parents[1] / "docs" / "img"
OTHERS = ("spoof", "false-state", "omit-sends", "hijack")
END_S, STEP_S = 90.0, 0.5


@cache
def lived(name: str, defence: str, attack: str) -> tuple[Run, list[list[list[float]]]]:
    """Run a protocol; return the finished run and all robots' paths. An empty attack name means no attack."""
    attacks = (AttackSpec(name=attack),) if attack else ()
    run = Run(replace(find_scenario(name), defence=defence, attacks=attacks, duration_s=END_S))
    ways = []
    for k in range(round(END_S / STEP_S) + 1):
        run.advance(k * STEP_S)
        ways.append(run.positions_m.tolist())
    return run, ways


def cell(name: str, defence: str, attack: str) -> str:
    """Return a table cell: the score lost by others, and when the compromised robot was stopped."""
    (run, _), (beside, _) = lived(name, defence, attack), lived(name, defence, "")
    assert run.stage
    assert beside.stage
    lost = run.stage.lost_beside(beside.stage, run.compromised)
    told = run.summary()["compromised"][0]
    safe_s = told["safe_mode_s"]
    after = "not stopped" if safe_s is None else f"stopped {safe_s - told['first_deviation_s']:.1f} s"
    wronged = run.summary()["correct_in_safe_mode"] + run.summary()["without_quorum"]
    contacts = run.summary()["contacts"] - beside.summary()["contacts"]
    return f"{after} ({lost:.3g}, {contacts} contacts{f', {len(wronged)} others stopped' if wronged else ''})"


def draw(name: str, lie: str) -> None:
    """Draw the paths of a run without a defence and of one with it, side by side."""
    picture = Figure(figsize=(10, 5))
    for axes, defence in zip(picture.subplots(1, 2, sharex=True, sharey=True), ("none", "hardened"), strict=True):
        run, ways = lived(name, defence, lie)
        assert run.stage
        for box in run.scenario.obstacles:
            if isinstance(box, Box):
                size = box.right_m - box.left_m, box.top_m - box.bottom_m
                axes.add_patch(Rectangle((box.left_m, box.bottom_m), *size, color="0.85"))
        for i, rob_id in enumerate(run.ids.tolist()):
            colour = VERMILION if rob_id in run.compromised else GREY if run.in_safe_mode[i] else BLUE
            x, y = zip(*(places[i] for places in ways), strict=True)
            axes.plot(x, y, color=colour, linewidth=0.8)
            axes.plot(x[-1], y[-1], "X" if run.in_safe_mode[i] else "o", color=colour, markersize=6)
        for x, y in run.stage.marks():
            axes.plot(x, y, "+", color="0.2", markersize=7)
        score = run.stage.score(run.compromised)
        axes.set(title=f"{lie}, defence {defence}: {score:.3g} {run.stage.counts}", xlabel="x (m)", aspect="equal")
    picture.axes[0].set_ylabel("y (m)")
    picture.tight_layout()
    picture.savefig(IMAGES / f"protocol-{name}.png", dpi=110)


def main(names: list[str]) -> int:
    for name in names or PROTOCOLS:
        lie, *shown = (attack for attack in IN_PROTOCOLS if IN_PROTOCOLS[attack].against == name)
        draw(name, lie)
        for attack in (lie, *shown, *OTHERS):
            print(f"| `{attack}` | {' | '.join(cell(name, each, attack) for each in DEFENCES)} |", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
