"""`phalanx doctor`: what is here, what is missing, what to do about it."""

from __future__ import annotations

import click

from phalanx.cli.options import FILE, broker_ws_option, json_option, login_option, option, root_option, runs


@click.command(epilog="Example: phalanx doctor --broker wss://broker.example.org:8884/mqtt")
@option("--broker", help="Also try to reach this broker: mqtt(s):// or ws(s):// URL.")
@broker_ws_option
@root_option
@login_option
@option("--visitors-login", type=FILE, help="File with user:password that phones say to that broker.")
@json_option
@runs("doctor", "doctor")
def doctor() -> None:
    """Look at what is installed, which ports are free, the clock, and whether a broker is reachable."""
