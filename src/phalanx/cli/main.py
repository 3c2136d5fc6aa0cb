"""The command `phalanx`, and what every command has in common: exit codes, one line for an error, logging.

stdout is data, stderr is talk. 0 done, 1 refused or failed, 2 misused.
"""

from __future__ import annotations

import logging
import os
import sys

import click

from phalanx import __version__
from phalanx.errors import PhalanxError, Unavailable, UsageError

from .attack import attack
from .doctor import doctor
from .link import link
from .mission import mission
from .reproduce import reproduce
from .sim import sim
from .up import up

LEVELS = ("debug", "info", "warning", "error")


@click.group(
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    epilog="Example: phalanx up --host 0.0.0.0",
)
@click.version_option(__version__, prog_name="phalanx", message="%(prog)s %(version)s")
@click.option(
    "--log-level", type=click.Choice(LEVELS), default="warning", show_default=True, help="How much to tell on stderr."
)
def phalanx(log_level: str) -> None:
    """Keep a robot swarm in honest hands: who may command, what may be done, what is really done."""
    logging.basicConfig(level=log_level.upper(), format="phalanx: %(levelname)s: %(name)s: %(message)s", force=True)


for command in (up, link, mission, sim, attack, reproduce, doctor):
    phalanx.add_command(command)


def main() -> None:
    """Run the command line; the entry point that pip installs."""
    sys.exit(run_command(sys.argv[1:]))


def run_command(arguments: list[str]) -> int:
    """The exit code of `phalanx ARGUMENTS`."""
    try:
        result = phalanx.main(arguments, prog_name="phalanx", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        return 2
    except click.ClickException as error:
        return _fail(error.format_message().rstrip(".").replace("\n", " "), _help_hint(error), 2)
    except UsageError as error:
        return _fail(str(error), error.hint, 2)
    except Unavailable as error:
        return _fail(str(error), error.hint, 1)
    except PhalanxError as error:
        return _fail(str(error), "", 1)
    except (KeyboardInterrupt, click.Abort):
        return 1
    except BrokenPipeError:
        # Whoever read our output has gone: there is nobody left to tell.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return result if isinstance(result, int) else 0


def _help_hint(error: click.ClickException) -> str:
    context = getattr(error, "ctx", None)
    return f"{context.command_path} --help" if context else "phalanx --help"


def _fail(message: str, hint: str, code: int) -> int:
    click.echo(f"phalanx: error: {message}", err=True)
    if hint:
        click.echo(f"phalanx: hint: {hint}", err=True)
    return code
