"""Give a kernel's variables types: of parameters by their annotations, of others by what is assigned to them."""

from __future__ import annotations

import ast

from .assigned import Assigned
from .constants import ABSENT
from .parsing import Source
from .typed_expressions import TypedExpressions, signature
from .value_types import (
    INT,
    NONE,
    Array,
    Record,
    Tuple,
    ValueType,
    element,
    joined,
    named,
)


class Typed(TypedExpressions):
    """A kernel whose statements and expressions have types.

    Raises: SubsetError: one has none.
    """

    def __init__(self, source: Source) -> None:
        parameters, self.returned = signature(source.function)
        super().__init__(source, parameters)
        # A variable that a loop changes may only then be seen to be a float.
        while True:
            before = dict(self.variables)
            self._block(source.tree.body)
            if before == self.variables:
                break
        Assigned(source, self.local, self._runs).check(self.parameters)

    def _runs(self, node: ast.For) -> bool:
        """Return whether a loop runs at least once, whatever the arguments are."""
        if not isinstance(node.iter, ast.Call) or self.constant(node.iter.func) is not range:
            typ = self.types[node.iter]
            return isinstance(typ, Tuple) and bool(typ.items)
        ends = [self.constant(each) for each in node.iter.args]
        return ABSENT not in ends and len(range(*ends)) > 0

    # --- statements ---

    def _block(self, body: list[ast.stmt]) -> None:
        for statement in body:
            getattr(self, f"_{type(statement).__name__.lower()}", self._refused)(statement)

    def _expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):  # a docstring
            self.type_of(node.value)

    def _pass(self, node: ast.Pass) -> None: ...

    def _break(self, node: ast.Break) -> None: ...

    def _continue(self, node: ast.Continue) -> None: ...

    def _return(self, node: ast.Return) -> None:
        typ = self.type_of(node.value) if node.value else NONE
        self._fits(node, typ, self.returned, "match the annotation of the result")

    def _assign(self, node: ast.Assign) -> None:
        typ = self.type_of(node.value)
        for target in node.targets:
            self._store(target, typ, node)

    def _annassign(self, node: ast.AnnAssign) -> None:
        if node.value is None:
            raise self.source.refuse(node, "a variable without a value", "assign a value")
        self._store(node.target, self.type_of(node.value), node)

    def _augassign(self, node: ast.AugAssign) -> None:
        typ = self.operated(node, node.op, self._loaded(node.target), self.type_of(node.value))
        self._store(node.target, typ, node)

    def _loaded(self, target: ast.expr) -> ValueType:
        if isinstance(target, ast.Name):
            return self._variable(target)
        return self.type_of(target)

    def _if(self, node: ast.If) -> None:
        self._truth(node.test)
        self._block(node.body)
        self._block(node.orelse)

    def _while(self, node: ast.While) -> None:
        self._truth(node.test)
        self._block(node.body)

    def _for(self, node: ast.For) -> None:
        self._store(node.target, self.each(node.iter), node)
        self._block(node.body)

    def each(self, iterated: ast.expr) -> ValueType:
        """Return the type of what a loop goes through."""
        if isinstance(iterated, ast.Call) and self.constant(iterated.func) is range:
            if iterated.keywords or not 1 <= len(iterated.args) <= 3:
                raise self.source.refuse(
                    iterated, f"{len(iterated.args)} arguments of range", "give range() one to three numbers"
                )
            for argument in iterated.args:
                self._count(argument, argument)
            if len(iterated.args) == 3 and self.constant(iterated.args[2]) == 0:
                raise self.source.refuse(iterated, "a step of 0", "use another step")
            return INT
        typ = self.type_of(iterated)
        if isinstance(typ, Array):
            return self._indexed(typ, 1)
        if isinstance(typ, Tuple) and typ.items:
            each: ValueType | None = typ.items[0]
            for item in typ.items:
                each = joined(each, item)
            if each is not None:
                return each
        raise self.source.refuse(
            iterated, f"a loop over {named(typ)}", "loop over range(), an array, or a tuple of one type"
        )

    # --- what is assigned ---

    def _store(self, target: ast.expr, typ: ValueType, node: ast.AST) -> None:
        if isinstance(target, ast.Name):
            self._store_name(target.id, typ, node)
        elif isinstance(target, ast.Tuple):
            if not isinstance(typ, Tuple) or len(typ.items) != len(target.elts):
                raise self.source.refuse(
                    node, f"{named(typ)} for {len(target.elts)} names", "assign a tuple of that length"
                )
            for each, item in zip(target.elts, typ.items, strict=True):
                self._store(each, item, node)
        elif isinstance(target, (ast.Attribute, ast.Subscript)):
            self._store_part(target, typ, node)
        else:
            self._refused(target)

    def _store_name(self, name: str, typ: ValueType, node: ast.AST) -> None:
        if name == "_" and name not in self.parameters:
            return  # whatever it is: it cannot be read
        if typ == NONE:
            raise self.source.refuse(node, "a variable that is None", "use a number that says so")
        now = joined(self.variables.get(name), typ)
        if now is None or (name in self.parameters and now != self.parameters[name]):
            was = self.variables[name]
            raise self.source.refuse(node, f"{name} is {named(was)} and becomes {named(typ)}", "use another variable")
        self.variables[name] = now

    def _store_part(self, target: ast.Attribute | ast.Subscript, typ: ValueType, node: ast.AST) -> None:
        whole = self.type_of(target.value)
        if not isinstance(whole, Record if isinstance(target, ast.Attribute) else Array):
            instead = (
                "make a new tuple, or use an array"
                if isinstance(whole, Tuple)
                else "assign to an element, or a record's field"
            )
            raise self.source.refuse(node, f"an assignment to a part of {named(whole)}", instead)
        into = self.type_of(target)
        if isinstance(into, Array):
            if isinstance(typ, Array) and typ.dtype == into.dtype and typ.axes == into.axes:
                return
            if isinstance(target, ast.Subscript) and into.dtype.names is None:
                into = element(into.dtype)[1]
        elif isinstance(into, Record) and typ == into:
            return
        self._fits(node, typ, into, "store a number of the array's type, or an array like it", is_stored=True)
