"""Calls in C: of kernels, of the trusted nodes' C, of functions that the compiler knows; and arrays that are made."""

from __future__ import annotations

import ast
from collections.abc import Callable
from typing import Any

import numpy as np

from . import intrinsics
from .expressions import Expressions
from .kinds import INT, NONE, U32, Array, Kind, Record, Tuple, element, fields_of, leaves, signature_of


class Calls(Expressions):
    """Writes a kernel's calls."""

    def _x_call(self, node: ast.Call) -> str:
        function = self.typed.constant(node.func)
        if isinstance(node.func, ast.Attribute) and node.func.value in self.typed.kinds:
            return self._method(node, node.func)
        if getattr(function, "__kernel__", False):
            return self._kernel(node, function)
        if isinstance(function, type) and hasattr(function, "_fields"):
            wanted = Tuple(tuple(kind for _, kind in fields_of(function)), function)
            given = self.many([*node.args, *(each.value for each in node.keywords)])
            pairs = zip(given, wanted.items, strict=True)
            return self.tuple_of(wanted, [self.convert(c, kind, into) for (c, kind), into in pairs])
        if any(function is each for each in intrinsics.MAKERS):
            return self._made(node, function)
        given = self.many(node.args)
        if hasattr(function, "__c_symbol__"):
            return self._in_c(function, given)
        known = intrinsics.found(function)
        assert known is not None
        text = known.c(self, node, given)
        if self.typed.kinds[node] == NONE:
            if text:
                self.say(f"{text};")
            return ""
        return text

    def _kernel(self, node: ast.Call, function: Callable[..., Any]) -> str:
        """Write the call of another kernel as a statement of its own, in Python's order."""
        parameters, returned = signature_of(function)
        names = list(parameters)
        given = self.many([*node.args, *(each.value for each in node.keywords)])
        positional = len(given) - len(node.keywords)
        values = dict(zip(names, given[:positional], strict=False))
        values |= {str(each.arg): given[positional + k] for k, each in enumerate(node.keywords)}
        defaults = dict(zip(names[::-1], (function.__defaults__ or ())[::-1], strict=False))
        arguments = []
        for name, into in parameters.items():
            if name in values:
                arguments.append(self.convert(*values[name], into))
            else:
                kind = self.typed.kind_of_constant(node, defaults[name])
                arguments.append(self.convert(self.literal(defaults[name]), kind, into))
        if hasattr(function, "__linked__"):
            held = self.temporary(returned)
            self.say(f"{held} = {self.unit.linked_call(function)}({', '.join([*arguments, str(self.site(node))])});")
            return held
        if self.unit.marks_call(self.source.function, function):
            self.say(f"caller = {self.site(node)};")
        call = f"{self.unit.function(function)}({', '.join(arguments)})"
        if returned == NONE:
            self.say(f"{call};")
            return ""
        # What it returns may lie in scratch memory, which is then released with this kernel's.
        self.makes = self.makes or any(isinstance(each, (Array, Record)) for each in leaves(returned))
        held = self.temporary(returned)
        self.say(f"{held} = {call};")
        return held

    def _in_c(self, function: Any, given: list[tuple[str, Kind]]) -> str:
        arguments = [
            f"{c}.p" if isinstance(kind, Array) else f"(uint32_t){self.convert(c, kind, INT)}" for c, kind in given
        ]
        types = ", ".join("void *" if isinstance(kind, Array) else "uint32_t" for _, kind in given)
        slot = self.unit.slot(function.__c_symbol__)
        held = self.temporary(INT)
        pointer = f"(int32_t (*)({types}))linked[{slot}]"
        self.say(f"{held} = ({pointer})({', '.join(arguments)});")
        return held

    # --- arrays that are made ---

    def made(self, kind: Array, lengths: list[str], node: ast.AST, *, zeroed: bool) -> str:
        """Write the making of an array in scratch memory."""
        self.makes = True
        held, size, at = self.temporary(kind), self.temporary(INT), self.site(node)
        padded = [*lengths, *["1"] * (4 - len(lengths))]
        self.say(f"{size} = scratch_size({', '.join(padded)}, {kind.dtype.itemsize}, {at});")
        self.say(f"{held} = ({self.unit.c_type(kind)}){{scratch({size}, {at}), {', '.join(lengths)}}};")
        if zeroed:
            self.say(f"memset({held}.p, 0, (size_t){size});")
        return held

    def _made(self, node: ast.Call, function: Any) -> str:
        kind = self.typed.kinds[node]
        assert isinstance(kind, Array)
        if function in (np.empty_like, np.zeros_like):
            like = self.hold(self.expr(node.args[0]), kind)
            lengths = [f"{like}.n{k}" for k in range(kind.axes)]
            return self.made(kind, lengths, node, zeroed=function is np.zeros_like)
        shape = intrinsics.shape_of(node)
        values = self.many([*shape, *([node.args[1]] if function is np.full else [])])
        lengths = [self.hold(c, of) for c, of in values[: len(shape)]]
        held = self.made(kind, lengths, node, zeroed=function is np.zeros)
        if function is np.full:
            self.fill(held, kind, *values[-1])
        return held

    def fill(self, array: str, kind: Array, c: str, of: Kind) -> None:
        """Write one value into all elements of an array."""
        into, element_kind = element(kind.dtype)
        value = self.hold(self.convert(c, of, element_kind), element_kind)
        size = " * ".join(f"{array}.n{k}" for k in range(kind.axes))
        self.say(f"for (int64_t z = 0, y = {size}; z < y; z++) (({into} *){array}.p)[z] = ({into}){value};")

    def _method(self, node: ast.Call, method: ast.Attribute) -> str:
        kind = self.typed.kinds[method.value]
        value = self.hold(self.expr(method.value), kind)
        if method.attr == "view":
            return f"f32_of({value})" if kind == U32 else f"u32_of({value})"
        assert isinstance(kind, Array)
        lengths = [f"{value}.n{k}" for k in range(kind.axes)]
        held = self.made(kind, lengths, node, zeroed=False)
        self.say(f"memcpy({held}.p, {value}.p, (size_t)({' * '.join(lengths)} * {kind.dtype.itemsize}));")
        return held
