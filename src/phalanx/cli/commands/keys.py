"""`phalanx keys`: the master keys, mission keys and signing keys of a swarm."""

from __future__ import annotations

from typing import Any

import click

from phalanx.cli.complete import a_scenario
from phalanx.cli.options import FILE, implemented_by, json_option, option, out_option, passphrase_option

file_argument = click.argument("file", type=FILE)
robot_argument = click.argument("robot", type=int)


@click.group(epilog="Example: phalanx keys create lab.keys")
def keys() -> None:
    """Manage a swarm's keys: master keys, mission keys, and keys that sign missions and orders."""


@keys.command(epilog="Example: phalanx keys create lab.keys --name lab")
@file_argument
@option("--name", help="Name of the swarm. Default: the file's name.", default="")
@passphrase_option
@implemented_by("keys", "make")
def create() -> None:
    """Create a key file, encrypted with a passphrase. Without the passphrase the boards have to be replaced."""


@keys.command(epilog="Example: phalanx keys provision lab.keys 7 --out robot-7.bin")
@file_argument
@robot_argument
@out_option("File for the board: the robot's id (2 bytes) and its master key (20 bytes).")
@passphrase_option
@implemented_by("keys", "provision")
def provision() -> None:
    """Create the master key of a robot's trusted nodes and write it to a file. Works once per robot."""


@keys.command(epilog="Example: phalanx keys issue lab.keys --out mission.json")
@file_argument
@out_option("File for the mission key, encrypted for each robot: only its trusted nodes can decrypt it.")
@option("--rotate", is_flag=True, help="Also create new keys that sign orders, stops and advice.")
@option(
    "--mission",
    metavar="SCENARIO",
    shell_complete=a_scenario,
    help="Mission that the key is for: signed into the file, and checked by phalanx robot verify.",
)
@passphrase_option
@implemented_by("keys", "issue")
def issue() -> None:
    """Issue the next mission's key to all robots that are not retired."""


@keys.command(epilog="Example: phalanx keys rotate lab.keys --out mission.json")
@file_argument
@out_option("File for the mission key, as for issue.")
@passphrase_option
@click.pass_context
def rotate(context: click.Context, /, **options: Any) -> None:
    """Issue the next mission's key, and new keys for orders, stops and advice; same as issue --rotate."""
    context.invoke(issue, rotate=True, **options)


@keys.command(epilog="Example: phalanx keys retire lab.keys 7")
@file_argument
@robot_argument
@passphrase_option
@implemented_by("keys", "retire")
def retire() -> None:
    """Exclude a lost robot from all future missions."""


@keys.command(name="list", epilog="Example: phalanx keys list lab.keys --json")
@file_argument
@json_option
@passphrase_option
@implemented_by("keys", "show")
def list_() -> None:
    """List the robots that have a master key, the number of missions issued, and the public keys."""


@keys.command(epilog="Example: phalanx keys export lab.keys missions --out operator.pem")
@file_argument
@click.argument("signer", type=click.Choice(["missions", "orders", "stops", "advice"]))
@out_option("PEM file, for mission build --sign-key; with --public, for mission verify --trust.")
@option("--public", is_flag=True, help="Write the public key instead, to verify signatures.")
@passphrase_option
@implemented_by("keys", "export")
def export() -> None:
    """Write the key that signs missions, a gateway's orders, an operator's stops, or a planner's advice."""


@keys.command(epilog="Example: phalanx keys passphrase lab.keys")
@file_argument
@passphrase_option
@option("--new-passphrase-file", help="File whose first line is the new passphrase. Default: prompt for it.", type=FILE)
@implemented_by("keys", "renew_passphrase")
def passphrase() -> None:
    """Encrypt the file with another passphrase."""
