"""`phalanx doctor`: check the installation, and print how to fix it."""

from __future__ import annotations

import click

from phalanx.cli import options
from phalanx.cli.options import implemented_by, option


@click.command(epilog="Example: phalanx doctor --broker wss://broker.example.org:8884/mqtt")
@option("--broker", help="Also try to connect to this broker: mqtt(s):// or ws(s):// URL.")
@options.broker_ws_option
@options.root_option
@options.login_option
@options.json_option
@implemented_by("doctor", "doctor")
def doctor() -> None:
    """Check the installation, free ports, the clock, and whether a broker is reachable."""
