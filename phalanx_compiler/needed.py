"""C names and types, constants, places in the source and C functions that the kernels of one translation unit use."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .value_types import Array, Bundle, Record, Scalar, Tuple, ValueType, signature_of


class Needed:
    """Collects what kernels need while their C is written."""

    def __init__(self) -> None:
        self.names: dict[Callable[..., Any], str] = {}
        self.waiting: list[Callable[..., Any]] = []
        self.sites: dict[tuple[str, int], int] = {}
        self.tuples: dict[tuple[str, ...], str] = {}
        self.statics: dict[int, tuple[np.ndarray[Any, Any], str]] = {}
        self.slots: dict[str, int] = {}
        self.linked: dict[Callable[..., Any], str] = {}

    def site(self, file: str, line: int) -> int:
        """Return the number of a line of source."""
        return self.sites.setdefault((file, line), len(self.sites))

    def slot(self, symbol: str) -> int:
        """Return the number of a C function that is linked when the package is imported."""
        return self.slots.setdefault(symbol, len(self.slots))

    def function(self, function: Callable[..., Any]) -> str:
        """Return the C name of a kernel, which will be written."""
        if function not in self.names:
            module = function.__module__.removeprefix("phalanx.").replace(".", "_")
            name = f"k_{module}_{function.__name__}"
            # Function `b_c` of module `a`, and `c` of `a.b`, would be one.
            while name in self.names.values():
                name += "_"
            self.names[function] = name
            self.waiting.append(function)
        return self.names[function]

    def static(self, value: np.ndarray[Any, Any]) -> str:
        """Return an array that never changes."""
        _, name = self.statics.setdefault(id(value), (value, f"static{len(self.statics)}"))
        lengths = ", ".join(map(str, value.shape))
        return f"(({self.c_type(Array(value.dtype, value.ndim))}){{(char *){name}, {lengths}}})"

    def c_type(self, typ: ValueType) -> str:
        """Return the C type of a value."""
        if isinstance(typ, Scalar):
            return typ.c
        if isinstance(typ, Array):
            return f"arr{typ.axes}"
        if isinstance(typ, Record):
            return "char *"
        if isinstance(typ, Bundle):
            return "const int64_t *"
        items = tuple(self.c_type(each) for each in typ.items)
        return self.tuples.setdefault(items, f"tup{len(self.tuples)}")

    def is_alike(self, typ: Tuple) -> bool:
        """Return whether all items have one C type: the struct then is an array of them."""
        return len({self.c_type(each) for each in typ.items}) == 1

    def linked_call(self, function: Callable[..., Any]) -> str:
        """Return the C function that calls a kernel of another library, by the address at its first argument.

        It stands alone, and cold: in its callers it would slow down the package's own kernels.
        """
        name, (parameters, returned) = f"linked_{function.__name__}", signature_of(function)
        if function not in self.linked:
            c_types = [self.c_type(typ) for typ in parameters.values()]
            taken = ", ".join(f"{c_type} a{k}" for k, c_type in enumerate(c_types))
            given = "".join(f"a{k}, " for k in range(1, len(c_types)))
            pointer = f"{self.c_type(returned)} (*)({', '.join([*c_types[1:], 'struct fault *'])})"
            how = function.__linked__  # type: ignore[attr-defined]
            lines = [
                f"static __attribute__((noinline, cold)) {self.c_type(returned)} {name}({taken}, int32_t at)",
                "{",
                "    struct fault fault = {0};",
                f"    void *found = linked_at(linked[{self.slot(how.symbol)}], a0, {how.most}, at);",
                f"    {self.c_type(returned)} returned = (({pointer})found)({given}&fault);",
                "    if (UNLIKELY(fault.file != NULL)) pass_on(&fault);",
                "    return returned;",
                "}",
            ]
            self.linked[function] = "\n".join(lines)
        return name

    def marks_call(self, _by: Callable[..., Any], _called: Callable[..., Any]) -> bool:
        """Return whether a call is noted in `caller`, so that a violation in what is called names the call's line."""
        return False
