"""One translation unit: the kernels' functions, the structs and constants that they need, and the table of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from . import violations
from .needed import Needed
from .parsing import Source, source_of
from .statements import written
from .typed import Typed
from .value_types import (
    FLOAT,
    INT,
    NONE,
    Array,
    Bundle,
    Record,
    Scalar,
    Tuple,
    ValueType,
    leaves,
    named,
    signature_of,
    words,
)
from .writes import writes_of

# As many as a call from Python has room for (call.c), and bits for what is written.
MOST_WORDS, MOST_PARAMETERS = 96, 64
RUNTIME = Path(__file__).with_name("runtime.h")


class Unit(Needed):
    """The kernels of one extension module; `text` is the C of all of them."""

    def __init__(self) -> None:
        super().__init__()
        self._writes: dict[Callable[..., Any], int] = {}

    def text(self, functions: Iterable[Callable[..., Any]]) -> str:
        """Return the C of kernels, and of all that they call. Raises: SubsetError: one is outside the subset."""
        entries = list(functions)
        for each in entries:
            self.function(each)
        bodies, heads, k = [], [], 0
        while k < len(self.waiting):
            function = self.waiting[k]
            source = source_of(function)
            typed = Typed(source)
            _check_call(source, typed)
            body = written(function, typed, self)
            self._writes[function] = sum(
                1 << n for n, name in enumerate(typed.parameters) if name in writes_of(function)
            )
            head = body.partition("\n")[0]
            if hasattr(function, "__rejected__"):
                body += _guarded(head, list(typed.parameters), function.__rejected__)
                head = head.replace("_unguarded(", "(")
            bodies.append(body)
            heads.append(f"{head};")
            k += 1
        parts = [
            violations.enum(),
            RUNTIME.read_text(),
            *(_struct(items, name) for items, name in self.tuples.items()),
            f"static void *linked[{len(self.slots) + 1}];",
            *self.linked.values(),
            *(_bytes_of(value, name) for value, name in self.statics.values()),
            *heads,
            *bodies,
            f"static const site sites[] = {{\n{self._places()}\n}};",
            "static const site *site_of(int32_t at) { return &sites[at]; }",
            *self._interface(entries),
        ]
        return "\n".join(parts) + "\n"

    def _interface(self, entries: list[Callable[..., Any]]) -> list[str]:
        """Return what Python calls: a function for each kernel, and the table of them."""
        rows = [
            f'    {{"{_label(each)}", UINT64_C({self._writes[each]}), entry_{self.names[each]}}},' for each in entries
        ]
        return [
            *map(self._entry, entries),
            "struct entry { const char *name; uint64_t writes; void (*call)(const word *, word *); };",
            f"static const struct entry entries[] = {{\n{chr(10).join(rows)}\n    {{0, 0, 0}},\n}};",
        ]

    def _places(self) -> str:
        return "\n".join(f"    {{{json.dumps(file, ensure_ascii=False)}, {line}}}," for file, line in self.sites)

    def _entry(self, function: Callable[..., Any]) -> str:
        """Return a kernel's function for calls from Python, which takes and gives words."""
        parameters, returned = signature_of(function)
        at, arguments = 0, []
        for typ in parameters.values():
            text, at = self._from_words(typ, at)
            arguments.append(text)
        name = self.names[function]
        lines = [f"static void entry_{name}(const word *a, word *r)", "{"]
        call = f"{name}({', '.join(arguments)})"
        if returned == NONE:
            lines += [f"    {call};", "    (void)r;"]
        else:
            lines += [f"    {self.c_type(returned)} v = {call};", *self._to_words(returned, "v", [0])]
        if not arguments:
            lines.insert(2, "    (void)a;")
        return "\n".join([*lines, "}"])

    def _from_words(self, typ: ValueType, at: int) -> tuple[str, int]:
        if isinstance(typ, Tuple):
            items = []
            for each in typ.items:
                text, at = self._from_words(each, at)
                items.append(text)
            inner = ", ".join(items)
            is_alike = self.is_alike(typ)
            return f"(({self.c_type(typ)}){{{f'{{{inner}}}' if is_alike else inner}}})", at
        if isinstance(typ, Array):
            lengths = ", ".join(f"a[{at + 1 + k}].i" for k in range(typ.axes))
            return f"((arr{typ.axes}){{(char *)a[{at}].p, {lengths}}})", at + 1 + typ.axes
        if isinstance(typ, Scalar):
            text = f"a[{at}].d" if typ == FLOAT else f"(float)a[{at}].d" if typ.c == "float" else f"a[{at}].i"
            return (f"(({typ.c}){text})" if typ not in (FLOAT, INT) else text), at + 1
        return f"(({self.c_type(typ)})a[{at}].p)", at + 1

    def _to_words(self, typ: ValueType, c: str, at: list[int]) -> list[str]:
        if isinstance(typ, Tuple):
            is_alike = self.is_alike(typ)
            return [
                line
                for k, each in enumerate(typ.items)
                for line in self._to_words(each, f"{c}.f[{k}]" if is_alike else f"{c}.f{k}", at)
            ]
        k = at[0]
        if isinstance(typ, Array):
            at[0] += 1 + typ.axes
            return [f"    r[{k}].p = {c}.p;", *(f"    r[{k + 1 + n}].i = {c}.n{n};" for n in range(typ.axes))]
        at[0] += 1
        assert isinstance(typ, Scalar), "records and bundles are not returned to Python"
        field = "d" if typ.c in ("double", "float") else "u" if typ.c == "uint64_t" else "i"
        return [f"    r[{k}].{field} = {c};"]


def _check_call(source: Source, typed: Typed) -> None:
    """Raises: SubsetError: Python could not call the kernel."""
    place = source.tree.args
    if any(isinstance(each, (Record, Bundle)) for each in leaves(typed.returned)):
        raise source.refuse(place, f"{named(typed.returned)} is returned", "return an index, or numbers")
    most = max(sum(map(words, typed.parameters.values())), words(typed.returned))
    if most > MOST_WORDS or len(typed.parameters) > MOST_PARAMETERS:
        what = f"{most} words of arguments or of what is returned, where {MOST_WORDS} are possible"
        raise source.refuse(place, what, "pass arrays instead of numbers, or a bundle")


def _guarded(head: str, parameters: list[str], rejected: int) -> str:
    """Return the function that other kernels call: a violated check in the unguarded one makes it return `rejected`."""
    called = head.partition("(")[0].split()[-1]
    arguments = ", ".join(f"v_{each}" for each in parameters)
    lines = [
        head.replace("_unguarded(", "("),
        "{",
        "    struct frame frame;",
        "    enter(&frame);",
        "    if (setjmp(frame.jump) != 0) {",
        "        reject(&frame);",
        f"        return {int(rejected)};",
        "    }",
        f"    int64_t returned = {called}({arguments});",
        "    leave(&frame);",
        "    return returned;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _label(function: Callable[..., Any]) -> str:
    return f"{function.__module__}.{function.__name__}"


def _struct(items: tuple[str, ...], name: str) -> str:
    if len(set(items)) == 1:
        return f"typedef struct {{ {items[0]} f[{len(items)}]; }} {name};"
    return f"typedef struct {{ {' '.join(f'{each} f{k};' for k, each in enumerate(items))} }} {name};"


def _bytes_of(value: np.ndarray[Any, Any], name: str) -> str:
    raw = np.ascontiguousarray(value).tobytes()
    return f"static const uint8_t {name}[] __attribute__((aligned(16))) = {{{', '.join(map(str, raw))}}};"
