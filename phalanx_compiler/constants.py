"""Constants of a kernel: names of its module, literals, and what operators make of both."""

from __future__ import annotations

import ast
import builtins
import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from .parsing import Source, uncompiled
from .value_types import BOOL, F32, FLOAT, INT, NARROW, NONE, U32, U64, Array, Tuple, ValueType, array_type

ABSENT = object()
FOLDED: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.LShift: operator.lshift,
    ast.RShift: operator.rshift,
    ast.BitAnd: operator.and_,
    ast.BitOr: operator.or_,
    ast.BitXor: operator.xor,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Invert: operator.invert,
}
# Shifts and powers of constants stay small, or the compiler would compute for hours.
MOST_BITS = 1024


class Constants:
    """Finds the expressions of a kernel that are known when it is compiled."""

    def __init__(self, source: Source, parameters: dict[str, ValueType]) -> None:
        self.source = source
        self.local = {n.id for n in ast.walk(source.tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        self.local |= set(parameters)

    def constant(self, node: ast.expr) -> Any:
        """Return the object that an expression means when the kernel is compiled, ABSENT if it means none."""
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Name):
            return self._named(node)
        if isinstance(node, ast.Attribute):
            whole = self.constant(node.value)
            return uncompiled(getattr(whole, node.attr, ABSENT)) if whole is not ABSENT else ABSENT
        if isinstance(node, ast.Subscript) and not isinstance(node.slice, ast.Slice):
            return self._item(node)
        if isinstance(node, (ast.BinOp, ast.UnaryOp)) and type(node.op) in FOLDED:
            return self._folded(node)
        return ABSENT

    def _named(self, node: ast.Name) -> Any:
        if node.id in self.local:
            return ABSENT
        if node.id in self.source.names:
            return uncompiled(self.source.names[node.id])
        if hasattr(builtins, node.id):
            return getattr(builtins, node.id)
        raise self.source.refuse(node, "an unknown name", "use a parameter, a variable, or a name of the module")

    def _item(self, node: ast.Subscript) -> Any:
        whole, at = self.constant(node.value), self.constant(node.slice)
        if not isinstance(whole, tuple) or not isinstance(at, int):
            return ABSENT
        if not -len(whole) <= at < len(whole):
            raise self.source.refuse(node, f"no item {at} of {len(whole)}", "use an index inside the tuple")
        return whole[at]

    def _folded(self, node: ast.BinOp | ast.UnaryOp) -> Any:
        given = [node.left, node.right] if isinstance(node, ast.BinOp) else [node.operand]
        values = [self.constant(each) for each in given]
        if not all(isinstance(each, (int, float)) and not isinstance(each, bool) for each in values):
            return ABSENT
        if isinstance(node.op, (ast.LShift, ast.Pow)) and not -MOST_BITS <= values[1] <= MOST_BITS:
            raise self.source.refuse(node, "a constant that cannot be computed", "use a number that fits 64 bits")
        try:
            value = FOLDED[type(node.op)](*values)
        except (ArithmeticError, TypeError, ValueError) as error:
            raise self.source.refuse(
                node, f"a constant that cannot be computed ({error})", "write another constant"
            ) from None
        if isinstance(value, complex):
            raise self.source.refuse(node, "a complex number", "use numbers, arrays, tuples or bundles")
        return value

    def type_of_constant(self, node: ast.AST, value: Any) -> ValueType:
        """Return the type of a constant. Raises: SubsetError: it has none."""
        if isinstance(value, (bool, np.bool_)):
            return BOOL
        if isinstance(value, (np.uint64, np.uint32)):
            return U64 if isinstance(value, np.uint64) else U32
        if isinstance(value, np.integer) and not isinstance(value, np.int64):
            return NARROW
        if isinstance(value, (int, np.integer)):
            if not -(1 << 63) <= value < 1 << 63:
                raise self.source.refuse(
                    node, "a number beyond 64 bits", "declare np.uint64() of it as a name of the module"
                )
            return INT
        if isinstance(value, (float, np.floating)):
            return F32 if isinstance(value, np.float32) else FLOAT
        if isinstance(value, tuple):
            cls = type(value) if hasattr(value, "_fields") else None
            return Tuple(tuple(self.type_of_constant(node, each) for each in value), cls)
        if isinstance(value, np.ndarray):
            return self._array(node, value)
        if value is None:
            return NONE
        raise self.source.refuse(
            node, f"a {type(value).__name__} is no value", "use numbers, arrays, tuples or bundles"
        )

    def _array(self, node: ast.AST, value: np.ndarray[Any, Any]) -> Array:
        try:
            return array_type(value.dtype, value.ndim)
        except TypeError as error:
            raise self.source.refuse(node, f"a constant: {error}", "use an array of numbers in C order") from None
