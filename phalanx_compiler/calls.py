"""Calls in C: of kernels, of the trusted nodes' C, of functions that the compiler knows; and arrays that are made."""

from __future__ import annotations

import ast
from collections.abc import Callable
from typing import Any

import numpy as np

from . import intrinsics
from .expressions import Expressions
from .value_types import INT, NONE, U32, Array, Record, Tuple, ValueType, element, fields_of, leaves, signature_of


class Calls(Expressions):
    """Writes a kernel's calls."""

    def _x_call(self, node: ast.Call) -> str:
        function = self.typed.constant(node.func)
        if isinstance(node.func, ast.Attribute) and node.func.value in self.typed.types:
            return self._method(node, node.func)
        if getattr(function, "__kernel__", False):
            return self._kernel(node, function)
        if isinstance(function, type) and hasattr(function, "_fields"):
            wanted = Tuple(tuple(typ for _, typ in fields_of(function)), function)
            given = self.many([*node.args, *(each.value for each in node.keywords)])
            pairs = zip(given, wanted.items, strict=True)
            return self.tuple_of(wanted, [self.convert(c, typ, into) for (c, typ), into in pairs])
        if any(function is each for each in intrinsics.MAKERS):
            return self._made(node, function)
        given = self.many(node.args)
        if hasattr(function, "__c_symbol__"):
            return self._in_c(function, given)
        known = intrinsics.found(function)
        assert known is not None
        text = known.c(self, node, given)
        if self.typed.types[node] == NONE:
            if text:
                self.emit(f"{text};")
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
                typ = self.typed.type_of_constant(node, defaults[name])
                arguments.append(self.convert(self.literal(defaults[name]), typ, into))
        if hasattr(function, "__linked__"):
            temp = self.temporary(returned)
            self.emit(f"{temp} = {self.unit.linked_call(function)}({', '.join([*arguments, str(self.site(node))])});")
            return temp
        if self.unit.marks_call(self.source.function, function):
            self.emit(f"caller = {self.site(node)};")
        call = f"{self.unit.function(function)}({', '.join(arguments)})"
        if returned == NONE:
            self.emit(f"{call};")
            return ""
        # What it returns may lie in scratch memory, which is then released with this kernel's.
        self.makes = self.makes or any(isinstance(each, (Array, Record)) for each in leaves(returned))
        temp = self.temporary(returned)
        self.emit(f"{temp} = {call};")
        return temp

    def _in_c(self, function: Any, given: list[tuple[str, ValueType]]) -> str:
        arguments = [
            f"{c}.p" if isinstance(typ, Array) else f"(uint32_t){self.convert(c, typ, INT)}" for c, typ in given
        ]
        c_types = ", ".join("void *" if isinstance(typ, Array) else "uint32_t" for _, typ in given)
        slot = self.unit.slot(function.__c_symbol__)
        temp = self.temporary(INT)
        pointer = f"(int32_t (*)({c_types}))linked[{slot}]"
        self.emit(f"{temp} = ({pointer})({', '.join(arguments)});")
        return temp

    # --- arrays that are made ---

    def made(self, typ: Array, lengths: list[str], node: ast.AST, *, zeroed: bool) -> str:
        """Write the making of an array in scratch memory."""
        self.makes = True
        temp, size, at = self.temporary(typ), self.temporary(INT), self.site(node)
        padded = [*lengths, *["1"] * (4 - len(lengths))]
        self.emit(f"{size} = scratch_size({', '.join(padded)}, {typ.dtype.itemsize}, {at});")
        self.emit(f"{temp} = ({self.unit.c_type(typ)}){{scratch({size}, {at}), {', '.join(lengths)}}};")
        if zeroed:
            self.emit(f"memset({temp}.p, 0, (size_t){size});")
        return temp

    def _made(self, node: ast.Call, function: Any) -> str:
        typ = self.typed.types[node]
        assert isinstance(typ, Array)
        if function in (np.empty_like, np.zeros_like):
            like = self.in_temporary(self.expr(node.args[0]), typ)
            lengths = [f"{like}.n{k}" for k in range(typ.axes)]
            return self.made(typ, lengths, node, zeroed=function is np.zeros_like)
        shape = intrinsics.shape_of(node)
        values = self.many([*shape, *([node.args[1]] if function is np.full else [])])
        lengths = [self.in_temporary(c, of) for c, of in values[: len(shape)]]
        temp = self.made(typ, lengths, node, zeroed=function is np.zeros)
        if function is np.full:
            self.fill(temp, typ, *values[-1])
        return temp

    def fill(self, array: str, typ: Array, c: str, of: ValueType) -> None:
        """Write one value into all elements of an array."""
        into, element_type = element(typ.dtype)
        value = self.in_temporary(self.convert(c, of, element_type), element_type)
        size = " * ".join(f"{array}.n{k}" for k in range(typ.axes))
        self.emit(f"for (int64_t z = 0, y = {size}; z < y; z++) (({into} *){array}.p)[z] = ({into}){value};")

    def _method(self, node: ast.Call, method: ast.Attribute) -> str:
        typ = self.typed.types[method.value]
        value = self.in_temporary(self.expr(method.value), typ)
        if method.attr == "view":
            return f"f32_of({value})" if typ == U32 else f"u32_of({value})"
        assert isinstance(typ, Array)
        lengths = [f"{value}.n{k}" for k in range(typ.axes)]
        temp = self.made(typ, lengths, node, zeroed=False)
        self.emit(f"memcpy({temp}.p, {value}.p, (size_t)({' * '.join(lengths)} * {typ.dtype.itemsize}));")
        return temp
