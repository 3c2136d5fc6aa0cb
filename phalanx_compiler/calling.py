"""Operations that convert the arguments of calls from Python: one for each value, flattened (call.c)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .value_types import Array, Bundle, Record, Tuple, ValueType, signature_of

Operation = tuple[str, int, int, int, Any]
LETTERS = {"int": "i", "float": "d", "np.float32": "f", "np.uint32": "i", "np.uint64": "u", "bool": "b", "None": "n"}


def operations(function: Callable[..., Any], writes: int) -> tuple[list[Operation], int]:
    """Return the operations of all parameters and of what is returned, and the number of parameters.

    Args:
        writes: bit n is set if the kernel writes to parameter n.
    """
    parameters, returned = signature_of(function)
    made: list[Operation] = []
    for n, typ in enumerate(parameters.values()):
        _add(typ, writes >> n & 1, made)
    _add(returned, 0, made)
    return made, len(parameters)


def _add(typ: ValueType, written: int, made: list[Operation]) -> None:
    if isinstance(typ, Array):
        made.append(("a", typ.axes, written, 0, typ.dtype))
    elif isinstance(typ, Record):
        made.append(("r", 0, written, 0, typ.dtype))
    elif isinstance(typ, Bundle):
        made.append(("p", 0, written, 0, typ.cls.__packed__))
    elif isinstance(typ, Tuple):
        made.append(("(", 0, 0, len(typ.items), typ.cls))
        for item in typ.items:
            _add(item, written, made)
    else:
        made.append((LETTERS[typ.name], 0, 0, 0, None))
