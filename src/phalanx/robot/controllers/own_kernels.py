"""Users' controllers written as kernels, compiled on loading.

The user's file has a `CONTROLLER` and kernels (declaration.py). The machine's C compiler compiles them into the user's
cache, and dispatch.py calls them by address. Without a compiler, compiled code calls back into Python; with
PHALANX_PURE=1 everything runs in Python.
"""

from __future__ import annotations

import ctypes
import hashlib
import inspect
import logging
import traceback
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from phalanx import __version__
from phalanx.arrays import Params
from phalanx.binary import INSTALL_COMPILER
from phalanx.config.flock import FlockConfig
from phalanx.errors import KernelDefect, OutsideSubset, OwnDefect, Unavailable, UsageError
from phalanx.kernel import ADDRESSES, FILE_DEFECT, PURE, keep_raised, kernel
from phalanx.wire.fields import OUTPUT_HEAD_BYTES, OUTPUT_LENGTH, Row, get_u16
from phalanx.wire.record import Record
from phalanx.wire.table import ENTRY_ACMD, ENTRY_SEND, KIND_AUDIT, PACKET_MAX
from phalanx_compiler.errors import SubsetError
from phalanx_compiler.library import NoCompiler, UnsafeCache, library_of
from phalanx_compiler.own import Own, line_of, source_of_own
from phalanx_compiler.parsing import shown_path, uncompiled
from phalanx_compiler.value_types import BOOL, FLOAT, INT, Array, ValueType, signature_of
from phalanx_compiler.violations import MESSAGES, RAISED
from phalanx_compiler.writes import writes_of

from . import dispatch
from .declaration import Declaration

ROOT = Path(__file__).resolve().parents[2]
MOST_STATE_BYTES = 65_535
logger = logging.getLogger(__name__)
# Numbers of loaded controllers by the hash of their C text, so that an unchanged file keeps its number.
_loaded: dict[str, int] = {}
# Declaration and number of each version of a file, by its path and content hash.
_files: dict[tuple[Path, bytes], tuple[Declaration, int]] = {}
# Keeps objects alive whose addresses compiled code uses.
_kept: list[Any] = []


# --- checks of kernels' results ---


@kernel
def is_capacity(returned: int) -> bool:
    """Return whether the result of `capacity` is in range."""
    return 0 <= returned <= MOST_STATE_BYTES


@kernel
def is_length(returned: int, state: Row) -> bool:
    """Return whether a length fits into a row."""
    return 0 <= returned <= len(state)


@kernel
def are_outputs(returned: int, out: Row, command_bytes: int, command_kind: int) -> bool:
    """Return whether `out[:returned]` is valid: commands of the body, then packets, none of them an AUDIT packet."""
    if returned < 0 or returned > len(out):
        return False
    at, has_sent = 0, False
    while at < returned:
        if at + OUTPUT_HEAD_BYTES > returned:
            return False
        size = get_u16(out, at + OUTPUT_LENGTH)
        begin = at + OUTPUT_HEAD_BYTES
        if size < 1 or size > PACKET_MAX or begin + size > returned:
            return False
        if out[at] == ENTRY_ACMD:
            if has_sent or size != command_bytes or out[begin] != command_kind:
                return False
        elif out[at] != ENTRY_SEND or int(out[begin]) & KIND_AUDIT != 0:
            return False
        else:
            has_sent = True
        at = begin + size
    return True


@kernel
def _no_advice(_params: Params, _rob_id: int, _advice: Row, _length: int, _state: Row) -> int:
    return 0


# --- loading ---


def is_loaded(words: str, path: Path) -> bool:
    """Return whether the current content of a file was loaded; if so, register `words` as its name."""
    found = _files.get(_content_of(path)) if path.is_file() else None
    if found:
        dispatch.register_own_name(words, *found)
    return found is not None


def _content_of(path: Path) -> tuple[Path, bytes]:
    return path.resolve(), hashlib.sha256(path.read_bytes()).digest()


def load_kernels(words: str, module: ModuleType) -> None:
    """Load the controller of a module, which was imported from its file, under the name `words`.

    Raises: UsageError: a kernel is missing or has wrong arguments, or the cache is unsafe. OutsideSubset: a kernel
    cannot be compiled. Unavailable: the cache cannot be written.
    """
    file = str(module.__file__)
    declaration = _checked(words, module.CONTROLLER)
    kernels = _kernels_of(words, module, declaration)
    try:
        text, slots = source_of_own(kernels, file, ROOT)
        for name, own in kernels.items():
            _check_writes(name, own.function)
    except SubsetError as error:
        raise OutsideSubset(f"{error.file}:{error.line}: {error.what}", error.instead) from error
    key = hashlib.sha256(text.encode()).hexdigest()
    if key not in _loaded:
        plain = {name: _plain(own, file) for name, own in kernels.items()}
        _loaded[key] = dispatch.add_own(plain, {} if PURE else _addresses(words, text, slots, plain))
    dispatch.register_own_name(words, declaration, _loaded[key])
    _files[_content_of(Path(file))] = declaration, _loaded[key]


def _checked(words: str, declared: Declaration) -> Declaration:
    """Check a declaration, and return it with `params` converted to the array that kernels take."""
    if declared.config is not FlockConfig:
        raise UsageError(
            f"config of CONTROLLER in {words} is {declared.config.__name__}", "use FlockConfig, or no config"
        )
    layouts = {"reads": declared.reads, "commands": declared.commands, "says": declared.says}
    for name, layout in layouts.items():
        if not isinstance(layout, Record):
            raise UsageError(f"{name} of CONTROLLER in {words} is {layout!r}", "use a record of phalanx.wire.table")
    return replace(declared, params=lambda config: np.array(declared.params(config), np.float64).reshape(-1))


def _kernels_of(words: str, module: ModuleType, declared: Declaration) -> dict[str, Own]:
    """Return the kernels with the checks of their results. Raises: UsageError: a kernel has another signature."""
    found: dict[str, Own] = {}
    for name, of in dispatch.DECLARED.items():
        function = getattr(module, name, None)
        if function is None and name == "on_advice" and declared.advised is None:
            function = _no_advice
        _check_kernel(words, name, of, function)
        function = uncompiled(function)
        parameters = list(inspect.signature(of).parameters)[1:]
        row = next((parameters.index(each) for each in ("out", "state") if each in parameters), None)
        if name == "on_input":
            numbers = declared.commands.size, int(declared.commands.tag or 0)
            found[name] = Own(function, uncompiled(are_outputs), row, numbers, "BAD_OUTPUTS")
        elif name == "is_encoding":
            found[name] = Own(function)
        elif row is None:
            found[name] = Own(function, uncompiled(is_capacity), violation="BAD_CAPACITY")
        else:
            found[name] = Own(function, uncompiled(is_length), row, violation="BAD_LENGTH")
    return found


def _check_kernel(words: str, name: str, declared: Callable[..., Any], found: Any) -> None:
    """Check a kernel's signature. Raises: UsageError: not a kernel, or its signature differs from `declared`."""
    function = uncompiled(found)
    head = f"def {name}{inspect.signature(declared)}".replace("kind: 'int', ", "").replace("'", "")
    if not getattr(function, "__kernel__", False):
        what = "function" if function is None else "kernel"
        raise UsageError(f"{words} has no {what} {name}", f"write @kernel above {head}")
    wanted, wanted_returned = signature_of(declared)
    try:
        types, returned = signature_of(function)
    except TypeError as error:
        raise UsageError(f"{words}:{line_of(function)}: {name}: {error}", head) from error
    if [*types.values(), returned] != [*list(wanted.values())[1:], wanted_returned]:
        raise UsageError(f"{words}:{line_of(function)}: {name} has another signature", f"write {head}")


def _check_writes(name: str, function: Callable[..., Any]) -> None:
    """Check that a kernel writes only to its outputs. Raises: SubsetError: it writes to a read-only parameter."""
    declared = list(inspect.signature(dispatch.DECLARED[name]).parameters)[1:]
    lines = writes_of(function)
    for parameter, meant in zip(inspect.signature(function).parameters, declared, strict=True):
        if parameter in lines and meant not in dispatch.WRITTEN.get(name, ()):
            file = shown_path(function.__code__.co_filename)
            raise SubsetError(file, lines[parameter], f"{name} writes to {parameter}", "read it, or write to a copy")


# --- uncompiled ---


def _plain(own: Own, file: str) -> Callable[..., Any]:
    """Return a kernel that runs in Python, and raises `OwnDefect` with file and line for any error."""
    function, check, rows = own.function, own.check, () if own.row is None else (own.row,)

    def call(*arguments: Any) -> Any:
        try:
            returned = function(*arguments)
            if check is None:
                return bool(returned)
            fits = check(int(returned), *(arguments[row] for row in rows), *own.numbers)
        except Exception as error:
            raise _defect(error, file, line_of(function)) from error
        if not fits:
            message = MESSAGES[own.violation].format(returned, *(len(arguments[row]) for row in rows))
            raise OwnDefect(f"{shown_path(file)}:{line_of(function)}: {message}", FILE_DEFECT)
        return int(returned)

    return call


def _defect(error: Exception, file: str, line: int) -> OwnDefect:
    """Return an exception as compiled code would report it, with the last line outside this package."""
    frames = list(traceback.extract_tb(error.__traceback__))
    frames = [each for each in frames if not Path(each.filename).is_relative_to(ROOT)]
    if frames:
        file, line = frames[-1].filename, frames[-1].lineno or line
    message = f"{type(error).__name__}: {error}"
    if isinstance(error, KernelDefect):  # the user's code called a kernel of this package with wrong arguments
        message = str(error).partition(": ")[2]
    return OwnDefect(f"{shown_path(file)}:{line}: {message}".splitlines()[0], FILE_DEFECT)


# --- compiled, or called from compiled code ---


class _Row(ctypes.Structure):
    """One-dimensional array of compiled code (runtime.h)."""

    _fields_ = (("p", ctypes.c_void_p), ("n0", ctypes.c_int64))


class _Fault(ctypes.Structure):
    """Violation record of compiled code (runtime.h)."""

    _fields_ = (
        ("file", ctypes.c_char_p),
        ("line", ctypes.c_int32),
        ("what", ctypes.c_int32),
        ("index", ctypes.c_int64),
        ("size", ctypes.c_int64),
    )


C_TYPES: dict[ValueType, Any] = {INT: ctypes.c_int64, FLOAT: ctypes.c_double, BOOL: ctypes.c_bool}


def _addresses(
    words: str, text: str, slots: Mapping[str, int], plain: Mapping[str, Callable[..., Any]]
) -> dict[str, int]:
    """Return the addresses of a controller's kernels, or of callbacks into Python if there is no compiler."""
    try:
        library = _library(text)
    except NoCompiler as error:
        logger.warning("%s runs uncompiled, many times slower: %s; %s", words, error, INSTALL_COMPILER)
        return {name: _callback(name, function) for name, function in plain.items()}
    except UnsafeCache as error:
        message = f"{error}: other users could have written the compiled code there"
        raise UsageError(message, "move it, run chmod go-w, or set XDG_CACHE_HOME to another folder") from error
    except (OSError, RuntimeError) as error:
        message = f"{words} cannot be compiled into the cache: {error}"
        raise Unavailable(message, "set XDG_CACHE_HOME to a writable folder") from error
    _kept.append(library)
    library.own_linked.restype = ctypes.POINTER(ctypes.c_void_p)
    for symbol, slot in slots.items():
        library.own_linked()[slot] = ADDRESSES[symbol]
    return {name: ctypes.cast(library[f"own_{name}"], ctypes.c_void_p).value or 0 for name in plain}


def _library(text: str) -> ctypes.CDLL:
    """Return the loaded library of a C text. Raises: NoCompiler, UnsafeCache, OSError."""
    path = library_of(text, __version__)
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:  # truncated because of a full disk or a crash
        logger.warning("cannot load the compiled controller, compiling it again: %s", error)
        path.unlink(missing_ok=True)
        return ctypes.CDLL(str(library_of(text, __version__)))


def _callback(name: str, function: Callable[..., Any]) -> int:
    """Return the address of a C callback that calls a Python function."""
    parameters, returned = signature_of(dispatch.DECLARED[name])
    types = list(parameters.values())[1:]

    def called(*arguments: Any) -> Any:
        try:
            return function(*(_in_python(typ, each) for typ, each in zip(types, arguments, strict=False)))
        except BaseException as error:  # noqa: BLE001 - the caller of the compiled code raises it again
            fault = arguments[-1][0]
            fault.file, fault.line, fault.what, fault.index = b"a user's file", 0, RAISED, keep_raised(error)
            return 0

    c_types = [_Row if isinstance(typ, Array) else C_TYPES[typ] for typ in types]
    made = ctypes.CFUNCTYPE(C_TYPES[returned], *c_types, ctypes.POINTER(_Fault))(called)
    _kept.append(made)
    return ctypes.cast(made, ctypes.c_void_p).value or 0


def _in_python(typ: ValueType, value: Any) -> Any:
    """Convert an argument from compiled code for a kernel in Python."""
    if not isinstance(typ, Array):
        return value
    if value.n0 == 0:
        return np.zeros(0, typ.dtype)
    raw = (ctypes.c_char * (value.n0 * typ.dtype.itemsize)).from_address(value.p)
    return np.frombuffer(raw, typ.dtype)
