"""Arrays that kernels take together: one pointer for compiled code, attributes for everybody.

A NamedTuple of arrays works too, but compiled code hands over every array of it at every call: with the simulated
world's sixty that made calls 30 times as slow, and compiling them 12 times. A class of arrays is declared as a
NamedTuple `Queue` with, beside it,

    QueueType, QueueRef, pack = reference(Queue)

and `pack(Queue(...))` is what kernels are given. They, and Python, read its attributes as before.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FunctionType
from typing import Any, TypeVar

import numba
from numba.core import types
from numba.experimental import structref

from .kernel import kernel

_T = TypeVar("_T", bound=tuple[Any, ...])
_CONFIG: Any = numba.config
REF: Any = None  # of each class its own, where `_refer` is compiled


def _refer(bundle: tuple[Any, ...]) -> Any:
    return REF(*bundle)


def reference(fields: type[_T]) -> tuple[Any, Any, Callable[[_T], _T]]:
    """The type numba knows a class of arrays by, what makes one in a kernel, and what makes one of a bundle.

    Uncompiled, that is the bundle itself. The first two must be bound, as `<Name>Type` and `<Name>Ref`, in the module
    of the class: compiled code on disk names them.
    """
    name, module = fields.__name__, fields.__module__

    def preprocess_fields(_: Any, pairs: Any) -> Any:
        return tuple((field, types.unliteral(kind)) for field, kind in pairs)  # type: ignore[no-untyped-call]

    made_type = type(f"{name}Type", (types.StructRef,), {"__module__": module, "preprocess_fields": preprocess_fields})
    structref.register(made_type)  # type: ignore[no-untyped-call]
    made_ref = type(f"{name}Ref", (structref.StructRefProxy,), {"__module__": module})
    structref.define_proxy(made_ref, made_type, list(fields._fields))  # type: ignore[attr-defined,no-untyped-call]
    # In the file of the class: what is compiled is kept beside it, until it changes.
    file = str(sys.modules[module].__file__)
    code = _refer.__code__.replace(co_filename=file, co_qualname=f"_refer_{name}")
    refer: Any = kernel(FunctionType(code, {"REF": made_ref, "__name__": module}))

    def pack(bundle: _T) -> _T:
        if _CONFIG.DISABLE_JIT:
            return bundle
        packed = refer(bundle)
        packed.__dict__.update(bundle._asdict())  # type: ignore[attr-defined]
        result: _T = packed
        return result

    return made_type, made_ref, pack
