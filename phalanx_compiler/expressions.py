"""Expressions of a typed kernel in C.

C may evaluate operands in any order, Python goes from left to right. So a call of a kernel becomes an assignment to a
temporary before its statement. Operands that the call might change are read into temporaries before it.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from functools import partial

from .constants import ABSENT
from .value_types import (
    BOOL,
    F32,
    FLOAT,
    INT,
    NARROW,
    U64,
    Array,
    Bundle,
    Record,
    Scalar,
    Tuple,
    ValueType,
    compared,
    element,
)
from .value_types import words as words_of
from .values import Values

SIGNS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^"}
COMPARED = {ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}


class Expressions(Values):
    """Writes a kernel's expressions."""

    def many(self, nodes: list[ast.expr]) -> list[tuple[str, ValueType]]:
        """Write several expressions, left to right; what a later one may change is read before it."""
        found: list[tuple[str, ValueType]] = []
        for node in nodes:
            before = len(self.lines)
            made = self._starred(node) if isinstance(node, ast.Starred) else [(self.expr(node), self.typed.types[node])]
            if len(self.lines) > before:
                late, self.lines = self.lines[before:], self.lines[:before]
                found = [(self.in_temporary(c, typ) if self._may_change(c) else c, typ) for c, typ in found]
                self.lines += late
            found += made
        return found

    @staticmethod
    def _may_change(c: str) -> bool:
        return any(mark in c for mark in "*[(")

    def _starred(self, node: ast.Starred) -> list[tuple[str, ValueType]]:
        typ = self.typed.types[node.value]
        assert isinstance(typ, Tuple)
        temp = self.in_temporary(self.expr(node.value), typ)
        return [(self.item(temp, typ, k), each) for k, each in enumerate(typ.items)]

    # --- expressions ---

    def expr(self, node: ast.expr) -> str:
        """Write an expression of the type that typing has found."""
        if node in self.typed.constants:
            return self.literal(self.typed.constants[node])
        written: str = getattr(self, f"_x_{type(node).__name__.lower()}")(node)
        return written

    def as_type(self, node: ast.expr, into: ValueType) -> str:
        """Write an expression, converted."""
        return self.convert(self.expr(node), self.typed.types[node], into)

    def _x_name(self, node: ast.Name) -> str:
        return f"v_{node.id}"

    def _x_tuple(self, node: ast.Tuple) -> str:
        typ = self.typed.types[node]
        assert isinstance(typ, Tuple)
        return self.tuple_of(typ, [c for c, _ in self.many(node.elts)])

    def place(self, target: ast.expr) -> str:
        """Write what can be assigned to, with its index computed once: an element, a record's field, or several."""
        whole = self.typed.types[target.value] if isinstance(target, (ast.Attribute, ast.Subscript)) else None
        if isinstance(target, ast.Subscript) and isinstance(whole, Array):
            return self._indexed(target, whole)
        assert isinstance(target, ast.Attribute)
        assert isinstance(whole, Record)
        return self._member(self.expr(target.value), whole, target.attr)

    def read(self, place: str, target: ast.expr) -> str:
        """Write the value of an element or a field: narrow ones are widened, or C would compute in 32 bits."""
        typ = self.typed.types[target]
        if typ == BOOL:
            return f"({place} != 0)"
        return f"((int64_t){place})" if typ in (INT, NARROW) else place

    def _x_attribute(self, node: ast.Attribute) -> str:
        typ = self.typed.types[node.value]
        if isinstance(typ, Bundle):
            place, of = typ.places[node.attr]
            return self._loaded(self.in_temporary(self.expr(node.value), typ), place, of)
        if isinstance(typ, Record):
            return self.read(self.place(node), node)
        temp = self.in_temporary(self.expr(node.value), typ)
        if isinstance(typ, Tuple):
            return self.item(temp, typ, typ.fields.index(node.attr))
        assert isinstance(typ, Array)
        lengths = [f"{temp}.n{k}" for k in range(typ.axes)]
        if node.attr == "size":
            return f"({' * '.join(lengths)})"
        return self.tuple_of(Tuple((INT,) * typ.axes), lengths)

    def _loaded(self, words: str, place: int, typ: ValueType) -> str:
        """Write a field of a bundle, from its words."""
        if isinstance(typ, Scalar):
            word = f"as_double({words}[{place}])" if typ in (FLOAT, F32) else f"{words}[{place}]"
            return word if typ in (FLOAT, INT) else f"(({typ.c}){word})"
        if isinstance(typ, Bundle):
            return f"((const int64_t *){words}[{place}])"
        if isinstance(typ, Tuple):
            items = []
            for each in typ.items:
                items.append(self._loaded(words, place, each))
                place += words_of(each)
            return self.tuple_of(typ, items)
        assert isinstance(typ, Array)
        lengths = ", ".join(f"{words}[{place + 1 + k}]" for k in range(typ.axes))
        return f"(({self.unit.c_type(typ)}){{(char *){words}[{place}], {lengths}}})"

    def _member(self, record: str, typ: Record, name: str) -> str:
        """Write a field of a record, which can be assigned to."""
        dtype, offset = typ.dtype.fields[name][:2]  # type: ignore[index]
        if dtype.subdtype:
            of = Array(dtype.subdtype[0], len(dtype.subdtype[1]))
            lengths = ", ".join(map(str, dtype.subdtype[1]))
            return f"(({self.unit.c_type(of)}){{{record} + {offset}, {lengths}}})"
        return f"(*({element(dtype)[0]} *)({record} + {offset}))"

    def _x_subscript(self, node: ast.Subscript) -> str:
        typ = self.typed.types[node.value]
        if isinstance(typ, Tuple):
            at = self.typed.constant(node.slice)
            (temp, _), *rest = self.many([node.value] if at is not ABSENT else [node.value, node.slice])
            temp = self.in_temporary(temp, typ)
            if at is not ABSENT:
                return self.item(temp, typ, at % len(typ.items))
            return f"{temp}.f[within({rest[0][0]}, {len(typ.items)}, {self.site(node)})]"
        return self.read(self.place(node), node)

    def _indexed(self, node: ast.Subscript, typ: Array) -> str:
        given = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        ends = [end for each in given if isinstance(each, ast.Slice) for end in (each.lower, each.upper) if end]
        plain = [each for each in given if not isinstance(each, ast.Slice)]
        (array, _), *written = self.many([node.value, *plain, *ends])
        array, at, cut = self.in_temporary(array, typ), iter(written[: len(plain)]), iter(written[len(plain) :])
        places: list[str | tuple[str, str]] = []
        for axis, each in enumerate(given):
            length, value = f"{array}.n{axis}", self.typed.constant(each)
            if not isinstance(each, ast.Slice):
                c = next(at)[0]
                from_end = isinstance(value, int) and value < 0
                places.append(f"{length} - {-value}" if from_end else c)
                continue
            low = self.in_temporary(f"cut({next(cut)[0]}, {length})", INT) if each.lower else "0"
            high = self.in_temporary(f"cut({next(cut)[0]}, {length})", INT) if each.upper else length
            places.append((low, high if low == "0" else f"cut_length({low}, {high})"))
        return self.index(array, typ, places, node)

    def index(self, array: str, typ: Array, places: list[str | tuple[str, str]], node: ast.AST) -> str:
        """Write an element, a record, or a smaller array.

        Args:
            places: for each of the first axes its index, or where a slice begins and its length.
        """
        place, at, size = "", self.site(node), typ.dtype.itemsize
        lengths: list[str] = []
        for axis in range(typ.axes):
            length = f"{array}.n{axis}"
            each = places[axis] if axis < len(places) else ("0", length)
            if isinstance(each, tuple):
                where = each[0]
                lengths.append(each[1])
            else:
                where = f"within({each}, {length}, {at})"
            place = where if place in ("", "0") else f"({place}) * {length}" + (f" + {where}" if where != "0" else "")
        where = f"{array}.p" + ("" if place == "0" else f" + ({place}) * {size}" if size > 1 else f" + {place}")
        if lengths:
            return f"(({self.unit.c_type(Array(typ.dtype, len(lengths)))}){{{where}, {', '.join(lengths)}}})"
        if typ.dtype.names is not None:
            return f"({where})"
        return f"(*({element(typ.dtype)[0]} *)({where}))"

    def _x_binop(self, node: ast.BinOp) -> str:
        (a, ka), (b, kb) = self.many([node.left, node.right])
        return self.operated(node, node.op, (a, ka), (b, kb), self.typed.types[node])

    def operated(
        self, node: ast.AST, op: ast.operator, one: tuple[str, ValueType], other: tuple[str, ValueType], typ: ValueType
    ) -> str:
        """Write an operation on two numbers."""
        a, b = self.convert(*one, typ), self.convert(*other, typ)
        if type(op) in SIGNS:
            return f"({a} {SIGNS[type(op)]} {b})"
        if isinstance(op, ast.Div):
            return f"({a} / {b})"
        if isinstance(op, (ast.LShift, ast.RShift)):
            count = f"within((int64_t){b}, 64, {self.site(node)})"
            if isinstance(op, ast.RShift):
                return f"({a} >> {count})"
            return f"({a} << {count})" if typ == U64 else f"((int64_t)((uint64_t){a} << {count}))"
        name = "floordiv" if isinstance(op, ast.FloorDiv) else "floormod"
        if typ in (FLOAT, F32):
            return f"{name}_d({a}, {b})"
        if typ == U64:
            return f"({a} {'/' if name == 'floordiv' else '%'} (uint64_t)divisor((int64_t){b}, {self.site(node)}))"
        return (
            f"{name}({a}, {b if b.startswith('INT64_C') and b != 'INT64_C(0)' else f'divisor({b}, {self.site(node)})'})"
        )

    def _x_unaryop(self, node: ast.UnaryOp) -> str:
        if isinstance(node.op, ast.Not):
            return f"(!{self.truth(node.operand)})"
        c = self.as_type(node.operand, self.typed.types[node])
        return f"({ {ast.USub: '-', ast.Invert: '~', ast.UAdd: '+'}[type(node.op)] }{c})"

    def truth(self, node: ast.expr) -> str:
        """Write a condition."""
        if isinstance(node, ast.BoolOp):
            return self._x_boolop(node)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return f"(!{self.truth(node.operand)})"
        return self.convert(self.expr(node), self.typed.types[node], BOOL)

    def _x_boolop(self, node: ast.BoolOp) -> str:
        """Write `and` and `or`; statements that an operand needs run only if it is reached."""
        text = self.truth(node.values[0])
        for each in node.values[1:]:
            text = self._further(text, partial(self.truth, each), is_and=isinstance(node.op, ast.And))
        return text

    def _further(self, text: str, write: Callable[[], str], *, is_and: bool) -> str:
        """Write what is only reached if the truth so far does not decide."""
        later, late = self.deferred(write)
        if not late:
            return f"({text} {'&&' if is_and else '||'} {later})"
        temp = self.temporary(BOOL)
        self.emit(f"{temp} = {text};")
        self.emit(f"if ({temp if is_and else f'!{temp}'}) {{")
        self.lines += late
        self.emit(f"    {temp} = {later};")
        self.emit("}")
        return temp

    def deferred(self, write: Callable[[], str], *, deeper: bool = True) -> tuple[str, list[str]]:
        """Return what is written, and the statements that it needs before it, which are not written yet."""
        before = len(self.lines)
        self.depth += deeper
        c = write()
        self.depth -= deeper
        late, self.lines = self.lines[before:], self.lines[:before]
        return c, late

    def _x_ifexp(self, node: ast.IfExp) -> str:
        typ, test = self.typed.types[node], self.truth(node.test)
        one, first = self.deferred(lambda: self.as_type(node.body, typ))
        other, second = self.deferred(lambda: self.as_type(node.orelse, typ))
        if not first and not second and not isinstance(typ, Array):
            return f"({test} ? {one} : {other})"
        temp = self.temporary(typ)
        self.emit(f"if ({test}) {{")
        self.lines += [*first, "    " * self.depth + f"    {temp} = {one};"]
        self.emit("} else {")
        self.lines += [*second, "    " * self.depth + f"    {temp} = {other};"]
        self.emit("}")
        return temp

    def _x_compare(self, node: ast.Compare) -> str:
        if isinstance(node.ops[0], (ast.In, ast.NotIn)):
            return self._membership(node)
        one, other = self.many([node.left, node.comparators[0]])
        if len(node.ops) > 1:
            other = self.in_temporary(*other), other[1]
        return self._chained(node, 1, self._compared(node.ops[0], one, other), other)

    def _compared(self, op: ast.cmpop, one: tuple[str, ValueType], other: tuple[str, ValueType]) -> str:
        into = compared(one[1], other[1])
        return f"({self.convert(*one, into)} {COMPARED[type(op)]} {self.convert(*other, into)})"

    def _chained(self, node: ast.Compare, k: int, text: str, one: tuple[str, ValueType]) -> str:
        """Write the comparisons from number k on, which are only reached while those before are true."""
        if k == len(node.ops):
            return text

        def write() -> str:
            right = node.comparators[k]
            other = self.expr(right), self.typed.types[right]
            if k + 1 < len(node.ops):
                other = self.in_temporary(*other), other[1]
            return self._chained(node, k + 1, self._compared(node.ops[k], one, other), other)

        return self._further(text, write, is_and=True)

    def _membership(self, node: ast.Compare) -> str:
        right = self.typed.types[node.comparators[0]]
        assert isinstance(right, Tuple)
        (one, typ), (among, _) = self.many([node.left, node.comparators[0]])
        one, among = self.in_temporary(one, typ), self.in_temporary(among, right)
        parts = []
        for k, of in enumerate(right.items):
            into = compared(typ, of)
            parts.append(f"({self.convert(one, typ, into)} == {self.convert(self.item(among, right, k), of, into)})")
        found = f"({' || '.join(parts) or 'false'})"
        return found if isinstance(node.ops[0], ast.In) else f"(!{found})"
