"""`phalanx docs` prints what messages refer to, from a clone and from an installed package."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from phalanx.cli.commands import docs as command
from phalanx.cli.main import run_command

ROOT = Path(__file__).parent.parent
SOURCES = sorted([*(ROOT / "src" / "phalanx").rglob("*.py"), *(ROOT / "phalanx_compiler").glob("*.py")])
NAMED = re.compile(r"phalanx docs ((?:adr|explanation|get-started|guides|reference|spec|examples)/[\w./-]*\w)")
IN_THE_REPOSITORY = re.compile(r"\b(?:docs|examples)/[\w-]+[/.]")
TEMPLATES = sorted((ROOT / "src" / "phalanx" / "cli" / "templates").glob("*.*"))


def is_command(node):
    return isinstance(node, ast.FunctionDef) and any("command" in ast.dump(each) for each in node.decorator_list)


@cache
def messages(path):
    """Return every string of a module that users may see: all but the docstrings of what is no command."""
    tree = ast.parse(path.read_text())
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        and isinstance(node.body[0], ast.Expr)
        and not is_command(node)
    }
    strings = (each for each in ast.walk(tree) if isinstance(each, ast.Constant) and isinstance(each.value, str))
    return [each.value for each in strings if id(each) not in docstrings]


@pytest.fixture(params=["clone", "wheel"])
def installed(request, tmp_path, monkeypatch):
    """Have `phalanx docs` read the clone, or what the build copies into the package."""
    if request.param == "wheel":
        monkeypatch.syspath_prepend(str(ROOT / "release"))
        monkeypatch.chdir(ROOT)
        from build_commands import copy_documents

        copy_documents(tmp_path / "documents")
        monkeypatch.setattr(command, "PACKAGE", tmp_path)


def test_each_document_that_a_message_names_is_printed(installed):
    texts = [*(text for path in SOURCES for text in messages(path)), *(path.read_text() for path in TEMPLATES)]
    named = {name for text in texts for name in NAMED.findall(text)}
    assert {"guides/robot", "guides/maps", "adr/0026", "reference/kernels"} <= named
    assert all(command.find(name).read_text().strip() for name in named)


def test_no_message_names_a_file_that_only_a_clone_has():
    allowed = {command.__file__}
    assert [
        (path.name, text)
        for path in SOURCES
        for text in messages(path)
        if IN_THE_REPOSITORY.search(text) and str(path) not in allowed and path.name != "table.py"
    ] == []


@pytest.mark.parametrize("name", ["guides/robot", "docs/guides/robot.md", "guides/robot.md#radio", "robot"])
def test_a_document_has_its_path_and_its_end_for_names(name, installed, capsys):
    assert run_command(["docs", name]) == 0
    assert capsys.readouterr().out.startswith("# One robot, one process")


def test_an_example_is_printed_as_it_is(installed, capsys):
    assert run_command(["docs", "examples/sweep.yaml"]) == 0
    assert capsys.readouterr().out == (ROOT / "examples" / "sweep.yaml").read_text()


def test_the_list_has_every_document_with_its_title(installed, capsys):
    assert run_command(["docs"]) == 0
    listed = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert {"promises", "spec/session", "examples/ten_lines.py", "deploy/phalanx.service"} <= listed.keys()
    assert listed["glossary"].endswith("Glossary")
    assert not [name for name in listed if name.endswith((".md", ".pyc", ".png", ".csv"))]


@pytest.mark.parametrize(
    ("name", "hint"),
    [("guides/robto", "did you mean guides/robot?"), ("adr", "phalanx docs lists")],
)
def test_a_document_that_is_not_there_is_named(name, hint, capsys):
    assert run_command(["docs", name]) == 2
    assert hint in capsys.readouterr().err


def test_front_matter_is_no_text(capsys):
    assert run_command(["docs", "guides/visitors"]) == 0
    assert capsys.readouterr().out.startswith("# Visitors")
