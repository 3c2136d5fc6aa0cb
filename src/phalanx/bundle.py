"""Arrays that kernels take together: one pointer for compiled code, attributes for everybody.

A NamedTuple of arrays works too, but compiled code hands over every array of it at every call: with the simulated
world's sixty that made calls 30 times as slow, and compiling them 12 times. A class of arrays is declared as a
NamedTuple `Queue` with, beside it,

    QueueType, QueueRef = reference(Queue)

    @kernel
    def _refer(queue: Queue) -> Any:
        return QueueRef(*queue)

and `pack(Queue(...), _refer)` is what kernels are given. They, and Python, read its attributes as before.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba
from numba.core import types
from numba.experimental import structref

_T = TypeVar("_T", bound=tuple[Any, ...])
_CONFIG: Any = numba.config


def reference(fields: type[tuple[Any, ...]]) -> tuple[Any, Any]:
    """The type numba knows a class of arrays by, and what makes one in a kernel.

    They must be bound, as `<Name>Type` and `<Name>Ref`, in the module of the class: compiled code on disk names them.
    """
    name, module = fields.__name__, fields.__module__

    def preprocess_fields(_: Any, pairs: Any) -> Any:
        return tuple((field, types.unliteral(kind)) for field, kind in pairs)  # type: ignore[no-untyped-call]

    made_type = type(f"{name}Type", (types.StructRef,), {"__module__": module, "preprocess_fields": preprocess_fields})
    structref.register(made_type)  # type: ignore[no-untyped-call]
    made_ref = type(f"{name}Ref", (structref.StructRefProxy,), {"__module__": module})
    structref.define_proxy(made_ref, made_type, list(fields._fields))  # type: ignore[attr-defined,no-untyped-call]
    return made_type, made_ref


def pack(bundle: _T, refer: Callable[[_T], Any]) -> _T:
    """The bundle as kernels take it, with the same attributes; uncompiled it is the bundle itself."""
    if _CONFIG.DISABLE_JIT:
        return bundle
    packed = refer(bundle)
    packed.__dict__.update(bundle._asdict())  # type: ignore[attr-defined]
    result: _T = packed
    return result
