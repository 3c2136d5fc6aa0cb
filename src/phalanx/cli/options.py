"""Options that several commands share, and `implemented_by`, which binds a command to its implementation."""

from __future__ import annotations

import functools
import gc
import signal
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import click

from phalanx.config import LinkConfig
from phalanx.config.defence import DEFENCES

from .complete import a_mission, a_scenario_s_controller

Command = TypeVar("Command", bound=Callable[..., Any])
DEFAULTS = LinkConfig()


def implemented_by(module: str, function: str) -> Callable[[Callable[[], None]], Callable[..., Any]]:
    """Return a decorator: the command imports phalanx.cli.MODULE and calls its `function` with the options by name.

    The decorated function is empty; its docstring is the command's help.
    """

    def declared(stub: Callable[[], None]) -> Callable[..., Any]:
        @functools.wraps(stub)
        def run(**options: Any) -> Any:
            name = f"phalanx.cli.{module}"
            if name not in sys.modules:
                # Imported modules stay in use: collecting garbage among them took a fifth of the start.
                gc.disable()
                import_module(name)
                gc.freeze()
                gc.enable()
            if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:  # as __main__.py leaves it
                signal.signal(signal.SIGINT, signal.default_int_handler)
            return getattr(sys.modules[name], function)(**options)

        run.runs = module, function  # type: ignore[attr-defined]
        return run

    return declared


def option(*names: str, **more: Any) -> Callable[[Command], Command]:
    """Return click's option, with its default shown unless that is None or empty."""
    return click.option(*names, **{"show_default": more.get("default") not in (None, "")} | more)


def combine_options(*options: Callable[[Any], Any]) -> Callable[[Command], Command]:
    """Combine several options into one decorator, shown in this order."""

    def added(command: Command) -> Command:
        for each in reversed(options):
            command = each(command)
        return command

    return added


def defence_option(**more: Any) -> Callable[[Command], Command]:
    """Return the option --defence, with the command's own help."""
    return option("--defence", type=click.Choice(DEFENCES), **more)


def out_option(words: str, **more: Any) -> Callable[[Command], Command]:
    """Return the option --out, a file to write, with the help `words`."""
    return option("--out", help=words, type=OUT_FILE, required=True, **more)


def link_config(options: dict[str, Any]) -> LinkConfig:
    """Return the settings from `link_options`, removed from `options`."""
    return LinkConfig(**{name: options.pop(name) for name in ("pin_digits", "rotate_s", "overlap_s", "root")})


FILE = click.Path(path_type=Path)
OUT_FILE = click.Path(path_type=Path, dir_okay=False)
FOLDER = click.Path(path_type=Path, file_okay=False)
OUT_FOLDER = click.Path(path_type=Path, file_okay=False)
SECONDS = click.FloatRange(min=0, min_open=True)
PROCESSES = click.IntRange(min=1)
PORT = click.IntRange(0, 65535)
broker_ws_option = option("--broker-ws", default="", help="Websocket URL of the broker, for browsers.")
root_option = option("--root", default=DEFAULTS.root, help="First level of every MQTT topic.")
link_options = combine_options(
    option(
        "--pin-digits", default=DEFAULTS.pin_digits, help="Digits of the pin; the paper's 12 can be guessed offline."
    ),
    option("--rotate-s", default=DEFAULTS.rotate_s, help="Seconds until a new pin replaces the current one."),
    option("--overlap-s", default=DEFAULTS.overlap_s, help="Seconds for which the previous pin is still accepted."),
    root_option,
)
passphrase_option = option(
    "--passphrase-file", help="File whose first line is the passphrase. Default: prompt for it.", type=FILE
)
login_option = option(
    "--broker-login",
    type=FILE,
    help="File with user:password for the broker; or set PHALANX_BROKER_USERNAME and PHALANX_BROKER_PASSWORD.",
)
state_option = option(
    "--state",
    help="The --state folder of the running gateway.  [default: ~/.local/state/phalanx]",
    type=FOLDER,
)
# Options that change a scenario.
swarm_options = combine_options(
    option("--robots", type=int, metavar="N", help="Number of robots, on a square grid."),
    option("--spacing", "spacing_m", type=float, metavar="M", help="Distance between neighbours, metres."),
    option("--duration", "duration_s", type=float, metavar="S", help="Simulated seconds."),
    option("--f-max", type=int, metavar="F", help="Number of compromised robots that the mission tolerates."),
    option("--t-audit", "t_audit_s", type=float, metavar="S", help="Seconds between two rounds of audits."),
    option("--t-val", "t_val_s", type=float, metavar="S", help="Seconds for which a token is valid."),
    option("--seed", type=int, metavar="S", help="Seed of all random numbers."),
)
# Options of commands with many runs.
cluster_options = combine_options(
    option(
        "--scheduler",
        metavar="ADDRESS",
        help="Address of a dask scheduler, such as tcp://10.0.0.1:8786. Default: run on this machine.",
    ),
    option("--workers", type=PROCESSES, help="Number of processes. Default: one for each processor.", metavar="N"),
)
json_option = option("--json", "as_json", help="Print JSON.", is_flag=True)
controller_option = option(
    "--controller",
    help="Controller of honest robots: flock, guard, or your own class or kernels in FILE.py.",
    shell_complete=a_scenario_s_controller,
    metavar="FILE.py[:CLASS]",
)
planner_option = option(
    "--planner",
    help="Your own planner class for guarded robots. Default: straight to the goal.",
    metavar="FILE.py:CLASS",
)
record_option = option(
    "--record", help="Record the run for Foxglove and phalanx sim view.", type=OUT_FILE, metavar="FILE.mcap"
)
out_folder_option = option("--out", type=OUT_FOLDER, default=Path("out"), help="Folder for the CSV and the figure.")
duration_option = option("--duration", "duration_s", help="End after this many seconds.", type=SECONDS)
wait_option = option(
    "--wait",
    "wait_s",
    help="Give up if the broker has not answered after this many seconds.",
    type=SECONDS,
    default=30.0,
)
furnish_option = option(
    "--furnish",
    help="The mission that the FILEs were built from. It adds what a FILE does not contain: codes on the walls, the"
    " robots' actions, and their start.",
    metavar="MISSION.yaml|BUILTIN",
    shell_complete=a_mission,
)
