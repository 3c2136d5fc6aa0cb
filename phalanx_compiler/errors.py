"""Report code that the compiler does not accept: file, line, expression, and what to write instead."""

from __future__ import annotations

import ast


class SubsetError(Exception):
    """A kernel uses something outside the subset.

    Args:
        file: where the kernel is defined.
        line: line of the expression in that file.
        what: what is wrong.
        instead: what to write instead.
    """

    def __init__(self, file: str, line: int, what: str, instead: str) -> None:
        super().__init__(f"{file}:{line}: {what}\nhint: {instead}")
        self.file, self.line, self.what, self.instead = file, line, what, instead


def shown(node: ast.AST) -> str:
    """Return the source text of an expression, shortened to one line."""
    text = " ".join(ast.unparse(node).split())
    return text if len(text) <= 80 else text[:79] + "…"
