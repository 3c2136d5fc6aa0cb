"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from phalanx.config import LinkConfig
from phalanx.config.defence import DEFENCES

from .complete import a_controller, a_mission

Command = TypeVar("Command", bound=Callable[..., Any])
DEFAULTS = LinkConfig()


def link_options(command: Command) -> Command:
    """--pin-digits, --rotate-s, --overlap-s, --root."""
    for option in reversed(
        (
            click.option(
                "--pin-digits",
                type=int,
                default=DEFAULTS.pin_digits,
                show_default=True,
                help="Digits of the pin; the paper's 12 can be guessed offline.",
            ),
            click.option(
                "--rotate-s", type=float, default=DEFAULTS.rotate_s, show_default=True, help="Seconds between two pins."
            ),
            click.option(
                "--overlap-s",
                type=float,
                default=DEFAULTS.overlap_s,
                show_default=True,
                help="Seconds for which both are accepted.",
            ),
            click.option("--root", default=DEFAULTS.root, show_default=True, help="First part of every MQTT topic."),
        )
    ):
        command = option(command)
    return command


def broker_options(command: Command) -> Command:
    """--broker, --broker-ws, --broker-login: for commands that send visitors to the broker."""
    for option in (
        login_option,
        click.option("--broker-ws", default="", help="Websocket URL of that broker, where browsers find it."),
        click.option(
            "--broker",
            default="auto",
            show_default=True,
            help="auto, mosquitto, amqtt, or a mqtt(s):// or ws(s):// URL.",
        ),
    ):
        command = option(command)
    return command


def login_option(command: Command) -> Command:
    """--broker-login."""
    return click.option(
        "--broker-login",
        type=click.Path(path_type=Path),
        help="File with user:password for the broker; or set PHALANX_BROKER_USERNAME and PHALANX_BROKER_PASSWORD.",
    )(command)


def swarm_options(command: Command) -> Command:
    """--robots, --spacing, --duration, --f-max, --t-audit, --t-val, --seed: what people change of a scenario."""
    for option in reversed(
        (
            click.option("--robots", type=int, metavar="N", help="How many, on a square grid."),
            click.option("--spacing", type=float, metavar="M", help="Grid step and spacing of the flock, metres."),
            click.option("--duration", type=float, metavar="S", help="Simulated seconds."),
            click.option("--f-max", type=int, metavar="F", help="Liars that are tolerated."),
            click.option("--t-audit", type=float, metavar="S", help="Seconds from one round of audits to the next."),
            click.option("--t-val", type=float, metavar="S", help="Seconds for which a token counts."),
            click.option("--seed", type=int, metavar="S", help="Of everything that is drawn."),
        )
    ):
        command = option(command)
    return command


def defence_option(**more: Any) -> Callable[[Command], Command]:
    """--defence, in words of the command's own."""
    return click.option("--defence", type=click.Choice(DEFENCES), **more)


json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
controller_option = click.option(
    "--controller",
    shell_complete=a_controller,
    metavar="FILE.py:CLASS",
    help="What honest robots run: a controller of your own, or flock.",
)
record_option = click.option(
    "--record", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE.mcap", help="Record it for Foxglove."
)
out_folder_option = click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("out"),
    show_default=True,
    help="Folder for the CSV and the figure.",
)
duration_option = click.option(
    "--duration", type=click.FloatRange(min=0, min_open=True), help="End after so many seconds."
)
furnish_option = click.option(
    "--furnish",
    metavar="MISSION.yaml|BUILTIN",
    shell_complete=a_mission,
    help="What encoded FILEs were built from, in the order of its parts: hangs its codes on the walls, lets robots do"
    " its actions, and puts them where its parts begin.",
)
