"""Arrays that kernels take together: one address for compiled code, attributes for everybody.

A NamedTuple of arrays works too, but compiled code hands over every array of it at every call: with the simulated
world's sixty that made calls 30 times as slow, and compiling them 12 times. numba's own records of arrays (structref)
count who refers to each array, each time that one is touched: a third of a simulation's time. A class of arrays is
declared as a NamedTuple `Queue` with, beside it,

    pack = bundled(Queue)

and `pack(Queue(...))` is what kernels are given. They, and Python, read its attributes as before. Kernels only borrow
it: whoever calls one keeps the bundle. Fields are arrays in C order, numbers, tuples of numbers, and bundles; which
arrays, never changes, but what is in them does.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numpy as np
from llvmlite import ir as llvm
from numba import extending
from numba import types as numba_types

try:
    from numba.core.typing.templates import AttributeTemplate
    from numba.np import arrayobj as numba_arrays
except ImportError:  # a numba that is another inside: bundles are NamedTuples, which it knows, and calls are slow
    numba_arrays = None  # type: ignore[assignment]

_T = TypeVar("_T", bound=tuple[Any, ...])
# Untyped, all of it.
types: Any = numba_types
arrayobj: Any = numba_arrays
numba_: Any = numba
extend: Any = extending
ir: Any = llvm
_WORD = ir.IntType(64)


class BundleType(numba_types.Type):
    """What numba knows a bundle by: its fields' types, and the first 8-byte word of each."""

    def __init__(self, name: str, fields: tuple[tuple[str, Any], ...]) -> None:
        self.kinds, self.places, at = dict(fields), {}, 0
        for field, kind in fields:
            self.places[field] = at
            at += _words(kind)
        # Not the fields' own names: those of all arrays of a world would be part of the name of every kernel.
        super().__init__(f"{name}.{hashlib.sha256(repr(fields).encode()).hexdigest()[:12]}")


def _words(kind: Any) -> int:
    if isinstance(kind, types.Array):
        return 1 + int(kind.ndim)
    return len(kind) if isinstance(kind, types.BaseTuple) else 1


extend.register_model(BundleType)(extend.models.OpaqueModel)


if arrayobj:

    @extend.infer_getattr
    class _Attributes(AttributeTemplate):
        key = BundleType

        def generic_resolve(self, bundle: BundleType, name: str) -> Any:  # type: ignore[override]
            return bundle.kinds.get(name)


@extend.lower_getattr_generic(BundleType)  # type: ignore[untyped-decorator]
def _get(context: Any, builder: Any, bundle: BundleType, address: Any, name: str) -> Any:
    kind, place = bundle.kinds[name], bundle.places[name]
    words = builder.bitcast(address, _WORD.as_pointer())

    def word(k: int) -> Any:
        loaded = builder.load(builder.gep(words, [_WORD(place + k)]))
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
        return loaded

    def number(kind: Any, k: int) -> Any:
        return builder.bitcast(word(k), ir.DoubleType()) if kind == types.float64 else word(k)

    if isinstance(kind, BundleType):
        return builder.inttoptr(word(0), address.type)
    if isinstance(kind, types.BaseTuple):
        return context.make_tuple(builder, kind, [number(each, k) for k, each in enumerate(kind.types)])
    if not isinstance(kind, types.Array):
        return number(kind, 0)
    array = arrayobj.make_array(kind)(context, builder)
    shape = [word(1 + k) for k in range(kind.ndim)]
    itemsize = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    strides = [_WORD(itemsize)]
    for size in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], size, flags=["nsw"]))
    data = builder.inttoptr(word(0), context.get_data_type(kind.dtype).as_pointer())
    arrayobj.populate_array(array, data, shape, strides, itemsize, meminfo=None)  # nobody's: nothing is counted
    return array._getvalue()  # noqa: SLF001


@extend.unbox(BundleType)  # type: ignore[untyped-decorator]
def _address(_: BundleType, packed: Any, compiled: Any) -> Any:
    number = compiled.pyapi.object_getattr_string(packed, "_address")
    address = compiled.pyapi.long_as_voidptr(number)
    compiled.pyapi.decref(number)
    return extend.NativeValue(address)


class _Packed:
    """A bundle as kernels take it."""

    def __init__(self, bundle: Any, kind: BundleType) -> None:
        words = [word for name in bundle._fields for word in _told(getattr(bundle, name))]
        self.__dict__.update(bundle._asdict())
        self._kept = np.array(words, np.int64)
        self._address = self._kept.ctypes.data
        self._numba_type_ = kind


def _told(value: Any) -> list[int]:
    if isinstance(value, np.ndarray):
        return [value.ctypes.data, *value.shape]
    if isinstance(value, _Packed):
        return [value._address]  # noqa: SLF001
    if isinstance(value, tuple):
        return [word for each in value for word in _told(each)]
    return [struct.unpack("q", struct.pack("d", value))[0] if isinstance(value, float) else int(value)]


def bundled(fields: type[_T]) -> Callable[[_T], _T]:
    """What makes of a bundle the one that kernels take; uncompiled, or by an unknown numba, that is itself."""
    name = f"{fields.__module__}.{fields.__name__}"

    def pack(bundle: _T) -> _T:
        if numba_.config.DISABLE_JIT or not arrayobj:
            return bundle
        kinds = tuple(
            (field, types.unliteral(numba_.typeof(value)))
            for field, value in zip(fields._fields, bundle, strict=True)  # type: ignore[attr-defined]
        )
        assert all(kind.layout == "C" for _, kind in kinds if isinstance(kind, types.Array)), f"{name}: not in C order"
        packed: Any = _Packed(bundle, BundleType(name, kinds))
        result: _T = packed
        return result

    return pack
