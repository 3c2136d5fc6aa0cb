"""Dispatch to controllers by number, so that one compiled loop can run any of them.

Files in bundled/ declare the bundled controllers (declaration.py), and the kernels here have an `if` for each. Number
0 has no outputs and no state. Higher numbers are users' controllers (own_kernels.py), called by their address.
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
MOST_OWN = 256  # users' controllers per process; each version of a file counts
# Parameters that each kernel writes to; the others are read-only.
WRITTEN = {"begin": ("state",), "on_advice": ("state",), "on_recv": ("state",), "on_input": ("state", "out")}
# Declarations of the kernels by name; and for users' controllers, their addresses and functions.
DECLARED: dict[str, Callable[..., Any]] = {}
_addresses: dict[str, Any] = {}
_functions: dict[str, list[Callable[..., Any]]] = {}


def add_own(functions: dict[str, Callable[..., Any]], addresses: dict[str, int]) -> int:
    """Add a user's controller by its functions and C addresses; return its number. Raises: UsageError: too many."""
    place = len(_functions["size"])
    if place == MOST_OWN:
        raise UsageError(f"more than {MOST_OWN} own controllers in one process", "start a new process")
    for name, known in _functions.items():
        known.append(functions[name])
        _addresses[name][place] = addresses.get(name, 0)
    return FIRST_OWN + place


def register_own_name(words: str, declaration: Declaration, number: int) -> None:
    """Register a name for a user's controller."""
    OWN[words] = BUNDLED[words] = declaration
    NUMBERS[words] = number


def _of_the_chosen(declared: _F) -> _F:
    """Return a kernel that calls the kernel of the same name of controller `kind`, with integers as int64."""
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
        if hasattr(module, name):  # on_advice is optional
            body += [f"if kind == {number}:", f"    return {bundle}.{name}({given})"]
    body += [f"if kind >= {FIRST_OWN}:", f"    return own(kind - {FIRST_OWN}, {given})"]
    body.append("return False" if signature.return_annotation == "bool" else "return 0")
    return written(declared, body, {"whole": whole, "own": own, **dict(zip(_NAMES, _MODULES, strict=True))})


@_of_the_chosen
def capacity(kind: int, params: Params) -> int:
    """Return the length of the row for a state: at least the longest state, bytes."""
    raise NotImplementedError


@_of_the_chosen
def size(kind: int, state: Row) -> int:
    """Return the length of the encoding in `state`."""
    raise NotImplementedError


@_of_the_chosen
def begin(kind: int, params: Params, rob_id: int, state: Row) -> int:
    """Write the state at boot to `state`; return its length."""
    raise NotImplementedError


@_of_the_chosen
def is_encoding(kind: int, params: Params, rob_id: int, state: Row, length: int) -> bool:
    """Return whether the first `length` bytes are a valid state of this robot; call it for each checkpoint of others.

    The other kernels rely on valid states: with a wrong count they would read and write outside the row.
    """
    raise NotImplementedError


@_of_the_chosen
def on_advice(kind: int, params: Params, rob_id: int, advice: Row, length: int, state: Row) -> int:
    """Handle a planner's advice; return the new length of the encoding, 0 for controllers without advice."""
    raise NotImplementedError


@_of_the_chosen
def on_recv(kind: int, params: Params, rob_id: int, t_ms: int, packet: Row, length: int, state: Row) -> int:
    """Handle a received packet; return the new length of the encoding."""
    raise NotImplementedError


@_of_the_chosen
def on_input(
    kind: int, params: Params, rob_id: int, step: int, t_ms: int, reading: Row, length: int, state: Row, out: Row
) -> int:
    """Handle a reading: write the outputs to `out`, and return their length."""
    raise NotImplementedError
