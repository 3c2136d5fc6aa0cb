"""`phalanx keys`: a swarm's master key, mission keys, and keys that sign."""

from __future__ import annotations

from typing import Any

import click

from phalanx.cli.complete import a_scenario
from phalanx.cli.options import FILE, json_option, option, out_option, passphrase_option, runs

file_argument = click.argument("file", type=FILE)
robot_argument = click.argument("robot", type=int)


@click.group(epilog="Example: phalanx keys create lab.keys")
def keys() -> None:
    """Who is in the swarm: master keys, mission keys, and keys that sign missions and orders."""


@keys.command(epilog="Example: phalanx keys create lab.keys --name lab")
@file_argument
@option("--name", help="Of the swarm; without, the file's.", default="")
@passphrase_option
@runs("keys", "make")
def create() -> None:
    """Make a file of keys, sealed with a passphrase of yours. Whoever loses it needs new boards."""


@keys.command(epilog="Example: phalanx keys provision lab.keys 7 --out robot-7.bin")
@file_argument
@robot_argument
@out_option("For the board: the robot's number, two bytes, and its master key, twenty.")
@passphrase_option
@runs("keys", "provision")
def provision() -> None:
    """Give a robot's trusted nodes their master key, once."""


@keys.command(epilog="Example: phalanx keys issue lab.keys --out mission.json")
@file_argument
@out_option("The mission key, sealed for each robot: nobody but their nodes can read it.")
@option("--rotate", is_flag=True, help="And sign orders, stops and advice with new keys from now on.")
@option(
    "--mission", metavar="SCENARIO", shell_complete=a_scenario, help="Which mission it is for: signed, for evidence."
)
@passphrase_option
@runs("keys", "issue")
def issue() -> None:
    """Issue the key of the next mission to all robots that are not retired."""


@keys.command(epilog="Example: phalanx keys rotate lab.keys --out mission.json")
@file_argument
@out_option("As for issue.")
@passphrase_option
@click.pass_context
def rotate(context: click.Context, /, **said: Any) -> None:
    """Issue the next mission's key, and sign orders, stops and advice with new keys: as issue --rotate."""
    context.invoke(issue, rotate=True, **said)


@keys.command(epilog="Example: phalanx keys retire lab.keys 7")
@file_argument
@robot_argument
@passphrase_option
@runs("keys", "retire")
def retire() -> None:
    """Leave a robot that was lost out of all missions to come."""


@keys.command(name="list", epilog="Example: phalanx keys list lab.keys --json")
@file_argument
@json_option
@passphrase_option
@runs("keys", "show")
def list_() -> None:
    """Show which robots have a master key, and how many missions were issued. No key is shown but public ones."""


@keys.command(epilog="Example: phalanx keys export lab.keys missions --out operator.pem")
@file_argument
@click.argument("signer", type=click.Choice(["missions", "orders", "stops", "advice"]))
@out_option("PEM; mission build --sign-key takes it, and mission verify --trust the public one.")
@option("--public", is_flag=True, help="What checks signatures, instead of what makes them.")
@passphrase_option
@runs("keys", "export")
def export() -> None:
    """Write the key that signs missions, a gateway's orders, an operator's stops, or a planner's advice."""


@keys.command(epilog="Example: phalanx keys passphrase lab.keys")
@file_argument
@passphrase_option
@option("--new-passphrase-file", help="Its first line is the new one; without, you are asked.", type=FILE)
@runs("keys", "renew_passphrase")
def passphrase() -> None:
    """Seal the file with another passphrase."""
