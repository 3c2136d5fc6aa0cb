"""The controllers by number, so that one compiled loop runs whichever a mission has chosen.

Files in bundled/ declare the bundled ones (declaration.py). The kernels here are an `if` for each. Number 0 puts out
nothing and has no state. Numbers behind the bundled ones are users' own (own_kernels.py), called by their address.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from phalanx.arrays import Params
from phalanx.errors import UsageError
from phalanx.kernel import Linked, link, linked, written
from phalanx.wire.fields import Row, whole

from .declaration import OWN, Declaration, bundled

_F = TypeVar("_F", bound=Callable[..., Any])

_NAMES = bundled()
_MODULES = [importlib.import_module(f"{__package__}.bundled.{name}") for name in _NAMES]
BUNDLED: dict[str, Declaration] = {name: each.CONTROLLER for name, each in zip(_NAMES, _MODULES, strict=True)}
NUMBERS = {name: number for number, name in enumerate(_NAMES, 1)}
STATE_KINDS = tuple(int(each.says.tag or 0) for each in BUNDLED.values())
FIRST_OWN = len(_NAMES) + 1
MOST_OWN = 256  # users' controllers in a process; each version of a file counts
# Parameters that kernels write to; all others they only read.
WRITTEN = {"begin": ("state",), "on_advice": ("state",), "on_recv": ("state",), "on_input": ("state", "out")}
# The kernels, without the number, as users' files declare them; and for each own controller, its address and function.
DECLARED: dict[str, Callable[..., Any]] = {}
_addresses: dict[str, Any] = {}
_functions: dict[str, list[Callable[..., Any]]] = {}


def add_own(functions: dict[str, Callable[..., Any]], addresses: dict[str, int]) -> int:
    """Return the number of a new own controller: its functions, and addresses in C. Raises: UsageError: too many."""
    place = len(_functions["size"])
    if place == MOST_OWN:
        raise UsageError(f"more than {MOST_OWN} controllers of one's own in a process", "a new process")
    for name, known in _functions.items():
        known.append(functions[name])
        _addresses[name][place] = addresses.get(name, 0)
    return FIRST_OWN + place


def name_own(words: str, declaration: Declaration, number: int) -> None:
    """Let a name mean an own controller."""
    OWN[words] = BUNDLED[words] = declaration
    NUMBERS[words] = number


def _of_the_chosen(declared: _F) -> _F:
    """Return the kernel that calls the chosen controller's of the same name; whole numbers come to it as int64."""
    name, signature = declared.__name__, inspect.signature(declared)
    rest = list(signature.parameters.values())[1:]
    given = ", ".join(f"whole({each.name})" if each.annotation == "int" else each.name for each in rest)
    functions = _functions[name] = []
    table = _addresses[name] = np.zeros(MOST_OWN, np.uint64)
    DECLARED[name] = declared
    link(f"own_{name}", table.ctypes.data)
    symbol = Linked(f"own_{name}", MOST_OWN, WRITTEN.get(name, ()))
    own = linked(declared, symbol, lambda place, *rest: functions[place](*rest))
    body = []
    for number, (bundle, module) in enumerate(zip(_NAMES, _MODULES, strict=True), 1):
        if hasattr(module, name):  # planners advise not all of them
            body += [f"if kind == {number}:", f"    return {bundle}.{name}({given})"]
    body += [f"if kind >= {FIRST_OWN}:", f"    return own(kind - {FIRST_OWN}, {given})"]
    body.append("return False" if signature.return_annotation == "bool" else "return 0")
    return written(declared, body, {"whole": whole, "own": own, **dict(zip(_NAMES, _MODULES, strict=True))})


@_of_the_chosen
def capacity(kind: int, params: Params) -> int:
    """The longest that a state gets, bytes: what its row must hold."""
    raise NotImplementedError


@_of_the_chosen
def size(kind: int, state: Row) -> int:
    """The length of the encoding that `state` holds now."""
    raise NotImplementedError


@_of_the_chosen
def begin(kind: int, params: Params, rob_id: int, state: Row) -> int:
    """The boot state is in `state`; its length."""
    raise NotImplementedError


@_of_the_chosen
def is_encoding(kind: int, params: Params, rob_id: int, state: Row, length: int) -> bool:
    """Return whether the first `length` bytes are a state of this robot; ask it of every foreign checkpoint.

    The other kernels believe their state: a count too high would have them read and write past its row.
    """
    raise NotImplementedError


@_of_the_chosen
def on_advice(kind: int, params: Params, rob_id: int, advice: Row, length: int, state: Row) -> int:
    """A planner said something; the new length of the encoding, 0 of a controller that nobody advises."""
    raise NotImplementedError


@_of_the_chosen
def on_recv(kind: int, params: Params, rob_id: int, t_ms: int, packet: Row, length: int, state: Row) -> int:
    """A packet was heard; the new length of the encoding."""
    raise NotImplementedError


@_of_the_chosen
def on_input(
    kind: int, params: Params, rob_id: int, step: int, t_ms: int, reading: Row, length: int, state: Row, out: Row
) -> int:
    """The sensors said something; the length of what is in `out`."""
    raise NotImplementedError
