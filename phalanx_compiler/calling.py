"""How calls from Python hand over arguments: one operation for each value, flattened (call.c)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .kinds import Array, Bundle, Kind, Record, Tuple, signature_of

Operation = tuple[str, int, int, int, Any]
LETTERS = {"int": "i", "float": "d", "np.float32": "f", "np.uint32": "i", "np.uint64": "u", "bool": "b", "None": "n"}


def operations(function: Callable[..., Any], writes: int) -> tuple[list[Operation], int]:
    """Return the operations of all parameters and of what is returned, and the number of parameters.

    Args:
        writes: bit n is set if the kernel writes to parameter n.
    """
    parameters, returned = signature_of(function)
    made: list[Operation] = []
    for n, kind in enumerate(parameters.values()):
        _add(kind, writes >> n & 1, made)
    _add(returned, 0, made)
    return made, len(parameters)


def _add(kind: Kind, written: int, made: list[Operation]) -> None:
    if isinstance(kind, Array):
        made.append(("a", kind.axes, written, 0, kind.dtype))
    elif isinstance(kind, Record):
        made.append(("r", 0, written, 0, kind.dtype))
    elif isinstance(kind, Bundle):
        made.append(("p", 0, 0, 0, kind.cls.__packed__))
    elif isinstance(kind, Tuple):
        made.append(("(", 0, 0, len(kind.items), kind.cls))
        for item in kind.items:
            _add(item, written, made)
    else:
        made.append((LETTERS[kind.name], 0, 0, 0, None))
