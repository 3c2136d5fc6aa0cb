"""Bundles: many arrays passed to a kernel by one address, and read as attributes in Python and in kernels.

A class of arrays is declared as a NamedTuple `Queue` with, beside it,

    pack = bundled(Queue)

and kernels are called with `pack(Queue(...))`. The caller keeps the bundle alive. Fields are arrays in C order,
numbers, tuples of numbers or bundles, as annotated. Elements of arrays may change, fields may not.
A bundle with a read-only array can be passed only to kernels that write to none of its arrays.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, ClassVar, TypeVar

import numpy as np

from phalanx_compiler.value_types import BOOL, FLOAT, INT, Array, Bundle, Tuple, ValueType, fields_of, named

from .kernel import PURE

_T = TypeVar("_T", bound=tuple[Any, ...])


class _Packed:
    """A bundle packed for kernels; each class of bundles has one subclass."""

    bundle_class: ClassVar[Any]
    _address: int
    _read_only: str

    def __init__(self, bundle: Any) -> None:
        words = [word for name in bundle._fields for word in _words_of(getattr(bundle, name))]
        read_only = _read_only_in(bundle)
        kept = np.array([bool(read_only), *words], np.int64)
        self.__dict__.update(bundle._asdict(), _kept=kept, _address=kept[1:].ctypes.data, _read_only=read_only)
        # With a second reference to each array, numpy refuses to resize it.
        self.__dict__["_fields_kept"] = tuple(bundle)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the fields instead of their addresses, which are valid in this process only."""
        cls: Any = type(self).bundle_class
        return _repacked, (cls(*(getattr(self, name) for name in cls._fields)),)

    def __setattr__(self, name: str, _: Any) -> None:
        raise AttributeError(f"{type(self).__name__}.{name}: a bundle's fields are read-only")


def _repacked(bundle: Any) -> Any:
    """Return an unpickled bundle, packed if kernels are compiled in this process."""
    return bundle if PURE else type(bundle).__packed__(bundle)


def _read_only_in(bundle: Any) -> str:
    """Return the name of the first read-only array in a bundle, or "" if there is none."""
    for name in bundle._fields:
        value = getattr(bundle, name)
        if isinstance(value, np.ndarray) and not value.flags.writeable:
            return f"{type(bundle).__name__}.{name}"
        if isinstance(value, _Packed) and value._read_only:  # noqa: SLF001
            return value._read_only  # noqa: SLF001
    return ""


def _words_of(value: Any) -> list[int]:
    """Return the 64-bit words that store a field: addresses, lengths and numbers."""
    if isinstance(value, np.ndarray):
        return [value.ctypes.data, *value.shape]
    if isinstance(value, _Packed):
        return [value._address]  # noqa: SLF001
    if isinstance(value, tuple):
        return [word for each in value for word in _words_of(each)]
    return [struct.unpack("q", struct.pack("d", value))[0] if isinstance(value, float) else int(value)]


def _is_number(value: Any, typ: ValueType) -> bool:
    """Return True if a value is a number of this type that fits into a 64-bit word of a bundle."""
    return typ in (INT, FLOAT, BOOL) and isinstance(value, float) == (typ == FLOAT)


def _check(bundle: Any) -> None:
    """Check the fields of a bundle. Raises: TypeError: a field does not match its annotation."""
    cls: Any = type(bundle)
    for name, typ in fields_of(cls):
        value = getattr(bundle, name)
        if isinstance(typ, Array):
            fits = isinstance(value, np.ndarray) and value.dtype == typ.dtype and value.ndim == typ.axes
            fits = fits and value.flags.c_contiguous and value.flags.aligned
        elif isinstance(typ, Bundle):
            fits = isinstance(value, typ.cls.__packed__)
        elif isinstance(typ, Tuple):
            fits = isinstance(value, tuple) and len(value) == len(typ.items)
            fits = fits and all(map(_is_number, value, typ.items))
        else:
            fits = _is_number(value, typ)
        if not fits:
            raise TypeError(f"{type(bundle).__name__}.{name}: expected {named(typ)} in C order")


def bundled(fields: type[_T]) -> Callable[[_T], _T]:
    """Return a function that packs a bundle for compiled kernels, and returns it unchanged for uncompiled ones."""
    packed_class: Any = type(fields.__name__, (_Packed,), {"__module__": fields.__module__, "bundle_class": fields})
    fields.__bundled__, fields.__packed__ = True, packed_class  # type: ignore[attr-defined]

    def pack(bundle: _T) -> _T:
        if PURE:
            return bundle
        _check(bundle)
        packed: _T = packed_class(bundle)
        return packed

    return pack
