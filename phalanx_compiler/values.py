"""Values of a typed kernel in C: temporaries, conversions, tuples and constants."""

from __future__ import annotations

import ast
import math
from typing import Any

import numpy as np

from .needed import Needed
from .typed import Typed
from .value_types import BOOL, F32, INT, NARROW, U32, Scalar, Tuple, ValueType

WHOLE = (INT, NARROW, BOOL, U32)


class Values:
    """Writes values of a kernel; `lines` are the statements written so far."""

    def __init__(self, typed: Typed, unit: Needed) -> None:
        self.typed, self.unit, self.source = typed, unit, typed.source
        self.lines: list[str] = []
        self.depth = 1
        self.temporaries: dict[str, ValueType] = {}
        self.makes = False  # whether it uses scratch memory

    # --- lines, temporaries ---

    def emit(self, line: str) -> None:
        """Write a statement."""
        self.lines.append("    " * self.depth + line)

    def site(self, node: ast.AST) -> int:
        """Return the number of a place in the source, for checks."""
        return self.unit.site(self.source.file, getattr(node, "lineno", self.source.tree.lineno))

    def temporary(self, typ: ValueType) -> str:
        """Return the name of a new temporary."""
        name = f"t{len(self.temporaries)}"
        self.temporaries[name] = typ
        return name

    def in_temporary(self, c: str, typ: ValueType) -> str:
        """Return a name for a value that is used several times, or must be read now."""
        if c.isidentifier() or c.isdigit():
            return c
        name = self.temporary(typ)
        self.emit(f"{name} = {c};")
        return name

    # --- types ---

    def convert(self, c: str, typ: ValueType, into: ValueType) -> str:
        """Write a value of one type as another."""
        if typ == into:
            return c
        if isinstance(typ, Scalar) and isinstance(into, Scalar):
            if into == BOOL:
                return f"(({c}) != 0)"
            if into == F32 and typ in WHOLE:  # as numpy: a whole number is a float64 first
                return f"((float)(double)({c}))"
            return f"(({into.c})({c}))"
        assert isinstance(typ, Tuple)
        assert isinstance(into, Tuple)
        if self.unit.c_type(typ) == self.unit.c_type(into):
            return c
        temp = self.in_temporary(c, typ)
        items = [
            self.convert(self.item(temp, typ, k), a, b)
            for k, (a, b) in enumerate(zip(typ.items, into.items, strict=True))
        ]
        return self.tuple_of(into, items)

    def tuple_of(self, typ: Tuple, items: list[str]) -> str:
        """Write a tuple of values."""
        text = ", ".join(items)
        return (
            f"(({self.unit.c_type(typ)}){{{{{text}}}}})"
            if self.unit.is_alike(typ)
            else f"(({self.unit.c_type(typ)}){{{text}}})"
        )

    def item(self, c: str, typ: Tuple, k: int) -> str:
        """Write an item of a tuple."""
        return f"{c}.f[{k}]" if self.unit.is_alike(typ) else f"{c}.f{k}"

    def literal(self, value: Any) -> str:
        """Write a constant."""
        if isinstance(value, (bool, np.bool_)):
            return "true" if value else "false"
        if isinstance(value, np.uint64):
            return f"UINT64_C({int(value)})"
        if isinstance(value, np.uint32):
            return f"UINT32_C({int(value)})"
        if isinstance(value, (int, np.integer)):
            number = int(value)
            if number == -(1 << 63):
                return "INT64_MIN"
            text = f"INT64_C({abs(number)})"
            return text if number >= 0 else f"(-{text})"
        if isinstance(value, (float, np.floating)):
            real = float(value)
            if math.isnan(real):
                return "NAN"
            if math.isinf(real):
                return "INFINITY" if real > 0 else "(-INFINITY)"
            return f"({real.hex()}{'f' if isinstance(value, np.float32) else ''})"
        if isinstance(value, np.ndarray):
            return self.unit.static(value)
        assert isinstance(value, tuple)
        typ = self.typed.type_of_constant(self.source.tree, value)
        assert isinstance(typ, Tuple)
        return self.tuple_of(typ, [self.literal(each) for each in value])
