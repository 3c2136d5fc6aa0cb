"""Give each expression of a kernel a type, from annotations, assignments and constants."""

from __future__ import annotations

import ast
from collections.abc import Callable
from typing import Any

import numpy as np

from . import intrinsics
from .constants import ABSENT, Constants
from .parsing import Source, source_of
from .value_types import (
    BOOL,
    F32,
    FLOAT,
    INT,
    NARROW,
    NONE,
    U32,
    U64,
    Array,
    Bundle,
    Record,
    Scalar,
    Tuple,
    ValueType,
    array_type,
    element,
    fields_of,
    is_bundle,
    joined,
    named,
    signature_of,
)

WORD_BITS = 64
# numpy's numbers: the operators that give the same in C.
OPERATED: dict[ValueType, tuple[type[ast.operator], ...]] = {
    U64: (ast.Add, ast.Sub, ast.Mult, ast.FloorDiv, ast.Mod, ast.BitAnd, ast.BitOr, ast.BitXor, ast.LShift, ast.RShift),
    U32: (ast.BitAnd, ast.BitOr, ast.BitXor),
    F32: (ast.Add, ast.Sub, ast.Mult, ast.Div),
}


def signature(function: Callable[..., Any]) -> tuple[dict[str, ValueType], ValueType]:
    """Return the types of a kernel's parameters, and of what it returns. Raises: SubsetError: one has none."""
    try:
        return signature_of(function)
    except TypeError as error:
        raise source_of(function).refuse_signature(error) from None


class TypedExpressions(Constants):
    """A kernel's expressions with their types.

    Raises: SubsetError: an expression has none.
    """

    def __init__(self, source: Source, parameters: dict[str, ValueType]) -> None:
        super().__init__(source, parameters)
        self.parameters = parameters
        self.variables: dict[str, ValueType] = dict(parameters)
        self.types: dict[ast.AST, ValueType] = {}
        self.constants: dict[ast.AST, Any] = {}

    def _refused(self, node: ast.AST) -> Any:
        raise self.source.refuse(
            node, f"{type(node).__name__} is not in the subset", "use what phalanx docs reference/kernels lists"
        )

    def type_of(self, node: ast.expr) -> ValueType:
        """Return the type of an expression."""
        value = self.constant(node)
        if value is not ABSENT:
            found = self.type_of_constant(node, value)
            self.constants[node] = value
        else:
            found = getattr(self, f"_x_{type(node).__name__.lower()}", self._refused)(node)
        self.types[node] = found
        return found

    def _variable(self, node: ast.Name) -> ValueType:
        if node.id not in self.variables:
            raise self.source.refuse(node, "a variable that has no value yet", "write an assignment before it")
        return self.variables[node.id]

    def _x_name(self, node: ast.Name) -> ValueType:
        return self._variable(node)

    def _x_tuple(self, node: ast.Tuple) -> ValueType:
        return Tuple(tuple(self.many(node.elts)))

    def many(self, nodes: list[ast.expr]) -> list[ValueType]:
        """Return the types of several expressions; a starred tuple gives those of its items."""
        found: list[ValueType] = []
        for node in nodes:
            if isinstance(node, ast.Starred):
                typ = self.type_of(node.value)
                if not isinstance(typ, Tuple):
                    raise self.source.refuse(node, f"* before {named(typ)}", "write * before a tuple")
                found += typ.items
            else:
                found.append(self.type_of(node))
                if found[-1] == NONE:
                    raise self.source.refuse(node, "no value", "use a number, or write the call on a line of its own")
        return found

    def _x_attribute(self, node: ast.Attribute) -> ValueType:
        typ = self.type_of(node.value)
        if isinstance(typ, Bundle) and node.attr in typ.places:
            return typ.places[node.attr][1]
        if isinstance(typ, Record) and node.attr in (typ.dtype.names or ()):
            return self._field(node, typ.dtype[node.attr])
        if isinstance(typ, Tuple) and node.attr in typ.fields:
            return typ.items[typ.fields.index(node.attr)]
        if isinstance(typ, Array) and node.attr in ("size", "shape"):
            return INT if node.attr == "size" else Tuple((INT,) * typ.axes)
        raise self.source.refuse(
            node, f"{named(typ)} has no {node.attr}", "use a field of a bundle, record or NamedTuple"
        )

    def _field(self, node: ast.AST, dtype: Any) -> ValueType:
        try:
            return array_type(dtype.subdtype[0], len(dtype.subdtype[1])) if dtype.subdtype else element(dtype)[1]
        except TypeError as error:
            raise self.source.refuse(
                node, f"a field: {error}", "use fields that are numbers or arrays of them"
            ) from None

    def _x_subscript(self, node: ast.Subscript) -> ValueType:
        typ = self.type_of(node.value)
        if isinstance(typ, Tuple):
            at = self.constant(node.slice)
            if isinstance(at, int) and -len(typ.items) <= at < len(typ.items):
                return typ.items[at]
            if at is not ABSENT or isinstance(node.slice, (ast.Slice, ast.Tuple)):
                raise self.source.refuse(node, f"no item of {named(typ)}", "use an index inside the tuple")
            self._count(node, node.slice)
            if len(set(typ.items)) == 1:
                return typ.items[0]
            raise self.source.refuse(
                node, f"a variable index into {named(typ)}", "use a constant as the index, or a tuple of one type"
            )
        if not isinstance(typ, Array):
            raise self.source.refuse(node, f"an index into {named(typ)}", "use an index into an array")
        return self._x_index(node, typ)

    def _x_index(self, node: ast.Subscript, typ: Array) -> ValueType:
        given = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if len(given) > typ.axes:
            raise self.source.refuse(node, f"{len(given)} indices into {named(typ)}", "give an index for each axis")
        slices = [each for each in given if isinstance(each, ast.Slice)]
        for k, each in enumerate(given):
            if isinstance(each, ast.Slice):
                # What lies behind a slice must be whole, or the result would not be in C order.
                behind = given[k + 1 :]
                if each.step is not None or not all(isinstance(x, ast.Slice) and _is_whole(x) for x in behind):
                    raise self.source.refuse(node, "a slice that leaves gaps", "write a loop")
                for end in (each.lower, each.upper):
                    if end is not None:
                        self._count(node, end)
            else:
                self._count(node, each)
        return self._indexed(typ, len(given) - len(slices))

    def _count(self, node: ast.AST, index: ast.expr) -> None:
        """Check an index, or what else has to be a whole number of any width."""
        if self.type_of(index) not in (INT, NARROW, U32):
            raise self.source.refuse(
                node, f"{named(self.types[index])} as an index", "use a whole number; int() converts"
            )

    def _indexed(self, typ: Array, indices: int) -> ValueType:
        if indices < typ.axes:
            return Array(typ.dtype, typ.axes - indices)
        return Record(typ.dtype) if typ.dtype.names is not None else element(typ.dtype)[1]

    def _x_binop(self, node: ast.BinOp) -> ValueType:
        return self.operated(node, node.op, self.type_of(node.left), self.type_of(node.right))

    def operated(
        self, node: ast.BinOp | ast.AugAssign, op: ast.operator, one: ValueType, other: ValueType
    ) -> ValueType:
        """Return the type of an operation on two numbers. Raises: SubsetError: there is none."""
        if isinstance(node, ast.AugAssign) and one == NARROW:
            one = INT  # what is stored is cut to its width, in Python too
        both = {one, other}
        if NARROW in both:
            raise self.source.refuse(
                node, f"{type(op).__name__} of {named(NARROW)}", "write int() of the element first"
            )
        if both & {U64, U32, F32}:
            return self._operated_as_numpy(node, op, one, other)
        whole = both <= {INT, BOOL}
        if isinstance(op, (ast.BitAnd, ast.BitOr, ast.BitXor)) and whole:
            return BOOL if both == {BOOL} else INT
        if isinstance(op, (ast.LShift, ast.RShift)) and whole:
            count = self.constant(node.right if isinstance(node, ast.BinOp) else node.value)
            if count is not ABSENT and not 0 <= count < WORD_BITS:
                raise self.source.refuse(node, f"a shift by {count}", "shift by 0 to 63")
            return INT
        if both == {BOOL}:
            raise self.source.refuse(node, f"{type(op).__name__} of two bool", "write int() of both")
        if isinstance(op, ast.Div) and both <= {INT, BOOL, FLOAT}:
            return FLOAT
        if isinstance(op, (ast.Add, ast.Sub, ast.Mult, ast.FloorDiv, ast.Mod)) and both <= {INT, BOOL, FLOAT}:
            return INT if whole else FLOAT
        raise self.source.refuse(
            node,
            f"{type(op).__name__} of {named(one)} and {named(other)}",
            "use numbers, one element at a time; ** takes constants only",
        )

    def _operated_as_numpy(
        self, node: ast.BinOp | ast.AugAssign, op: ast.operator, one: ValueType, other: ValueType
    ) -> ValueType:
        """Return the type of an operation on numpy's numbers: with each other, or with a constant."""
        typ, allowed = next((typ, allowed) for typ, allowed in OPERATED.items() if typ in (one, other))
        if not isinstance(op, allowed):
            raise self.source.refuse(
                node, f"{type(op).__name__} of {named(typ)}", "write int() or float() of both first"
            )
        sides = [node.left, node.right] if isinstance(node, ast.BinOp) else [node.target, node.value]
        for side, of in zip(sides, (one, other), strict=True):
            if of != typ and not self._is_weak(side, of, typ):
                raise self.source.refuse(
                    node, f"{one} and {other} together", f"write {typ}() of both, or int() or float() of both"
                )
        return typ

    def _is_weak(self, node: ast.expr, typ: ValueType, beside: ValueType) -> bool:
        """Return whether an expression is a constant of Python, which numpy converts to the type beside it."""
        value = self.constant(node)
        if type(value) is int and typ == INT:
            return beside == F32 or value >= 0
        return type(value) is float and beside == F32

    def _x_unaryop(self, node: ast.UnaryOp) -> ValueType:
        if isinstance(node.op, ast.Not):
            self._truth(node.operand)
            return BOOL
        typ = self.type_of(node.operand)
        if typ == INT or (typ in (FLOAT, F32) and isinstance(node.op, (ast.USub, ast.UAdd))):
            return typ
        if typ == U64 and isinstance(node.op, ast.Invert):
            return typ
        raise self.source.refuse(node, f"{type(node.op).__name__} of {named(typ)}", "use a number; int() converts")

    def _truth(self, node: ast.expr) -> None:
        """Check an expression of which only the truth counts."""
        if isinstance(node, ast.BoolOp):
            for each in node.values:
                self._truth(each)
            self.types[node] = BOOL
            return
        if not isinstance(self.type_of(node), Scalar) or self.types[node] == NONE:
            raise self.source.refuse(node, f"{named(self.types[node])} as a condition", "write a comparison")

    def _x_boolop(self, node: ast.BoolOp) -> ValueType:
        types = {self.type_of(each) for each in node.values}
        if types != {BOOL}:
            raise self.source.refuse(node, "and, or of values that are no bool", "write bool() of each, or an if")
        return BOOL

    def _x_compare(self, node: ast.Compare) -> ValueType:
        left, typ = node.left, self.type_of(node.left)
        for op, right in zip(node.ops, node.comparators, strict=True):
            beside = self.type_of(right)
            if isinstance(op, (ast.In, ast.NotIn)):
                if len(node.ops) > 1 or not isinstance(beside, Tuple):
                    raise self.source.refuse(node, "membership", "test membership in a tuple of numbers")
                for item in beside.items:
                    self._comparable(node, (left, typ), (None, item))
            else:
                self._comparable(node, (left, typ), (right, beside))
            left, typ = right, beside
        return BOOL

    def _comparable(
        self, node: ast.AST, one: tuple[ast.expr, ValueType], other: tuple[ast.expr | None, ValueType]
    ) -> None:
        both = {one[1], other[1]}
        if both in ({U64}, {F32}) or both <= {INT, NARROW, BOOL, U32} or both <= {INT, NARROW, BOOL, FLOAT}:
            return
        for beside in (U64, F32):
            if beside in both and any(x and self._is_weak(x, typ, beside) for x, typ in (one, other)):
                return
        raise self.source.refuse(node, f"{named(one[1])} beside {named(other[1])}", "compare numbers of one type")

    def _x_ifexp(self, node: ast.IfExp) -> ValueType:
        self._truth(node.test)
        typ = joined(self.type_of(node.body), self.type_of(node.orelse))
        if typ is None or typ == NONE:
            raise self.source.refuse(
                node, "no value, or two types in one expression", "make both of one type, or write an if"
            )
        return typ

    def _x_call(self, node: ast.Call) -> ValueType:
        function = self.constant(node.func)
        if any(isinstance(each, ast.Subscript) for each in ast.walk(node.func)) and callable(function):
            # What it writes to would not be known (writes.py).
            raise self.source.refuse(node, "a call of an item", "call the function by its name")
        if function is ABSENT or isinstance(getattr(function, "__self__", None), np.ndarray):
            return intrinsics.method_type(self, node)
        if getattr(function, "__kernel__", False):
            return self._call_of_kernel(node, function)
        if isinstance(function, type) and hasattr(function, "_fields"):
            if is_bundle(function):
                raise self.source.refuse(node, "a bundle that is made in a kernel", "take the bundle as an argument")
            types = self.many([*node.args, *(each.value for each in node.keywords)])
            try:
                wanted = Tuple(tuple(typ for _, typ in fields_of(function)), function)
            except TypeError as error:
                instead = "annotate its fields with int, float, bool, or a type of phalanx/arrays.py"
                raise self.source.refuse(node, str(error), instead) from None
            first = len(types) - len(node.keywords)
            if [each.arg for each in node.keywords] != list(wanted.fields[first : len(types)]):
                raise self.source.refuse(node, "arguments in another order", "keep the order of the fields")
            self._fits(node, Tuple(tuple(types)), Tuple(wanted.items), f"match the fields of {function.__name__}")
            return wanted
        return intrinsics.result_type(self, node, function)

    def _call_of_kernel(self, node: ast.Call, function: Callable[..., Any]) -> ValueType:
        parameters, returned = signature(function)
        given = self.many(node.args)
        names = list(parameters)
        if len(given) > len(names):
            raise self.source.refuse(node, f"{len(given)} arguments", f"give {len(names)}, as {function.__name__} has")
        pairs = list(zip(names, given, strict=False))
        for each in node.keywords:
            if each.arg not in names[len(given) :] or each.arg in [name for name, _ in pairs[len(given) :]]:
                raise self.source.refuse(
                    node, f"{each.arg or '**'} by name", f"use the names of {function.__name__}, once each"
                )
            pairs.append((each.arg, self.type_of(each.value)))
        defaults = dict(zip(names[::-1], (function.__defaults__ or ())[::-1], strict=False))
        for name in set(names) - {name for name, _ in pairs}:
            if name not in defaults:
                raise self.source.refuse(node, f"no {name}", f"give all arguments of {function.__name__}")
            pairs.append((name, self.type_of_constant(node, defaults[name])))
        for name, typ in pairs:
            self._fits(node, typ, parameters[name], f"match {name} of {function.__name__}")
        return returned

    # --- conversions ---

    def fills(self, node: ast.Call, typ: ValueType, made: Array) -> None:
        """Check the value that np.full puts into an array."""
        if made.dtype.names is not None:
            raise self.source.refuse(node, "records that are filled", "use np.zeros, and assign to the fields")
        self._fits(node, typ, element(made.dtype)[1], "store a number of the array's type", is_stored=True)

    def _fits(self, node: ast.AST, typ: ValueType, into: ValueType, instead: str, *, is_stored: bool = False) -> None:
        if typ == into or self._converts(typ, into) or (is_stored and self._is_storable(node, typ, into)):
            return
        raise self.source.refuse(
            node, f"{named(typ)} where {named(into)} belongs", f"{instead}; int() and float() convert"
        )

    def _converts(self, typ: ValueType, into: ValueType) -> bool:
        """Return whether a value stands for another type's as it is, in Python too."""
        if isinstance(typ, Tuple) and isinstance(into, Tuple) and len(typ.items) == len(into.items):
            pairs = zip(typ.items, into.items, strict=True)
            return (into.cls is None or into.cls is typ.cls) and all(a == b or self._converts(a, b) for a, b in pairs)
        return (typ == BOOL and into == INT) or (typ in (INT, BOOL) and into == FLOAT)

    def _is_storable(self, node: ast.AST, typ: ValueType, into: ValueType) -> bool:
        """Return whether an array's element or a record's field takes a number: numpy converts it."""
        if into == U64:
            value = self.constant(node.value) if isinstance(node, ast.Assign) else ABSENT
            return typ in (BOOL, NARROW, U32) or (typ == INT and isinstance(value, int) and value >= 0)
        numbers = (INT, NARROW, BOOL, U32, FLOAT, F32)
        return typ in numbers and into in numbers and not (into in (INT, NARROW, U32) and typ in (FLOAT, F32))


def _is_whole(node: ast.Slice) -> bool:
    return node.lower is None and node.upper is None
