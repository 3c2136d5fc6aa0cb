"""`phalanx link revive`: restart a stopped simulated robot."""

from __future__ import annotations

from pathlib import Path

import click

from .gateway_of import ask_gateway
from .terminal import plain, print_json


def revive(robot: str, state: Path | None, as_json: bool) -> None:
    """Restart a stopped robot."""
    ask_gateway(state, "link/revive", {"robot": robot})
    if as_json:
        print_json({"revived": robot})
    else:
        click.echo(f"{plain(robot)} restarts in a few seconds")
