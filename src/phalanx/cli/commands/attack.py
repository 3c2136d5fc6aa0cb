"""`phalanx attack`: attacks by compromised robots and on missions, and the defences against them."""

from __future__ import annotations

from pathlib import Path

import click

from phalanx.cli import options
from phalanx.cli.complete import a_scenario_s_controller, an_attack
from phalanx.cli.options import OUT_FOLDER, implemented_by, option


@click.group(epilog="Example: phalanx attack run spoof --defence none")
def attack() -> None:
    """Compromise a robot or a mission, and measure the damage with each defence."""


@attack.command("list", epilog="Example: phalanx attack list --json")
@options.json_option
@implemented_by("lists", "list_attacks")
def list_attacks() -> None:
    """List all attacks, by robots and on missions, and what each defence does against them."""


@attack.command(epilog="Example: phalanx attack run spoof:robot=7,at=10 --defence none --duration 120")
@click.argument("name", shell_complete=an_attack, metavar="NAME|FILE.py:CLASS[:robot=I,at=T,…]")
@options.defence_option(
    default="hardened",
    show_default=True,
    help="none, paper or hardened. On missions: not encoded; profile paper, unsigned; or profile sealed, signed.",
)
@options.swarm_options
@options.controller_option
@options.json_option
@implemented_by("attack", "run")
def run() -> None:
    """Run the attack NAME and the same run without it. Print the damage, and when the robot was stopped.

    By default 25 robots flock to (500, 500) for 150 s, and the attack begins at 15 s.

    Exit with 1 if a promise was broken: the compromised robot was not stopped in time or used more airtime than its
    a-node allows, or a correct robot with a quorum was stopped. Also exit with 1 if an attack on a mission ends with
    another verdict than phalanx attack list shows. Attacks on missions run on one robot in a small building, or on
    four that audit each other. They accept --defence, --seed and --json only.
    """


@attack.command(
    epilog="Example: phalanx attack scorecard spoof hijack --controller flock --seeds 5; phalanx docs guides/scorecard"
)
@click.argument("attacks", nargs=-1, shell_complete=an_attack, metavar="[NAME|FILE.py:CLASS[:at=T,…]]...")
@option(
    "--controller",
    "controllers",
    help="Protocol to attack: a bundled controller, mission, team, or your own controller; repeatable. Default:"
    " all bundled protocols.",
    multiple=True,
    shell_complete=a_scenario_s_controller,
    metavar="NAME|FILE.py:CLASS",
)
@option("--seeds", type=click.IntRange(1, 10_000), default=3, help="Number of seeds for each combination.", metavar="N")
@options.cluster_options
@option("--out", type=OUT_FOLDER, default=Path("out/scorecard"), help="Folder for the runs, the CSV and the pictures.")
@options.json_option
@implemented_by("scorecard", "scorecard")
def scorecard() -> None:
    """Run every attack against every defence in every protocol, and write a table of damage, stops and cost.

    Runs that are already in --out are not repeated: after Ctrl-C, or with more seeds or attacks, the same command
    continues. Exit with 1 if interrupted, if a run failed, or if defence hardened broke a promise.
    """
