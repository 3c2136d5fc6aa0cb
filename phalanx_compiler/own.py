"""The C of a user's own kernels, as the text of a shared library (library.py compiles it).

Python's headers are not needed: the library is plain C. Each kernel is exported as `own_NAME`, with its arguments by
value and a `struct fault *`; a violation fills that, and the caller raises it as one of its own (runtime.h).
"""

from __future__ import annotations

import string
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .parsing import forget_files, shown_path
from .unit import Unit
from .value_types import signature_of


@dataclass(frozen=True, slots=True)
class Own:
    """A user's kernel, and the test of what it returns.

    Attributes:
        check: kernel of what is returned, of the parameter number `row` if there is one, and of `numbers`.
        violation: name of the violation if the check fails (violations.py).
    """

    function: Callable[..., Any]
    check: Callable[..., Any] | None = None
    row: int | None = None
    numbers: tuple[int, ...] = ()
    violation: str = ""


class _OwnUnit(Unit):
    """The C of a user's kernels, by name, and of all kernels of the package at `root` that they call."""

    def __init__(self, kernels: Mapping[str, Own], file: str, root: Path) -> None:
        super().__init__()
        self._kernels, self._root, self._file = kernels, root, shown_path(file)
        self.site(self._file, 1)  # the first place is where `caller` begins
        self._heads = {name: self.site(self._file, line_of(own.function)) for name, own in kernels.items()}

    def function(self, function: Callable[..., Any]) -> str:
        """Return a kernel's C name: files may be called what C does not allow."""
        if function not in self.names:
            self.names[function] = f"k{len(self.names)}_{function.__name__}"
            self.waiting.append(function)
        return self.names[function]

    def marks_call(self, by: Callable[..., Any], called: Callable[..., Any]) -> bool:
        """Return whether a kernel of the user's calls one of the package."""
        return self._is_own(by.__code__.co_filename) and not self._is_own(called.__code__.co_filename)

    def _is_own(self, file: str) -> bool:
        return not Path(file).resolve().is_relative_to(self._root)

    def _places(self) -> str:
        """Write the lines of the user's files; those of the package have no file, and name the caller."""
        own = {file: self._is_own(file) for file, _ in self.sites}
        return "\n".join(f"    {{{_c_text(file) if own[file] else '0'}, {line}}}," for file, line in self.sites)

    def _interface(self, _entries: list[Callable[..., Any]]) -> list[str]:
        hand_over = """\
static void hand_over(struct frame *frame, struct fault *fault)
{
    const site *place = frame->fault.file != NULL ? NULL : site_of(caller);
    *fault = frame->fault;
    if (place != NULL) { fault->file = place->file; fault->line = place->line; }
    fault->what |= IN_OWN;
    leave(frame);
}
__attribute__((visibility("default"))) void **own_linked(void) { return linked; }"""
        return [hand_over, *(self._exported(name, own) for name, own in self._kernels.items())]

    def _exported(self, name: str, own: Own) -> str:
        parameters, returned = signature_of(own.function)
        types = list(parameters.values())
        head = ", ".join([*(f"{self.c_type(typ)} a{k}" for k, typ in enumerate(types)), "struct fault *fault"])
        call = f"{self.function(own.function)}({', '.join(f'a{k}' for k in range(len(types)))})"
        lines = [
            f'__attribute__((visibility("default"))) {self.c_type(returned)} own_{name}({head})',
            "{",
            "    struct frame frame;",
            "    enter(&frame);",
            "    if (setjmp(frame.jump) != 0) {",
            "        hand_over(&frame, fault);",
            "        return 0;",
            "    }",
            f"    {self.c_type(returned)} returned = {call};",
        ]
        if own.check:
            given = ["returned", *([f"a{own.row}"] if own.row is not None else []), *map(str, own.numbers)]
            is_right = f"{self.function(own.check)}({', '.join(given)})"
            size = "0" if own.row is None else f"a{own.row}.n0"
            violation = f"violate({self._heads[name]}, {own.violation}, returned, {size})"
            lines.append(f"    if (UNLIKELY(!{is_right})) {violation};")
        return "\n".join([*lines, "    leave(&frame);", "    return returned;", "}"])


def _c_text(text: str) -> str:
    """Return a C string of any text."""
    raw = text.encode("utf-8", "replace")
    plain = b"/._- " + string.ascii_letters.encode() + string.digits.encode()
    return '"' + "".join(chr(each) if each in plain else f"\\{each:03o}" for each in raw) + '"'


def line_of(function: Callable[..., Any]) -> int:
    """Return the line on which a kernel begins: that of its first decorator."""
    return function.__code__.co_firstlineno


def source_of_own(kernels: Mapping[str, Own], file: str, root: Path) -> tuple[str, dict[str, int]]:
    """Return the C of a user's file, and the slots of the trusted nodes' functions that it needs.

    Args:
        root: folder of the package.
    Raises: SubsetError: a kernel is outside the subset.
    """
    forget_files()
    unit = _OwnUnit(kernels, file, root)
    checks = [own.check for own in kernels.values() if own.check]
    # The functions behind checks are written as all that is called.
    text = unit.text([*(own.function for own in kernels.values()), *checks])
    return text, unit.slots
