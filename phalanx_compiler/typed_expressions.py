"""Give each expression of a kernel a kind: names mean what annotations and assignments say, constants what they are."""

from __future__ import annotations

import ast
from collections.abc import Callable
from typing import Any

import numpy as np

from . import intrinsics
from .constants import ABSENT, Constants
from .kinds import (
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
    Kind,
    Record,
    Scalar,
    Tuple,
    array_kind,
    element,
    fields_of,
    is_bundle,
    named,
    signature_of,
)
from .parsing import Source, source_of

WORD_BITS = 64
# numpy's numbers: the operators that give the same in C.
OPERATED: dict[Kind, tuple[type[ast.operator], ...]] = {
    U64: (ast.Add, ast.Sub, ast.Mult, ast.FloorDiv, ast.Mod, ast.BitAnd, ast.BitOr, ast.BitXor, ast.LShift, ast.RShift),
    U32: (ast.BitAnd, ast.BitOr, ast.BitXor),
    F32: (ast.Add, ast.Sub, ast.Mult, ast.Div),
}


def joined(one: Kind | None, other: Kind | None) -> Kind | None:
    """Return the kind that holds values of both, None if there is none; None joins with everything."""
    if one == other or other is None:
        return one
    if one is None:
        return other
    if {one, other} <= {INT, BOOL, FLOAT}:
        return FLOAT if FLOAT in (one, other) else INT
    if isinstance(one, Tuple) and isinstance(other, Tuple) and len(one.items) == len(other.items):
        items = [joined(a, b) for a, b in zip(one.items, other.items, strict=True)]
        if one.cls is other.cls:
            return Tuple(tuple(items), one.cls) if None not in items else None  # type: ignore[arg-type]
    return None


def compared(one: Kind, other: Kind) -> Kind:
    """Return the kind in which two numbers are compared."""
    both = {one, other}
    for kind in (U64, F32, FLOAT):
        if kind in both:
            return kind
    return BOOL if both == {BOOL} else INT


def signature(function: Callable[..., Any]) -> tuple[dict[str, Kind], Kind]:
    """Return the kinds of a kernel's parameters, and of what it returns. Raises: SubsetError: one has none."""
    try:
        return signature_of(function)
    except TypeError as error:
        raise source_of(function).refuse_signature(error) from None


class TypedExpressions(Constants):
    """A kernel's expressions with their kinds.

    Raises: SubsetError: an expression has none.
    """

    def __init__(self, source: Source, parameters: dict[str, Kind]) -> None:
        super().__init__(source, parameters)
        self.parameters = parameters
        self.variables: dict[str, Kind] = dict(parameters)
        self.kinds: dict[ast.AST, Kind] = {}
        self.constants: dict[ast.AST, Any] = {}

    def _refused(self, node: ast.AST) -> Any:
        raise self.source.refuse(node, f"{type(node).__name__} is not in the subset", "use what docs/kernels.md lists")

    def kind(self, node: ast.expr) -> Kind:
        """Return the kind of an expression."""
        value = self.constant(node)
        if value is not ABSENT:
            found = self.kind_of_constant(node, value)
            self.constants[node] = value
        else:
            found = getattr(self, f"_x_{type(node).__name__.lower()}", self._refused)(node)
        self.kinds[node] = found
        return found

    def _variable(self, node: ast.Name) -> Kind:
        if node.id not in self.variables:
            raise self.source.refuse(node, "a variable that has no value yet", "write an assignment before it")
        return self.variables[node.id]

    def _x_name(self, node: ast.Name) -> Kind:
        return self._variable(node)

    def _x_tuple(self, node: ast.Tuple) -> Kind:
        return Tuple(tuple(self.many(node.elts)))

    def many(self, nodes: list[ast.expr]) -> list[Kind]:
        """Return the kinds of several expressions; a starred tuple gives those of its items."""
        found: list[Kind] = []
        for node in nodes:
            if isinstance(node, ast.Starred):
                kind = self.kind(node.value)
                if not isinstance(kind, Tuple):
                    raise self.source.refuse(node, f"* before {named(kind)}", "write * before a tuple")
                found += kind.items
            else:
                found.append(self.kind(node))
                if found[-1] == NONE:
                    raise self.source.refuse(node, "no value", "use a number, or write the call on a line of its own")
        return found

    def _x_attribute(self, node: ast.Attribute) -> Kind:
        kind = self.kind(node.value)
        if isinstance(kind, Bundle) and node.attr in kind.places:
            return kind.places[node.attr][1]
        if isinstance(kind, Record) and node.attr in (kind.dtype.names or ()):
            return self._field(node, kind.dtype[node.attr])
        if isinstance(kind, Tuple) and node.attr in kind.fields:
            return kind.items[kind.fields.index(node.attr)]
        if isinstance(kind, Array) and node.attr in ("size", "shape"):
            return INT if node.attr == "size" else Tuple((INT,) * kind.axes)
        raise self.source.refuse(
            node, f"{named(kind)} has no {node.attr}", "use a field of a bundle, record or NamedTuple"
        )

    def _field(self, node: ast.AST, dtype: Any) -> Kind:
        try:
            return array_kind(dtype.subdtype[0], len(dtype.subdtype[1])) if dtype.subdtype else element(dtype)[1]
        except TypeError as error:
            raise self.source.refuse(
                node, f"a field: {error}", "use fields that are numbers or arrays of them"
            ) from None

    def _x_subscript(self, node: ast.Subscript) -> Kind:
        kind = self.kind(node.value)
        if isinstance(kind, Tuple):
            at = self.constant(node.slice)
            if isinstance(at, int) and -len(kind.items) <= at < len(kind.items):
                return kind.items[at]
            if at is not ABSENT or isinstance(node.slice, (ast.Slice, ast.Tuple)):
                raise self.source.refuse(node, f"no item of {named(kind)}", "use an index inside the tuple")
            self._count(node, node.slice)
            if len(set(kind.items)) == 1:
                return kind.items[0]
            raise self.source.refuse(
                node, f"a variable index into {named(kind)}", "use a constant as the index, or a tuple of one kind"
            )
        if not isinstance(kind, Array):
            raise self.source.refuse(node, f"an index into {named(kind)}", "use an index into an array")
        return self._x_index(node, kind)

    def _x_index(self, node: ast.Subscript, kind: Array) -> Kind:
        given = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if len(given) > kind.axes:
            raise self.source.refuse(node, f"{len(given)} indices into {named(kind)}", "give an index for each axis")
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
        return self._indexed(kind, len(given) - len(slices))

    def _count(self, node: ast.AST, index: ast.expr) -> None:
        """Check an index, or what else has to be a whole number of any width."""
        if self.kind(index) not in (INT, NARROW, U32):
            raise self.source.refuse(
                node, f"{named(self.kinds[index])} as an index", "use a whole number; int() converts"
            )

    def _indexed(self, kind: Array, indices: int) -> Kind:
        if indices < kind.axes:
            return Array(kind.dtype, kind.axes - indices)
        return Record(kind.dtype) if kind.dtype.names is not None else element(kind.dtype)[1]

    def _x_binop(self, node: ast.BinOp) -> Kind:
        return self.operated(node, node.op, self.kind(node.left), self.kind(node.right))

    def operated(self, node: ast.BinOp | ast.AugAssign, op: ast.operator, one: Kind, other: Kind) -> Kind:
        """Return the kind of an operation on two numbers. Raises: SubsetError: there is none."""
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

    def _operated_as_numpy(self, node: ast.BinOp | ast.AugAssign, op: ast.operator, one: Kind, other: Kind) -> Kind:
        """Return the kind of an operation on numpy's numbers: with each other, or with a constant."""
        kind, allowed = next((kind, allowed) for kind, allowed in OPERATED.items() if kind in (one, other))
        if not isinstance(op, allowed):
            raise self.source.refuse(
                node, f"{type(op).__name__} of {named(kind)}", "write int() or float() of both first"
            )
        sides = [node.left, node.right] if isinstance(node, ast.BinOp) else [node.target, node.value]
        for side, of in zip(sides, (one, other), strict=True):
            if of != kind and not self._is_weak(side, of, kind):
                raise self.source.refuse(
                    node, f"{one} and {other} together", f"write {kind}() of both, or int() or float() of both"
                )
        return kind

    def _is_weak(self, node: ast.expr, kind: Kind, beside: Kind) -> bool:
        """Return whether an expression is a constant of Python, which numpy converts to the kind beside it."""
        value = self.constant(node)
        if type(value) is int and kind == INT:
            return beside == F32 or value >= 0
        return type(value) is float and beside == F32

    def _x_unaryop(self, node: ast.UnaryOp) -> Kind:
        if isinstance(node.op, ast.Not):
            self._truth(node.operand)
            return BOOL
        kind = self.kind(node.operand)
        if kind == INT or (kind in (FLOAT, F32) and isinstance(node.op, (ast.USub, ast.UAdd))):
            return kind
        if kind == U64 and isinstance(node.op, ast.Invert):
            return kind
        raise self.source.refuse(node, f"{type(node.op).__name__} of {named(kind)}", "use a number; int() converts")

    def _truth(self, node: ast.expr) -> None:
        """Check an expression of which only the truth counts."""
        if isinstance(node, ast.BoolOp):
            for each in node.values:
                self._truth(each)
            self.kinds[node] = BOOL
            return
        if not isinstance(self.kind(node), Scalar) or self.kinds[node] == NONE:
            raise self.source.refuse(node, f"{named(self.kinds[node])} as a condition", "write a comparison")

    def _x_boolop(self, node: ast.BoolOp) -> Kind:
        kinds = {self.kind(each) for each in node.values}
        if kinds != {BOOL}:
            raise self.source.refuse(node, "and, or of values that are no bool", "write bool() of each, or an if")
        return BOOL

    def _x_compare(self, node: ast.Compare) -> Kind:
        left, kind = node.left, self.kind(node.left)
        for op, right in zip(node.ops, node.comparators, strict=True):
            beside = self.kind(right)
            if isinstance(op, (ast.In, ast.NotIn)):
                if len(node.ops) > 1 or not isinstance(beside, Tuple):
                    raise self.source.refuse(node, "membership", "test membership in a tuple of numbers")
                for item in beside.items:
                    self._comparable(node, (left, kind), (None, item))
            else:
                self._comparable(node, (left, kind), (right, beside))
            left, kind = right, beside
        return BOOL

    def _comparable(self, node: ast.AST, one: tuple[ast.expr, Kind], other: tuple[ast.expr | None, Kind]) -> None:
        both = {one[1], other[1]}
        if both in ({U64}, {F32}) or both <= {INT, NARROW, BOOL, U32} or both <= {INT, NARROW, BOOL, FLOAT}:
            return
        for beside in (U64, F32):
            if beside in both and any(x and self._is_weak(x, kind, beside) for x, kind in (one, other)):
                return
        raise self.source.refuse(node, f"{named(one[1])} beside {named(other[1])}", "compare numbers of one kind")

    def _x_ifexp(self, node: ast.IfExp) -> Kind:
        self._truth(node.test)
        kind = joined(self.kind(node.body), self.kind(node.orelse))
        if kind is None or kind == NONE:
            raise self.source.refuse(
                node, "no value, or two kinds in one expression", "make both of one kind, or write an if"
            )
        return kind

    def _x_call(self, node: ast.Call) -> Kind:
        function = self.constant(node.func)
        if any(isinstance(each, ast.Subscript) for each in ast.walk(node.func)) and callable(function):
            # What it writes to would not be known (writes.py).
            raise self.source.refuse(node, "a call of an item", "call the function by its name")
        if function is ABSENT or isinstance(getattr(function, "__self__", None), np.ndarray):
            return intrinsics.method_kind(self, node)
        if getattr(function, "__kernel__", False):
            return self._call_of_kernel(node, function)
        if isinstance(function, type) and hasattr(function, "_fields"):
            if is_bundle(function):
                raise self.source.refuse(node, "a bundle that is made in a kernel", "take the bundle as an argument")
            kinds = self.many([*node.args, *(each.value for each in node.keywords)])
            try:
                wanted = Tuple(tuple(kind for _, kind in fields_of(function)), function)
            except TypeError as error:
                instead = "annotate its fields with int, float, bool, or a type of phalanx/arrays.py"
                raise self.source.refuse(node, str(error), instead) from None
            first = len(kinds) - len(node.keywords)
            if [each.arg for each in node.keywords] != list(wanted.fields[first : len(kinds)]):
                raise self.source.refuse(node, "arguments in another order", "keep the order of the fields")
            self._fits(node, Tuple(tuple(kinds)), Tuple(wanted.items), f"match the fields of {function.__name__}")
            return wanted
        return intrinsics.kind(self, node, function)

    def _call_of_kernel(self, node: ast.Call, function: Callable[..., Any]) -> Kind:
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
            pairs.append((each.arg, self.kind(each.value)))
        defaults = dict(zip(names[::-1], (function.__defaults__ or ())[::-1], strict=False))
        for name in set(names) - {name for name, _ in pairs}:
            if name not in defaults:
                raise self.source.refuse(node, f"no {name}", f"give all arguments of {function.__name__}")
            pairs.append((name, self.kind_of_constant(node, defaults[name])))
        for name, kind in pairs:
            self._fits(node, kind, parameters[name], f"match {name} of {function.__name__}")
        return returned

    # --- conversions ---

    def fills(self, node: ast.Call, kind: Kind, made: Array) -> None:
        """Check the value that np.full puts into an array."""
        if made.dtype.names is not None:
            raise self.source.refuse(node, "records that are filled", "use np.zeros, and assign to the fields")
        self._fits(node, kind, element(made.dtype)[1], "store a number of the array's kind", is_stored=True)

    def _fits(self, node: ast.AST, kind: Kind, into: Kind, instead: str, *, is_stored: bool = False) -> None:
        if kind == into or self._converts(kind, into) or (is_stored and self._is_storable(node, kind, into)):
            return
        raise self.source.refuse(
            node, f"{named(kind)} where {named(into)} belongs", f"{instead}; int() and float() convert"
        )

    def _converts(self, kind: Kind, into: Kind) -> bool:
        """Return whether a value stands for another kind's as it is, in Python too."""
        if isinstance(kind, Tuple) and isinstance(into, Tuple) and len(kind.items) == len(into.items):
            pairs = zip(kind.items, into.items, strict=True)
            return (into.cls is None or into.cls is kind.cls) and all(a == b or self._converts(a, b) for a, b in pairs)
        return (kind == BOOL and into == INT) or (kind in (INT, BOOL) and into == FLOAT)

    def _is_storable(self, node: ast.AST, kind: Kind, into: Kind) -> bool:
        """Return whether an array's element or a record's field takes a number: numpy converts it."""
        if into == U64:
            value = self.constant(node.value) if isinstance(node, ast.Assign) else ABSENT
            return kind in (BOOL, NARROW, U32) or (kind == INT and isinstance(value, int) and value >= 0)
        numbers = (INT, NARROW, BOOL, U32, FLOAT, F32)
        return kind in numbers and into in numbers and not (into in (INT, NARROW, U32) and kind in (FLOAT, F32))


def _is_whole(node: ast.Slice) -> bool:
    return node.lower is None and node.upper is None
