"""`phalanx new`: a controller, an attack or a scenario to begin with."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import click

from phalanx.errors import Unavailable, UsageError

TEMPLATES = Path(__file__).parents[1] / "templates"
ENDINGS = {"controller": ".py", "attack": ".py", "scenario": ".yaml"}
RUNS = {
    "controller": "phalanx sim run flock-12 --controller {}",
    "attack": "phalanx attack run {}",
    "scenario": "phalanx sim run {}",
}
NAME = re.compile(r"[a-z][a-z0-9_]*")


@click.command(epilog="Example: phalanx new controller my_flock")
@click.argument("kind", type=click.Choice(list(ENDINGS)))
@click.argument("name")
def new(kind: str, name: str) -> None:
    """Write a controller, an attack or a scenario that runs as it is.

    The file is NAME.py, or NAME.yaml for a scenario, in this folder; one that is there already stays as it is. NAME is
    of small letters, digits and _. The command that runs the file goes to stdout.
    """
    if not NAME.fullmatch(name):
        near = re.sub(r"[^a-z0-9_]+", "_", name.removesuffix(ENDINGS[kind]).lower()).strip("_0123456789")
        raise UsageError(f"{name!r} is no name", f"small letters, digits and _, as in {near or 'my_' + kind}")
    path = Path(name + ENDINGS[kind])
    # The file would be imported in the place of the module.
    if path.suffix == ".py" and not path.exists() and importlib.util.find_spec(name):
        raise UsageError(f"{name} is the name of a Python module", f"another one, as my_{name}")
    text = (TEMPLATES / kind).with_suffix(ENDINGS[kind]).read_text()
    text = text.replace("Template", "".join(map(str.capitalize, name.split("_")))).replace("template", name)
    try:
        with path.open("x") as file:
            file.write(text)
    except FileExistsError as error:
        raise UsageError(f"{path} is there already", "another name") from error
    except OSError as error:
        raise Unavailable(f"cannot write {path}: {error.strerror}") from error
    click.echo(RUNS[kind].format(path))
    click.echo(f"written: {path}", err=True)
