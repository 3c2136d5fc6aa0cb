"""`phalanx attack`: the ways a robot can lie, and what each defence makes of them."""

from __future__ import annotations

from pathlib import Path

import click

from phalanx.cli import options
from phalanx.cli.complete import a_scenario_s_controller, an_attack
from phalanx.cli.options import OUT_FOLDER, option, runs


@click.group(epilog="Example: phalanx attack run spoof --defence none")
def attack() -> None:
    """Compromise a robot, or its mission, and see what that can do and what stops it."""


@attack.command("list", epilog="Example: phalanx attack list --json")
@options.json_option
@runs("lists", "list_attacks")
def list_attacks() -> None:
    """All attacks, by robots and on missions, and what each defence makes of them."""


@attack.command(epilog="Example: phalanx attack run spoof:robot=7,at=10 --defence none --duration 120")
@click.argument("name", shell_complete=an_attack, metavar="NAME|FILE.py:CLASS[:robot=I,at=T,…]")
@options.defence_option(
    default="hardened",
    show_default=True,
    help="none, the paper's, or ours; of a mission: a plain graph, the paper profile unsigned, or sealed and signed.",
)
@options.swarm_options
@options.controller_option
@options.json_option
@runs("attack", "run")
def run() -> None:
    """Run NAME beside the same run without it: the damage, whether and when it was stopped, and the bound.

    The swarm is 25 robots that flock to (500, 500) for 150 s, unless options say otherwise; NAME lies from 15 s on.

    Ends with 1 if a robot was not stopped in time that should have been, or was on the air for longer than its bucket
    lets it; if a correct robot was stopped though it had a quorum; or if a mission's verdict is not what was seen.
    Attacks on missions run on an errand in a small building, those on peers in a team of four; of the options they
    take --defence, --seed and --json.
    """


@attack.command(
    epilog="Example: phalanx attack scorecard spoof hijack --controller flock --seeds 5; docs/guides/scorecard.md"
)
@click.argument("attacks", nargs=-1, shell_complete=an_attack, metavar="[NAME|FILE.py:CLASS[:at=T,…]]...")
@option(
    "--controller",
    "controllers",
    help="A protocol: a bundled controller, mission, team, or a controller of your own; again for a further one. "
    "Without, all that come with phalanx.",
    multiple=True,
    shell_complete=a_scenario_s_controller,
    metavar="NAME|FILE.py:CLASS",
)
@option("--seeds", type=click.IntRange(1, 10_000), default=3, help="Runs of each.", metavar="N")
@options.cluster_options
@option("--out", type=OUT_FOLDER, default=Path("out/scorecard"), help="Folder for the runs, the CSV and the pictures.")
@options.json_option
@runs("scorecard", "scorecard")
def scorecard() -> None:
    """Try every attack under every defence in every protocol: damage, when it was stopped, who else was, and the cost.

    What is there already is not run again: after Ctrl-C, with more seeds or further attacks the same folder goes on,
    and the table has all that is in it. Ends with 1 if it was stopped, a run failed, or ours did not keep a promise.
    """
