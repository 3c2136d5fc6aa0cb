"""Draw names with the first lines of their docstrings, for readers who see the single file and nothing else.

    python scripts/sample_names.py [--seed 45] [--count 60] > tests/data/name_sample.csv

Each reader explains what each name does. If fewer than 54 of 60 explanations are right, rename the others and draw a
new sample.
"""

from __future__ import annotations

import argparse
import ast
import csv
import random
import sys
from collections.abc import Iterator
from pathlib import Path

SOURCE = Path(__file__).parent.parent / "src" / "phalanx"


def documented() -> Iterator[tuple[str, str, str]]:
    """Yield file, name and docstring's first line of every documented function and class."""
    for path in sorted(SOURCE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) and (
                doc := ast.get_docstring(node)
            ):
                yield str(path.relative_to(SOURCE.parent)), node.name, doc.splitlines()[0]


def main() -> None:
    """Print the sample as CSV; the last two columns are for the explanation and its judgement."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=45)
    parser.add_argument("--count", type=int, default=60)
    said = parser.parse_args()
    drawn = random.Random(said.seed).sample(list(documented()), said.count)  # noqa: S311
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow(("file", "name", "docstring", "reader", "right"))
    out.writerows((*row, "", "") for row in sorted(drawn))


if __name__ == "__main__":
    main()
