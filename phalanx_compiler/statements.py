"""Statements of a typed kernel in C, and the whole function."""

from __future__ import annotations

import ast
from collections.abc import Callable
from typing import Any

from .calls import Calls
from .needed import Needed
from .typed import Typed
from .value_types import BOOL, INT, NARROW, NONE, U64, Array, Record, Scalar, Tuple, ValueType, element, leaves, named


class Statements(Calls):
    """Writes a kernel's statements; `text` is the function."""

    def __init__(self, typed: Typed, unit: Needed) -> None:
        super().__init__(typed, unit)
        self._block(typed.source.tree.body)
        self.text = self._function()

    def _block(self, body: list[ast.stmt]) -> None:
        for statement in body:
            getattr(self, f"_{type(statement).__name__.lower()}")(statement)

    def _within(self, write: Callable[[], None]) -> None:
        self.depth += 1
        write()
        self.depth -= 1

    def _expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            c = self.expr(node.value)
            if c and not c.isidentifier():
                self.emit(f"(void)({c});")

    def _pass(self, node: ast.Pass) -> None: ...

    def _break(self, _: ast.Break) -> None:
        self.emit("break;")

    def _continue(self, _: ast.Continue) -> None:
        self.emit("continue;")

    def _return(self, node: ast.Return) -> None:
        returned = self.typed.returned
        if returned == NONE:
            if node.value is not None and node.value not in self.typed.constants:
                self.expr(node.value)
            self.emit("goto end;")
            return
        assert node.value is not None
        self.emit(f"returned = {self.as_type(node.value, returned)};")
        self.emit("goto end;")

    # --- assignments ---

    def _assign(self, node: ast.Assign) -> None:
        typ = self.typed.types[node.value]
        target = node.targets[0]
        if len(node.targets) == 1 and isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            values = [(self._copied(c, of), of) for c, of in self.many(node.value.elts)]
            for each, (c, of) in zip(target.elts, values, strict=True):
                self._store(each, c, of)
            return
        c = self.expr(node.value)
        if len(node.targets) > 1:
            c = self.in_temporary(c, typ)
        for target in node.targets:
            self._store(target, c, typ)

    def _copied(self, c: str, typ: ValueType) -> str:
        """Write a value that assignments to variables do not change any more."""
        if c.startswith(("INT64_C", "(-INT64_C", "(0x", "(-0x")) or (c.startswith("t") and c.isidentifier()):
            return c
        temp = self.temporary(typ)
        self.emit(f"{temp} = {c};")
        return temp

    def _annassign(self, node: ast.AnnAssign) -> None:
        assert node.value is not None
        self._store(node.target, self.expr(node.value), self.typed.types[node.value])

    def _augassign(self, node: ast.AugAssign) -> None:
        if isinstance(node.target, ast.Name):
            one = f"v_{node.target.id}", self.typed.variables[node.target.id]
            place = one[0]
        else:
            place = self._lvalue(node.target)
            one = self.read(place, node.target), self.typed.types[node.target]
        value, late = self.deferred(lambda: self.expr(node.value), deeper=False)
        if late and not isinstance(node.target, ast.Name):  # Python reads the old value first
            one = self.in_temporary(*one), one[1]
        self.lines += late
        other = value, self.typed.types[node.value]
        into = self.typed.operated(node, node.op, one[1], other[1])
        self.emit(f"{place} = {self.convert(self.operated(node, node.op, one, other, into), into, one[1])};")

    def _lvalue(self, target: ast.expr) -> str:
        """Write what is assigned to, with its address computed once."""
        assert isinstance(target, (ast.Attribute, ast.Subscript))
        whole = self.typed.types[target.value]
        assert isinstance(whole, (Array, Record))
        dtype = whole.dtype[target.attr] if isinstance(target, ast.Attribute) else whole.dtype
        pointer = self.temporary(INT)
        self.emit(f"{pointer} = (intptr_t)&{self.place(target)};")
        return f"(*({element(dtype)[0]} *){pointer})"

    def _store(self, target: ast.expr, c: str, typ: ValueType) -> None:
        if isinstance(target, ast.Name) and target.id not in self.typed.variables:  # it is `_`
            if c and not c.isidentifier():
                self.emit(f"(void)({c});")
            return
        if isinstance(target, ast.Name):
            self.emit(f"v_{target.id} = {self.convert(c, typ, self.typed.variables[target.id])};")
            return
        if isinstance(target, ast.Tuple):
            assert isinstance(typ, Tuple)
            temp = self.in_temporary(c, typ)
            for k, each in enumerate(target.elts):
                self._store(each, self.item(temp, typ, k), typ.items[k])
            return
        into = self.typed.types[target]
        if not isinstance(into, Scalar):
            self._store_many(target, c, typ, into)
            return
        temp = c if not self._may_change(c) or isinstance(typ, Scalar) else self.in_temporary(c, typ)
        before = len(self.lines)
        place = self.place(target)
        if len(self.lines) > before and self._may_change(temp):
            late, self.lines = self.lines[before:], self.lines[:before]
            temp = self.in_temporary(temp, typ)
            self.lines += late
        self.emit(f"{place} = {self.convert(temp, typ, into)};")

    def _store_many(self, target: ast.expr, c: str, typ: ValueType, into: ValueType) -> None:
        """Write the assignment to a record, a row, or a slice."""
        value = self.in_temporary(c, typ)
        place = self.in_temporary(self.place(target), into)
        if isinstance(into, Record):
            self.emit(f"memmove({place}, {value}, {into.dtype.itemsize});")
        elif isinstance(typ, Array):
            assert isinstance(into, Array)
            for k in range(into.axes):
                self.emit(f"alike({place}.n{k}, {value}.n{k}, {self.site(target)});")
            size = " * ".join(f"{place}.n{k}" for k in range(into.axes))
            self.emit(f"memmove({place}.p, {value}.p, (size_t)({size} * {into.dtype.itemsize}));")
        else:
            assert isinstance(into, Array)
            self.fill(place, into, value, typ)

    # --- control ---

    def _if(self, node: ast.If) -> None:
        self.emit(f"if ({self.truth(node.test)}) {{")
        self._within(lambda: self._block(node.body))
        if node.orelse:
            self.emit("} else {")
            self._within(lambda: self._block(node.orelse))
        self.emit("}")

    def _while(self, node: ast.While) -> None:
        self.emit("for (;;) {")
        self._within(lambda: self.emit(f"if (!{self.truth(node.test)}) break;"))
        self._within(lambda: self._block(node.body))
        self.emit("}")

    def _for(self, node: ast.For) -> None:
        iterated = node.iter
        if isinstance(iterated, ast.Call) and self.typed.constant(iterated.func) is range:
            self._for_range(node, iterated)
            return
        typ = self.typed.types[iterated]
        each = self.typed.each(iterated)
        temp = self._copied(self.expr(iterated), typ)
        k = self.temporary(INT)
        if isinstance(typ, Array):
            self.emit(f"for ({k} = 0; {k} < {temp}.n0; {k}++) {{")
            value = self.index(temp, typ, [k], node)
            value = f"({value} != 0)" if each == BOOL else f"((int64_t){value})" if each in (INT, NARROW) else value
        else:
            assert isinstance(typ, Tuple)
            if len(set(typ.items)) > 1:
                into = Tuple((each,) * len(typ.items))
                temp = self.in_temporary(self.convert(temp, typ, into), into)
            self.emit(f"for ({k} = 0; {k} < {len(typ.items)}; {k}++) {{")
            value = f"{temp}.f[{k}]"
        self._within(lambda: self._store(node.target, value, each))
        self._within(lambda: self._block(node.body))
        self.emit("}")

    def _for_range(self, node: ast.For, iterated: ast.Call) -> None:
        given = [self._copied(self.convert(c, typ, INT), INT) for c, typ in self.many(iterated.args)]
        low, high = ("0", given[0]) if len(given) == 1 else given[:2]
        k = self.temporary(INT)
        known = self.typed.constant(iterated.args[2]) if len(given) == 3 else 1
        if known in (1, -1):
            self.emit(f"for ({k} = {low}; {k} {'<' if known == 1 else '>'} {high}; {k} += {known}) {{")
        else:  # counted, as the last step may lead beyond 64 bits
            left, step = self.temporary(U64), given[2]
            count = f"steps({low}, {high}, divisor({step}, {self.site(node)}))"
            self.emit(f"for ({k} = {low}, {left} = {count}; {left} > 0; {left}--, {k} += {step}) {{")
        self._within(lambda: self._store(node.target, k, INT))
        self._within(lambda: self._block(node.body))
        self.emit("}")

    # --- the function ---

    def _function(self) -> str:
        typed, unit = self.typed, self.unit
        returned = typed.returned
        name = unit.function(typed.source.function)
        parameters = ", ".join(f"{unit.c_type(typ)} v_{each}" for each, typ in typed.parameters.items()) or "void"
        own = {f"v_{each}": typ for each, typ in typed.variables.items() if each not in typed.parameters}
        lines = [f"    {unit.c_type(typ)} {each};" for each, typ in (own | self.temporaries).items()]
        frees = self.makes and not any(isinstance(each, (Array, Record)) for each in leaves(returned))
        if returned != NONE:
            lines.append(f"    {unit.c_type(returned)} returned;")
        if frees:
            lines.append("    struct mark before = top->scratch;")
        body = list(self.lines)
        if returned != NONE and not _always_returns(typed.source.tree.body):
            body.append(f"    violate({self.site(typed.source.tree)}, BAD_END, 0, 0);")
        jumps = any("goto end;" in line for line in body)
        if body and body[-1] == "    goto end;":
            body.pop()
            jumps = any("goto end;" in line for line in body)
        end = ["end:;"] if jumps else []
        if frees:
            end.append("    release(&top->scratch, &before);")
        if returned != NONE:
            end.append("    return returned;")
        if hasattr(typed.source.function, "__rejected__"):
            if returned != INT:
                raise typed.source.refuse(
                    typed.source.tree.args, f"reads_peer, and it returns {named(returned)}", "declare it with -> int"
                )
            name += "_unguarded"
        head = f"static {unit.c_type(returned)} {name}({parameters})"
        return "\n".join([head, "{", *lines, *body, *end, "}", ""])


def _always_returns(body: list[ast.stmt]) -> bool:
    last = body[-1]
    if isinstance(last, ast.If):
        return bool(last.orelse) and _always_returns(last.body) and _always_returns(last.orelse)
    if isinstance(last, ast.While):
        endless = isinstance(last.test, ast.Constant) and bool(last.test.value)
        return endless and not any(isinstance(node, ast.Break) for node in ast.walk(last))
    return isinstance(last, ast.Return)


def written(function: Callable[..., Any], typed: Typed, unit: Needed) -> str:
    """Return a kernel's C."""
    assert typed.source.function is function
    return Statements(typed, unit).text
