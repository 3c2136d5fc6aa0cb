"""Print the lists of bundled scenarios and attacks."""

from __future__ import annotations

import json
from typing import Any

import click

from phalanx.config.builtin import built_in
from phalanx.config.defence import DEFENCES
from phalanx.robot.adversary.attack import Attack
from phalanx.robot.adversary.registry import attacks
from phalanx.scenarios.file import find_scenario, scenario_schema

from .terminal import beside, print_json


def list_scenarios(as_json: bool) -> None:
    """Print the bundled scenarios."""
    found = [find_scenario(name) for name in built_in("scenarios")]
    if as_json:
        rows = [
            {
                "name": each.name,
                "about": each.about,
                "robots": each.robots,
                "duration_s": each.duration_s,
                "defence": each.defence,
                "attacks": [attack.name for attack in each.attacks],
            }
            for each in found
        ]
        print_json({"scenarios": rows})
        return
    for each in found:
        head = f"{each.name:12} {each.robots:4} robots {each.duration_s:5g} s  {each.defence:6} "
        click.echo(beside(head, each.about))


def print_schema() -> None:
    """Print the JSON schema of scenario files."""
    click.echo(json.dumps(scenario_schema(), indent=2, ensure_ascii=False))


def list_attacks(as_json: bool) -> None:
    """Print all attacks, by robots and on missions, and the verdict of each defence."""
    known = [each for _, each in sorted(attacks().items())]
    rows = [{**_row(each), "robots": "f_max" if each.crowd else 1} for each in known if each.scene == "flock"]
    protocols = [{**_row(each), "against": each.against} for each in known if each.scene == "protocol"]
    missions = [{**_row(each), "against": each.against} for each in known if not each.in_swarm]
    if as_json:
        print_json({"attacks": rows, "protocols": protocols, "missions": missions})
        return
    width = max(map(len, attacks()))
    _table("by robots", rows, width)
    click.echo()
    _table("in other protocols", protocols, width)
    click.echo()
    _table("on missions", missions, width)


def _row(attack: Attack) -> dict[str, Any]:
    return {
        "name": attack.name,
        "does": attack.does,
        "stopped_by": attack.stopped_by,
        "verdicts": {defence: str(attack.verdicts[defence]) for defence in DEFENCES},
    }


def _table(title: str, rows: list[dict[str, Any]], width: int) -> None:
    click.echo(f"{title:{width}} " + " ".join(f"{defence:12}" for defence in DEFENCES))
    for row in rows:
        against = f"{row['against']}: " if "against" in row else "f_max robots: " if row["robots"] == "f_max" else ""
        verdicts = " ".join(f"{verdict:12}" for verdict in row["verdicts"].values())
        click.echo(f"{row['name']:{width}} {verdicts}{against}{row['does']}")
        click.echo(f"{'':{width + 13 * len(DEFENCES)}} {row['stopped_by']}")
