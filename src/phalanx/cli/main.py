"""The command `phalanx`, with exit codes, one-line errors and logging for all commands.

Data goes to stdout, everything else to stderr. Exit codes: 0 done, 1 refused or failed, 2 misused.
"""

from __future__ import annotations

import errno
import gc
import logging
import math
import os
import sys
from collections import UserDict
from importlib import import_module

import click

from phalanx import __version__
from phalanx.errors import PhalanxError, did_you_mean

LEVELS = ("debug", "info", "warning", "error")
TERSE = "phalanx: %(levelname)s: %(message)s"  # on a terminal: no time
TIMED = "phalanx: %(levelname)s: %(asctime)s %(message)s"
LOGGED = "phalanx: %(levelname)s: %(asctime)s %(name)s: %(message)s"
# Errors of stdout on a full disk.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
# Commands: each is defined in the module of its name in phalanx.cli.commands. The texts repeat its help.
ABOUT = {
    "attack": "Compromise a robot or a mission, and measure the damage with each defence.",
    "docs": "Print a document or an example of this version, or list all of them.",
    "doctor": "Check the installation, free ports, the clock, and whether a broker is reachable.",
    "keys": "Manage a swarm's keys: master keys, mission keys, and keys that sign missions and orders.",
    "link": "Visit a swarm from a terminal; invite, approve and remove visitors; read the audit trail.",
    "mission": "Encode, check and run missions that a robot can only read step by step, at the right places.",
    "new": "Write a working controller, attack or scenario to start from.",
    "reproduce": "Measure a figure of one of the papers and draw it beside the paper's.",
    "robot": "Run one real robot as a process, or several in a simulated field.",
    "sim": "Simulate a swarm whose robots audit each other.",
    "sweep": "Run a grid of scenarios with many seeds, locally or on a cluster, and write Parquet files.",
    "up": "Run a gateway: a swarm, the visitors' page and its QR code.",
}
# Removed options, and the hint for each.
REMOVED = {"--visitors-login": "visitors connect without a login, to this machine or to a broker without logins"}
NAMES: dict[str, click.Command] = {name: click.Command(name, short_help=about) for name, about in ABOUT.items()}


class _OnUse(UserDict[str, click.Command]):
    """Commands by name, imported on first use: importing all of them takes more than a second."""

    def __getitem__(self, name: str) -> click.Command:
        if name not in self.data:
            raise KeyError(name)
        command: click.Command = getattr(import_module(f"phalanx.cli.commands.{name}"), name)
        _prepare(command)
        return command


def _prepare(command: click.Command) -> None:
    """Reject non-finite numbers in all options of a command, and show whole first sentences in a group's help.

    NaN passes range checks, and a wait until NaN never ends. Click would truncate the sentences.
    """
    for option in command.params:
        if isinstance(option.type, click.types.FloatParamType):
            option.callback = _finite
    if isinstance(command, click.Group):
        for below in command.commands.values():
            below.short_help = " ".join((below.help or "").partition("\n\n")[0].split())
            _prepare(below)


def _finite(context: click.Context, option: click.Parameter, value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise click.BadParameter(f"{value} is not a finite number", context, option)
    return value


class _Group(click.Group):
    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing them."""
        click.Group(commands=NAMES).format_commands(ctx, formatter)


@click.group(
    cls=_Group,
    commands=_OnUse(NAMES),
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    epilog="Example: phalanx up --host 0.0.0.0",
)
@click.version_option(__version__, prog_name="phalanx", message="%(prog)s %(version)s")
@click.option(
    "--log-level", type=click.Choice(LEVELS), default="warning", show_default=True, help="How much to log on stderr."
)
def phalanx(log_level: str) -> None:
    """Protect a robot swarm: from strangers, from stolen missions, and from compromised robots."""
    # Overwrite a status line.
    on_terminal = sys.stderr.isatty()
    logged = LOGGED if log_level != "warning" else TERSE if on_terminal else TIMED
    line = f"\r\x1b[2K{logged}" if on_terminal else logged
    for level in (logging.WARNING, logging.ERROR):
        logging.addLevelName(level, logging.getLevelName(level).lower())  # as _fail writes them
    logging.basicConfig(level=log_level.upper(), format=line, datefmt="%Y-%m-%dT%H:%M:%S%z", force=True)


def main() -> None:
    """Run the command line."""
    # Imported modules stay in use: collecting garbage among them takes a fifth of a command's start.
    gc.set_threshold(100_000)
    _mend_streams()
    sys.unraisablehook = _log_unraisable
    sys.exit(run_command(sys.argv[1:]))


def _mend_streams() -> None:
    # A stream that the parent process closed is None. A character that the encoding lacks would raise.
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), "w" if number else "r"))
        elif number and stream.errors == "strict":
            stream.reconfigure(errors="replace")


def _log_unraisable(args: sys.UnraisableHookArgs) -> None:
    # Objects interrupted by Ctrl-C, such as pyparsing's parsers, can raise in __del__: Python prints a traceback.
    traceback = (args.exc_type, args.exc_value, args.exc_traceback)
    logging.getLogger(__name__).debug("ignored in %r", args.object, exc_info=traceback)  # type: ignore[arg-type]


def run_command(arguments: list[str]) -> int:
    """Run `phalanx ARGUMENTS` and return the exit code."""
    try:
        result = phalanx.main(arguments, prog_name="phalanx", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        return 2
    except click.ClickException as error:
        return _fail(error.format_message().rstrip(".").replace("\n", " ").replace("\t", ""), _help_hint(error), 2)
    except PhalanxError as error:
        return _fail(str(error), getattr(error, "hint", ""), getattr(error, "exit_code", 1))
    except (KeyboardInterrupt, click.Abort):
        return 1
    except BrokenPipeError:
        # The reader of stdout has exited.
        _forget_output()
        return 1
    except OSError as error:
        if error.errno not in FULL:
            raise
        _forget_output()
        return _fail(f"cannot write: {error.strerror}", "", 1)
    return result if isinstance(result, int) else 0


def _forget_output() -> None:
    # The content of stdout's buffer would fail again at exit.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _help_hint(error: click.ClickException) -> str:
    if isinstance(error, click.NoSuchOption) and error.option_name in REMOVED:
        return REMOVED[error.option_name]
    context, option = getattr(error, "ctx", None), getattr(error, "param", None)
    near = ""
    if option and isinstance(option.type, click.Choice):
        given = str(error.message).partition("'")[2].partition("'")[0]  # click quotes it
        near = did_you_mean(given, map(str, option.type.choices))
    return f"{near}{context.command_path} --help" if context else "phalanx --help"


def _fail(message: str, hint: str, code: int) -> int:
    click.echo(f"phalanx: error: {message}", err=True)
    if hint:
        click.echo(f"phalanx: hint: {hint}", err=True)
    return code
