"""Refuse variables that may have no value where they are read: Python would raise, C would read what lies there."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable

from .parsing import Source

Names = frozenset[str]


class Assigned:
    """Follows the control flow of a kernel, with the names that have a value on each path; None: no path leads here."""

    def __init__(self, source: Source, local: set[str], always: Callable[[ast.For], bool]) -> None:
        self._source, self._local, self._always = source, local, always
        self._breaks: list[list[Names]] = []

    def check(self, parameters: Iterable[str]) -> None:
        """Raises: SubsetError: a variable may have no value."""
        self._block(self._source.tree.body, frozenset(parameters))

    def _block(self, body: list[ast.stmt], known: Names | None) -> Names | None:
        for statement in body:
            if known is None:
                return None
            known = self._statement(statement, known)
        return known

    def _statement(self, node: ast.stmt, known: Names) -> Names | None:
        if isinstance(node, ast.If):
            self._read(node.test, known)
            return _both(self._block(node.body, known), self._block(node.orelse, known))
        if isinstance(node, ast.While):
            self._read(node.test, known)
            endless = isinstance(node.test, ast.Constant) and bool(node.test.value)
            return self._loop(node.body, known, None if endless else known)
        if isinstance(node, ast.For):
            self._read(node.iter, known)
            inside = known | _stored(node.target)
            self._read(node.target, inside)
            return self._loop(node.body, inside, known, always=self._always(node))
        if isinstance(node, ast.Break):
            self._breaks[-1].append(known)
            return None
        self._read(node, known)
        if isinstance(node, (ast.Return, ast.Continue)):
            return None
        return known | _stored(node)

    def _loop(self, body: list[ast.stmt], inside: Names, after: Names | None, *, always: bool = False) -> Names | None:
        self._breaks.append([])
        end = self._block(body, inside)
        if always and not any(isinstance(each, ast.Continue) for statement in body for each in ast.walk(statement)):
            after = end
        for each in self._breaks.pop():
            after = _both(after, each)
        return after

    def _read(self, node: ast.AST, known: Names) -> None:
        for each in ast.walk(node):
            if isinstance(each, ast.AugAssign) and isinstance(each.target, ast.Name):
                self._name(each.target, each, known)
            if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Load):
                self._name(each, node if isinstance(node, ast.stmt) else each, known)

    def _name(self, name: ast.Name, shown: ast.AST, known: Names) -> None:
        if name.id in self._local and name.id not in known:
            instead = "assign it a value on each way that leads here"
            raise self._source.refuse(shown, f"{name.id} may have no value", instead)


def _both(one: Names | None, other: Names | None) -> Names | None:
    if one is None or other is None:
        return one if other is None else other
    return one & other


def _stored(node: ast.AST) -> Names:
    return frozenset(
        each.id for each in ast.walk(node) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)
    )
