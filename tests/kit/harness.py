"""Compile a file of kernels by itself, run kernels both ways on the same inputs, and compare to the bit."""

from __future__ import annotations

import copy
import importlib.util
import itertools
import random
import struct
import subprocess
import sys
import sysconfig
import warnings
from collections.abc import Callable
from importlib.machinery import ExtensionFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from phalanx import bundle, kernel
from phalanx.errors import KernelDefect
from phalanx_compiler import unit
from phalanx_compiler.flags import FLAGS
from phalanx_compiler.generate import HERE
from phalanx_compiler.value_types import (
    BOOL,
    F32,
    FLOAT,
    INT,
    NONE,
    U32,
    U64,
    Array,
    Bundle,
    Record,
    Tuple,
    ValueType,
    signature_of,
)

# Less is optimised: tests compile often.
QUICK = [*(each for each in FLAGS if each != "-O3"), "-O2"]
WARNED = [
    "-Wall",
    "-Wextra",
    "-Wno-unused-parameter",
    "-Wno-unused-but-set-variable",
    "-Wno-missing-braces",
    "-Wno-type-limits",
]
INCLUDED = [f"-I{np.get_include()}", f"-I{sysconfig.get_paths()['include']}"]
# What Python raises where a compiled check fails; of floats, C goes on with inf or NaN.
RAISED = (ArithmeticError, IndexError, ValueError, KernelDefect)
_numbers = itertools.count()


def load(text: str, folder: Path, name: str = "given") -> ModuleType:
    """Return the module of a text, from a file of its own."""
    unique = f"{name}_{next(_numbers)}"
    path = folder / f"{unique}.py"
    path.write_text(text)
    spec = importlib.util.spec_from_file_location(unique, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[unique] = module
    spec.loader.exec_module(module)
    return module


def kernels_of(module: ModuleType) -> list[Callable[..., Any]]:
    """Return the kernels that a module defines, in their order."""
    found = [each for each in vars(module).values() if getattr(each, "__kernel__", False)]
    return [each for each in found if each.__module__ == module.__name__]


def c_of(functions: list[Callable[..., Any]]) -> str:
    """Return the C of an extension module with these kernels."""
    written = unit.Unit().text(functions)
    return "\n".join([written, '#define TABLE "{\\"sources\\": {}, \\"slots\\": {}}"', (HERE / "call.c").read_text()])


def build(functions: list[Callable[..., Any]], folder: Path, *flags: str) -> Path:
    """Compile kernels to an extension module in a folder. Raises: CalledProcessError: gcc warned."""
    source = folder / f"kernels_{next(_numbers)}.c"
    source.write_text(c_of(functions))
    target = source.with_name(f"{source.stem}.so")
    compiler = sysconfig.get_config_var("CC").split()[0]
    command = [
        compiler,
        *QUICK,
        *WARNED,
        *INCLUDED,
        "-Werror",
        *flags,
        "-shared",
        "-fPIC",
        source,
        "-o",
        target,
        "-lm",
    ]
    subprocess.run(command, check=True)
    return target


def compiled(functions: list[Callable[..., Any]], folder: Path, *flags: str) -> dict[str, Any]:
    """Return the compiled kernels, by name."""
    return loaded(build(functions, folder, *flags), functions)


def loaded(path: Path, functions: list[Callable[..., Any]]) -> dict[str, Any]:
    """Return the kernels of an extension module, by name."""
    loader = ExtensionFileLoader("_kernels", str(path))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("_kernels", loader))
    loader.exec_module(module)
    module.set_up(kernel._prepare, kernel._raise_violation, kernel._report)
    made = {}
    for function in functions:
        number = module.names[f"{function.__module__}.{function.__name__}"]
        made[function.__name__] = module.kernel(number)
        made[function.__name__].py_func = function
    return made


# --- values ---

INTS = [0, 1, -1, 2, -2, 3, 5, 7, -7, 8, 10, -13, 63, 64, 100, 255, 256, -1000, 65535, 2**31 - 1, -(2**31), 2**40 + 3]
FLOATS = [
    *[
        0.0,
        -0.0,
        1.0,
        -1.0,
        0.5,
        -0.5,
        1.5,
        2.5,
        -2.5,
        3.0,
        7.0,
        1 / 3,
        0.1,
        -0.1,
        1e-300,
        5e-324,
        1e300,
        -1e17,
        2.0**53,
    ],
    *[float("inf"), float("-inf"), float("nan")],
]


def value_of(typ: ValueType, draw: random.Random, name: str = "") -> Any:
    """Return a random value of a type; i, j and k are indices into the arrays made here, n is a length."""
    if typ == INT:
        if name in ("i", "j", "k"):
            return draw.randrange(3)
        return draw.randrange(7) if name == "n" else draw.choice([*INTS, draw.randrange(-100, 100)])
    if typ == FLOAT:
        return draw.choice([*FLOATS, draw.uniform(-10, 10), draw.uniform(-10, 10)])
    if typ == F32:
        return np.float32(draw.choice([0.0, -0.0, 1.0, 0.1, 1 / 3, draw.uniform(-10, 10)]))
    if typ == U32:
        return np.uint32(draw.randrange(1 << 32))
    if typ == U64:
        return np.uint64(draw.choice([0, 1, 2, 1 << 63, draw.randrange(1 << 64)]))
    if typ == BOOL:
        return draw.random() < 0.5
    if isinstance(typ, Array):
        shape = {1: (6,), 2: (3, 4), 3: (3, 3, 4)}[typ.axes]
        return _array_of(typ.dtype, shape, draw)
    if isinstance(typ, Record):
        return _array_of(typ.dtype, (1,), draw)[0]
    if isinstance(typ, Tuple):
        items = [value_of(each, draw) for each in typ.items]
        return typ.cls(*items) if typ.cls else tuple(items)
    assert isinstance(typ, Bundle)
    return typ.cls.__packed__(typ.cls(*(value_of(each, draw) for _, each in typ.places.values())))


def _array_of(dtype: np.dtype[Any], shape: tuple[int, ...], draw: random.Random) -> Any:
    if dtype.names is not None:
        made = np.zeros(shape, np.dtype((np.record, dtype))).view(np.recarray)
        for name in dtype.names:
            part = made[name]
            part[...] = _array_of(part.dtype, part.shape, draw)
        return made
    size = int(np.prod(shape))
    if dtype.kind == "f":
        made = np.array([value_of(FLOAT, draw) for _ in range(size)])
        with np.errstate(all="ignore"):
            return made.astype(dtype).reshape(shape)
    if dtype.kind == "b":
        return np.array([draw.random() < 0.5 for _ in range(size)]).reshape(shape)
    if dtype.itemsize == 8:
        return np.array([draw.randrange(5) for _ in range(size)], dtype).reshape(shape)
    info = np.iinfo(dtype)
    return np.array(
        [draw.choice([0, 1, 2, info.max, draw.randrange(info.min, info.max)]) for _ in range(size)], dtype
    ).reshape(shape)


def duplicate(value: Any) -> Any:
    """Return a copy of an argument with arrays of its own."""
    if isinstance(value, bundle._Packed):
        of = type(value).bundle_class
        return type(value)(of(*(duplicate(getattr(value, name)) for name in of._fields)))
    if isinstance(value, tuple):
        items = [duplicate(each) for each in value]
        return type(value)(*items) if hasattr(value, "_fields") else tuple(items)
    return value.copy() if isinstance(value, np.ndarray) else copy.copy(value)


def bits(value: Any, typ: ValueType) -> Any:
    """Return what is compared: of a float its bits, where all NaN are one; of an array its bytes."""
    if typ == NONE:
        return None
    if typ in (FLOAT, F32):
        number = float(value)
        return "nan" if number != number else struct.pack("d", number)
    if typ == BOOL:
        return bool(value)
    if typ in (INT, U32, U64):
        return int(value) & ((1 << 64) - 1)
    if isinstance(typ, Tuple):
        return tuple(bits(each, of) for each, of in zip(value, typ.items, strict=True))
    if isinstance(typ, Bundle):
        return tuple(bits(getattr(value, name), of) for name, (_, of) in typ.places.items())
    if isinstance(typ, Record):
        return tuple(_bytes_of(np.asarray(value[name])) for name in typ.dtype.names)
    array = np.asarray(value)
    if array.dtype.names:  # without what lies between fields, which numpy copies or not
        return array.shape, tuple(_bytes_of(np.asarray(array[name])) for name in array.dtype.names)
    assert array.dtype == typ.dtype, (array.dtype, typ.dtype)
    return array.shape, _bytes_of(array)


def _bytes_of(array: np.ndarray) -> bytes:
    """Return an array's bytes, where all NaN are one: which operand's bits a sum of two has is the compiler's choice."""
    if array.dtype.kind == "f":
        array = np.where(np.isnan(array), np.array(np.nan, array.dtype), array)
    return array.tobytes()


def outcome(function: Callable[..., Any], arguments: list[Any], plain: Callable[..., Any]) -> Any:
    """Return what a call gives and what it leaves in its arguments, in bits; the exception's class if it raises."""
    parameters, returned = signature_of(plain)
    given = [duplicate(each) for each in arguments]
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            value = function(*given)
    except RAISED as error:
        return type(error)
    after = [bits(each, typ) for each, typ in zip(given, parameters.values(), strict=False)]
    return bits(value, returned), after


def agree(
    made: Callable[..., Any], plain: Callable[..., Any], arguments: list[Any], *, is_made_up: bool = False
) -> bool:
    """Assert that a kernel does the same both ways; return whether it gave a result.

    Of arguments that are made up, Python may give one where a check fails: it counts negative indices from behind.
    """
    expected = outcome(plain, arguments, plain)
    found = outcome(made, arguments, plain)
    if isinstance(expected, type):
        # Of floats, Python raises where C goes on with inf or NaN.
        assert expected is not IndexError or found is KernelDefect, f"{plain.__name__}{arguments}: compiled {found}"
        return False
    if is_made_up and found is KernelDefect:
        return False
    assert found == expected, f"{plain.__name__}{arguments}: {difference(found, expected)}"
    return True


def difference(found: Any, expected: Any, where: str = "") -> str:
    """Return the first place where two outcomes differ."""
    if isinstance(found, tuple | list) and isinstance(expected, tuple | list) and len(found) == len(expected):
        pairs = enumerate(zip(found, expected, strict=True))
        return next(difference(*each, f"{where}[{k}]") for k, each in pairs if each[0] != each[1])
    if isinstance(found, bytes) and isinstance(expected, bytes) and len(found) == len(expected):
        at = next(k for k in range(len(found)) if found[k] != expected[k])
        found, expected, where = found[at : at + 8].hex(), expected[at : at + 8].hex(), f"{where} at byte {at}"
    return f"{where}: compiled {found!r}, in Python {expected!r}"
