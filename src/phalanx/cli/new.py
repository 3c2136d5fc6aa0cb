"""`phalanx new`: write a file to begin with."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import click

from phalanx.errors import Unavailable, UsageError

TEMPLATES = Path(__file__).parent / "templates"
ENDINGS = {"controller": ".py", "attack": ".py", "scenario": ".yaml"}
RUNS = {
    "controller": "phalanx sim run flock-12 --controller {}",
    "attack": "phalanx attack run {}",
    "scenario": "phalanx sim run {}",
}
NAME = re.compile(r"[a-z][a-z0-9_]*")


def write(kind: str, name: str) -> int:
    """Write the file, and print the command that runs it.

    Raises: UsageError: no such name can be given. Unavailable: the file is there already, or cannot be written.
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
        raise Unavailable(f"{path} is there already", "another name") from error
    except OSError as error:
        raise Unavailable(f"cannot write {path}: {error.strerror}") from error
    click.echo(RUNS[kind].format(path))
    click.echo(f"written: {path}", err=True)
    return 0
