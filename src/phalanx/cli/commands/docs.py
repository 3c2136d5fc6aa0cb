"""`phalanx docs`: the documents and examples of the installed version."""

from __future__ import annotations

import re
from pathlib import Path

import click

from phalanx.errors import UsageError, did_you_mean

PACKAGE = Path(__file__).parents[2]
FOLDERS = ("docs", "examples", "deploy")
TITLE = re.compile(r'^(?:# |""")(.+?)(?:"""|$)', re.MULTILINE)


def root() -> Path:
    """Return the folder that contains FOLDERS: in the installed package (release/build_commands.py), or the clone."""
    installed = PACKAGE / "documents"
    return installed if installed.is_dir() else PACKAGE.parents[1]


def documents() -> dict[str, Path]:
    """Return all text files by name: docs/guides/robot.md as guides/robot, examples/sweep.yaml under its path."""
    found = {}
    for path in sorted(path for folder in FOLDERS for path in (root() / folder).rglob("*") if path.is_file()):
        name = str(path.relative_to(root()))
        if path.suffix == ".md" or (path.suffix != ".pyc" and not name.startswith("docs/")):
            found[name.removeprefix("docs/").removesuffix(".md")] = path
    return found


def find(name: str) -> Path:
    """Return the file for a name or path. The last part of a path, or an ADR number, suffices if it is unambiguous."""
    known = documents()
    wanted = name.partition("#")[0].removeprefix("docs/").removesuffix(".md")
    near = [each for each in known if each.endswith(f"/{wanted}") or each.startswith(f"{wanted}-")]
    if wanted not in known and len(near) != 1:
        raise UsageError(f"no document {name!r}", f"{did_you_mean(wanted, known)}phalanx docs lists all documents")
    return known[wanted if wanted in known else near[0]]


@click.command(epilog="Examples: phalanx docs guides/robot; phalanx docs examples/sweep.yaml > sweep.yaml")
@click.argument("name", required=False)
def docs(name: str | None) -> None:
    """Print a document or an example of this version, or list all of them."""
    if name:
        click.echo(re.sub(r"\A---\n.*?\n---\n+", "", find(name).read_text(encoding="utf-8"), flags=re.DOTALL), nl=False)
        return
    for each, path in documents().items():
        title = TITLE.search(path.read_text(encoding="utf-8"))
        click.echo(f"{each:<40} {title[1] if title else ''}".rstrip())
