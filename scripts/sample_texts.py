"""Draw texts that people read, for readers who see the text and nothing else.

    PYTHONPATH=src:. python scripts/sample_texts.py [--seed 6] [--count 60] > tests/data/text_sample.csv

Equally many of each kind: paragraphs of documents, help of commands, messages in Python, texts of the pages. Each
reader explains each text. If fewer than 54 of 60 explanations are right, rewrite the others and draw a new sample.
"""

from __future__ import annotations

import argparse
import ast
import csv
import random
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import click
import lint_docs

from phalanx.cli.main import phalanx

ROOT = Path(__file__).parent.parent
LEAST_WORDS = 5
WORDS = re.compile(r"[A-Za-z][a-z']+")
# Strings and templates of TypeScript.
PAGE_TEXT = re.compile(r'"([^"\n]+)"|`([^`\n]+)`')
Texts = Iterator[tuple[str, str]]


def is_text(text: str) -> bool:
    """Return whether a string has enough words to be a sentence."""
    return len(WORDS.findall(text)) >= LEAST_WORDS and "_" not in re.sub("`[^`]*`|f_max|n_max|T_[a-z]+", "", text)


def documents() -> Texts:
    """Yield the paragraphs and list items of all documents but decision records; no fragments of sentences."""
    for page in lint_docs.pages():
        if page.parent.name != "adr":
            for line, text in lint_docs.paragraphs(lint_docs.prose(page.read_text())):
                if not text.startswith("#") and text.endswith((".", ":")) and not text[0].islower():
                    yield text, f"{page.relative_to(ROOT)}:{line}"


def helps(command: click.Command = phalanx, path: str = "phalanx") -> Texts:
    """Yield the help of all commands and options."""
    for paragraph in (command.help or "").split("\n\n"):
        yield " ".join(paragraph.split()), path
    for option in command.params:
        if isinstance(option, click.Option) and option.help:
            yield option.help, f"{path} {option.opts[-1]}"
    for name in getattr(command, "commands", {}):
        yield from helps(command.commands[name], f"{path} {name}")  # type: ignore[attr-defined]


def messages() -> Texts:
    """Yield the strings of errors, hints and log lines, with {} for each value."""
    for path in sorted((ROOT / "src" / "phalanx").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            is_error = isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)
            call = node.exc if is_error else node if isinstance(node, ast.Call) else None
            name = ast.unparse(call.func).rpartition(".")[2] if call else ""
            if call and (is_error or name in {"warning", "error", "info", "echo", "say"}):
                parts = [each for each in call.args if isinstance(each, ast.Constant | ast.JoinedStr)]
                text = "; hint: ".join(re.sub(r"\{[^}]*\}", "{}", said(each)) for each in parts if said(each))
                yield text, f"{path.relative_to(ROOT)}:{call.lineno}"


def said(node: ast.Constant | ast.JoinedStr) -> str:
    """Return a literal's text, with {} for each value in it."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    return "".join(str(each.value) if isinstance(each, ast.Constant) else "{}" for each in node.values)


def pages() -> Texts:
    """Yield the English texts of all pages, with {} for each value."""
    path = ROOT / "web" / "texts" / "en.ts"
    for number, line in enumerate(path.read_text().splitlines(), 1):
        for found in PAGE_TEXT.finditer(line):
            yield re.sub(r"\$\{[^}]*\}", "{}", found[1] or found[2]), f"{path.relative_to(ROOT)}:{number}"


KINDS: tuple[Callable[[], Texts], ...] = (documents, helps, messages, pages)


def main() -> None:
    """Print the sample as CSV; the last column is for the readers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=6)
    parser.add_argument("--count", type=int, default=60)
    options = parser.parse_args()
    chance = random.Random(options.seed)  # noqa: S311
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow(("text", "where", "explained"))
    for kind in KINDS:
        texts = sorted({text: (text, where) for text, where in kind() if is_text(text)}.values())
        out.writerows((*row, "") for row in chance.sample(texts, options.count // len(KINDS)))


if __name__ == "__main__":
    main()
