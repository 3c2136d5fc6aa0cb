"""Find what a kernel writes to: read-only arrays are refused there and only there, and no kernel changes a constant."""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from .parsing import Source, source_of, uncompiled

# Functions of phalanx/wire/fields.py that write to their first argument.
WRITERS = ("store_16", "store_32", "store_64", "move")
# Stands for all arrays of modules, beside the names of parameters.
CONSTANT = "<a constant>"
_under_way: list[Callable[..., Any]] = []


@dataclass(frozen=True, slots=True)
class Effects:
    """The parameters that a kernel writes to, with the first line that does, and those that it may return a part of."""

    writes: dict[str, int]
    returns: frozenset[str]


def writes_of(function: Callable[..., Any]) -> dict[str, int]:
    """Return the parameters that a kernel, or one that it calls, writes to, and the kernel's first line that does."""
    return effects_of(function).writes


@cache
def effects_of(function: Callable[..., Any]) -> Effects:
    """Return what a kernel, and those that it calls, write to.

    Raises: SubsetError: it writes to a constant, or calls itself.
    """
    if hasattr(function, "__linked__"):
        return Effects(dict.fromkeys(function.__linked__.writes, 0), frozenset())
    _under_way.append(function)
    try:
        return _Followed(source_of(function)).effects()
    finally:
        _under_way.pop()


class _Followed:
    """Follows the arrays of a kernel through its variables."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._nodes = [node for statement in source.tree.body for node in ast.walk(statement)]
        self._alias: dict[str, set[str]] = {each.arg: {each.arg} for each in source.tree.args.args}
        for node in self._nodes:
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                self._alias.setdefault(node.id, set())

    def effects(self) -> Effects:
        """Return what the kernel writes to."""
        before: dict[str, set[str]] = {}
        while before != self._alias:
            before = {name: set(roots) for name, roots in self._alias.items()}
            for node in self._nodes:
                if isinstance(node, ast.Assign):
                    for target in node.targets:
                        self._bind(target, self._roots(node.value))
                elif isinstance(node, ast.AnnAssign) and node.value is not None:
                    self._bind(node.target, self._roots(node.value))
                elif isinstance(node, ast.For):
                    self._bind(node.target, self._roots(node.iter))
        returns = self._of_all([n.value for n in self._nodes if isinstance(n, ast.Return) and n.value is not None])
        return Effects(self._writes(), frozenset(returns))

    def _writes(self) -> dict[str, int]:
        lines = dict[str, int]()
        for node in self._nodes:
            for name in self._written(node):
                if name == CONSTANT:
                    what = "a constant of the module is changed"
                    raise self._source.refuse(node, what, "write to a copy of it, or to an argument")
                line = getattr(node, "lineno", 0)
                lines[name] = min(line, lines.get(name, line))
        return lines

    def _bind(self, target: ast.expr, roots: set[str]) -> None:
        if isinstance(target, ast.Name):
            self._alias[target.id] |= roots
        elif isinstance(target, ast.Tuple):
            for each in target.elts:
                self._bind(each, roots)

    def _roots(self, node: ast.expr) -> set[str]:
        """Return the parameters that an expression may be part of; CONSTANT stands for arrays of modules."""
        if isinstance(node, ast.Name):
            return self._alias[node.id] if node.id in self._alias else _of_constant(self._object(node))
        if isinstance(node, ast.Attribute):
            return _of_constant(self._object(node)) or self._roots(node.value)
        if isinstance(node, (ast.Subscript, ast.Starred)):
            return self._roots(node.value)
        if isinstance(node, ast.IfExp):
            return self._roots(node.body) | self._roots(node.orelse)
        if isinstance(node, ast.Tuple):
            return self._of_all(node.elts)
        return self._of_call(node) if isinstance(node, ast.Call) else set()

    def _of_all(self, nodes: list[ast.expr]) -> set[str]:
        return set[str]().union(*map(self._roots, nodes))

    def _of_call(self, node: ast.Call) -> set[str]:
        called = self._object(node.func)
        if getattr(called, "__kernel__", False):
            return self._passed(node, called, self._of(node, called).returns)
        if isinstance(called, type) and hasattr(called, "_fields"):
            return self._of_all([*node.args, *(each.value for each in node.keywords)])
        return set()  # of all others, what is returned is new

    def _written(self, node: ast.AST) -> set[str]:
        if isinstance(node, (ast.Subscript, ast.Attribute)) and isinstance(node.ctx, ast.Store):
            return self._roots(node.value)
        if not isinstance(node, ast.Call):
            return set()
        called = self._object(node.func)
        if getattr(called, "__intrinsic__", "") in WRITERS:
            return self._roots(node.args[0])
        if getattr(called, "__kernel__", False):
            return self._passed(node, called, frozenset(self._of(node, called).writes))
        return self._of_all([node.args[n] for n in getattr(called, "__c_writes__", ())])

    def _of(self, node: ast.Call, called: Callable[..., Any]) -> Effects:
        if called in _under_way:
            raise self._source.refuse(node, f"{called.__name__} calls itself", "write a loop")
        return effects_of(called)

    def _passed(self, node: ast.Call, called: Callable[..., Any], names: frozenset[str]) -> set[str]:
        """Return what the call hands over as parameters of these names."""
        code = called.__code__
        parameters = code.co_varnames[: code.co_argcount]
        given = {each.arg: self._roots(each.value) for each in node.keywords}
        for n, each in enumerate(node.args):
            if isinstance(each, ast.Starred):  # how many items it has is not known here
                given |= dict.fromkeys(parameters[n:], self._of_all(node.args[n:]))
                break
            given[parameters[n] if n < len(parameters) else None] = self._roots(each)
        defaults = dict(zip(parameters[::-1], (called.__defaults__ or ())[::-1], strict=False))
        found: set[str] = {CONSTANT} & names
        for name in names - {CONSTANT}:
            found |= given[name] if name in given else _of_constant(defaults.get(name))
        return found

    def _object(self, node: ast.expr) -> Any:
        """Return the object that a name of the module means, None if it means none."""
        if isinstance(node, ast.Name):
            return None if node.id in self._alias else uncompiled(self._source.names.get(node.id))
        if isinstance(node, ast.Attribute):
            return uncompiled(getattr(self._object(node.value), node.attr, None))
        return None


def _of_constant(value: Any) -> set[str]:
    if isinstance(value, tuple):
        return set[str]().union(*map(_of_constant, value))
    return {CONSTANT} if isinstance(value, np.ndarray) else set()
