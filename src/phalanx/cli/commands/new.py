"""`phalanx new`: write a template of a controller, an attack or a scenario."""

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
    """Write a working controller, attack or scenario to start from.

    The file is NAME.py, or NAME.yaml for a scenario, in the current folder; existing files are not overwritten. NAME
    consists of lower-case letters, digits and _. The command that runs the file is printed to stdout.
    """
    if not NAME.fullmatch(name):
        near = re.sub(r"[^a-z0-9_]+", "_", name.removesuffix(ENDINGS[kind]).lower()).strip("_0123456789")
        raise UsageError(f"invalid name {name!r}", f"use lower-case letters, digits and _: {near or 'my_' + kind}")
    path = Path(name + ENDINGS[kind])
    # The file would shadow the module.
    if path.suffix == ".py" and not path.exists() and importlib.util.find_spec(name):
        raise UsageError(f"{name} is the name of a Python module", f"use another name, such as my_{name}")
    text = (TEMPLATES / kind).with_suffix(ENDINGS[kind]).read_text()
    text = text.replace("Template", "".join(map(str.capitalize, name.split("_")))).replace("template", name)
    try:
        with path.open("x") as file:
            file.write(text)
    except FileExistsError as error:
        raise UsageError(f"{path} exists", "use another name") from error
    except OSError as error:
        raise Unavailable(f"cannot write {path}: {error.strerror}") from error
    click.echo(RUNS[kind].format(path))
    click.echo(f"written: {path}", err=True)
