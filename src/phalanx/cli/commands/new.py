"""`phalanx new`: a controller, an attack or a scenario to begin with."""

from __future__ import annotations

import click

from phalanx.cli.options import runs

KINDS = ("controller", "attack", "scenario")


@click.command(epilog="Example: phalanx new controller my_flock")
@click.argument("kind", type=click.Choice(KINDS))
@click.argument("name")
@runs("new", "write")
def new() -> None:
    """Write a controller, an attack or a scenario that runs as it is.

    The file is NAME.py, or NAME.yaml for a scenario, in this folder; one that is there already stays as it is. NAME is
    of small letters, digits and _. The command that runs the file goes to stdout.
    """
