"""Options that several commands share, and the environment: only this package reads it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from phalanx.config import LinkConfig
from phalanx.errors import UsageError
from phalanx.io import Login

Command = TypeVar("Command", bound=Callable[..., Any])
DEFAULTS = LinkConfig()


def link_options(command: Command) -> Command:
    """--mode, --pin-digits, --rotate-s, --overlap-s, --root."""
    for option in reversed(
        (
            click.option(
                "--mode", type=click.Choice(["qrkey"]), default="qrkey", show_default=True, help="Key schedule."
            ),
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


def read_login(path: Path | None) -> Login | None:
    """The broker's login from a file or the environment, or None.

    Raises: UsageError: the file cannot be read or holds no user:password. Never repeats what is in it.
    """
    if path is not None:
        try:
            with path.open() as file:  # not more of it than a login has: it may be a device
                lines = file.read(4096).splitlines()
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "not text"
            raise UsageError(f"cannot read {path}: {reason}", "a file with one line user:password") from error
        username, colon, password = lines[0].partition(":") if lines else ("", "", "")
        if not (username and colon):
            raise UsageError(f"{path} does not hold user:password", "one line, the name first")
        return Login(username, password)
    username = os.environ.get("PHALANX_BROKER_USERNAME", "")
    return Login(username, os.environ.get("PHALANX_BROKER_PASSWORD", "")) if username else None
