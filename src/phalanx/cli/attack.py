"""`phalanx attack`: the ways a robot can lie, and what each defence makes of them."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import click

from phalanx.experiments.attack_trial import Trial, try_attack
from phalanx.robot.attacks import ATTACKS
from phalanx.sim.run import Run
from phalanx.sim.scenario import DEFENCES, Scenario, parse_attack

from .sim import changed, progress, swarm_options, told
from .terminal import end_status_line, print_json

DURATION_S = 60.0


@click.group(epilog="Example: phalanx attack run spoof --defence none")
def attack() -> None:
    """Compromise a robot, and see what it can do and what stops it."""


@attack.command("list", epilog="Example: phalanx attack list --json")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def list_attacks(as_json: bool) -> None:
    """All attacks, and what each defence makes of them."""
    rows: list[dict[str, Any]] = [
        {
            "name": name,
            "does": kind.does,
            "stopped_by": kind.stopped_by,
            "verdicts": {defence: str(kind.verdicts[defence]) for defence in DEFENCES},
        }
        for name, kind in sorted(ATTACKS.items())
    ]
    if as_json:
        print_json({"attacks": rows})
        return
    width = max(map(len, ATTACKS))
    click.echo(f"{'':{width}} " + " ".join(f"{defence:12}" for defence in DEFENCES))
    for row in rows:
        click.echo(
            f"{row['name']:{width}} " + " ".join(f"{word:12}" for word in row["verdicts"].values()) + row["does"]
        )
        click.echo(f"{'':{width + 13 * len(DEFENCES)}} {row['stopped_by']}")


@attack.command("run", epilog="Example: phalanx attack run spoof:robot=7,at=10 --defence none --duration 120")
@click.argument("name", metavar="NAME[:robot=I,at=T,…]")
@click.option(
    "--defence", type=click.Choice(DEFENCES), default="bound", show_default=True, help="none, the paper's, or ours."
)
@swarm_options
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def run(name: str, defence: Any, as_json: bool, **said: Any) -> int:
    """Run NAME beside the same run without it: the damage, whether and when it was stopped, and the bound.

    Ends with 1 if a robot that should have been stopped in time was not.
    """
    first = parse_attack(name)
    others = ATTACKS[first.name].liars - 1 if first.name in ATTACKS else 0
    attacks = (first, *(replace(first, robot=None),) * others)
    scenario = changed(Scenario(name="attack", duration_s=DURATION_S), said, defence=defence, attacks=attacks)
    tell = {which: progress(scenario.duration_s, f"{which}: ") for which in ("attacked", "honest")}

    def on_step(which: str, run: Run) -> None:
        tell[which](run)

    try:
        trial = try_attack(scenario, on_step)
    finally:
        end_status_line()
    if as_json:
        print_json(asdict(trial) | {"stopped_in_time": trial.stopped_in_time})
    else:
        _show(trial)
    return 1 if trial.stopped_in_time is False else 0


def _show(trial: Trial) -> None:
    attacked, honest = trial.attacked, trial.honest
    rows = {
        "attack": f"{trial.attack}: {ATTACKS[trial.attack].does}",
        "defence": f"{trial.defence}, which should make it: {trial.declared}",
        "distance to the goal": f"{told(attacked['mean_distance_to_goal_m'], '.1f', ' m')} at the end, "
        f"{told(trial.honest_distance_m, '.1f', ' m')} without the attack",
        "harm": f"{trial.harm:.3g} {trial.harm_unit}".strip()
        + f": {trial.harm_words} (from {trial.harm_bites_from:g} on it counts)",
        "contacts": f"{attacked['contacts']}, {honest['contacts']} without the attack",
        "correct, in Safe Mode": f"{len(attacked['correct_in_safe_mode'])}, "
        f"{len(attacked['without_quorum'])} for want of a quorum",
    }
    for stop in trial.stops:
        began = told(stop.first_deviation_s, ".2f", " s")
        words = "did nothing wrong yet" if stop.first_deviation_s is None else f"deviated at {began}, "
        if stop.first_deviation_s is not None:
            late = told(stop.after_s, ".2f", " s later")
            words += "was not stopped" if stop.safe_mode_s is None else f"in Safe Mode {late}"
        rows[f"robot {stop.robot}"] = words
    rows["bound"] = told(trial.bound_s, ".3f", " s from deviation to Safe Mode") + (
        "" if trial.stopped_in_time is None else f": {'kept' if trial.stopped_in_time else 'BROKEN'}"
    )
    for label, words in rows.items():
        click.echo(f"{label:22} {words}")
