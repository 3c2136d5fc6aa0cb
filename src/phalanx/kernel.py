"""Mark kernels, load their compiled functions, and run them as Python with PHALANX_PURE=1.

An auditor detects a compromised robot by running its controller again and comparing bytes. The bytes must be equal on
every machine, or auditors would reject honest robots. Simulated swarms replay so many logs that plain Python would take
hours for minutes of a run. So everything that robots run is written once, in a typed subset of Python
(docs/reference/kernels.md) that is translated to C when the package is built. With PHALANX_PURE=1 all kernels run
uncompiled, for a debugger and as the oracle of tests; `kernel.py_func` is the uncompiled function of one kernel.

Rules for kernels that auditors replay: float64 with + - * / and `math.sqrt` in a written order. No other function of
`math`, no sum over an array, and no division by a number that can be zero.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import logging
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from phalanx_compiler.calling import operations
from phalanx_compiler.sources import DECLARED
from phalanx_compiler.violations import IN_OWN, RAISED, message

from . import binary
from .errors import Defective, KernelDefect, OwnDefect, Unavailable

_F = TypeVar("_F", bound=Callable[..., Any])
logger = logging.getLogger(__name__)
# True if kernels run as Python.
PURE = binary.is_pure()
_BUILDING = os.environ.get("PHALANX_PURE") == "build"
# Hints for failed checks: in the package's kernels, and in a user's file.
PACKAGE_DEFECT = "a defect of Phalanx: please report it"
FILE_DEFECT = "fix this file: its kernels must not do that"
# Addresses of C functions that kernels call, by their symbols.
ADDRESSES: dict[str, int] = {}

_compiled: Any = None
_table: dict[str, dict[str, Any]] = {"sources": {}, "slots": {}}
if not PURE:
    _compiled, _table = binary.load_binary()


def _prepare(compiled: Any) -> None:
    """Set the conversions of a kernel's arguments from its annotations; called at its first call."""
    function = compiled.py_func
    made, parameters = operations(function, compiled.entry[1])
    names = function.__code__.co_varnames[:parameters]
    compiled.prepare(made, names, function.__defaults__ or (), parameters)


def _violation(file: str, line: int, what: int, index: int, size: int) -> BaseException:
    """Return the exception for a check that failed in compiled code."""
    if what == RAISED:
        return _raised.pop(index, None) or OwnDefect(f"{file}:{line}: an exception", FILE_DEFECT)
    text = f"{file}:{line}: {message(what, index, size)}"
    return OwnDefect(text, FILE_DEFECT) if what >= IN_OWN else KernelDefect(text, PACKAGE_DEFECT)


def _raise_violation(file: str, line: int, what: int, index: int, size: int) -> None:
    raise _violation(file, line, what, index, size)


def _report(file: str, line: int, what: int, index: int, size: int, times: int = 1) -> None:
    error = _violation(file, line, what, index, size)
    if not isinstance(error, KernelDefect):  # Ctrl-C, while a user's file ran uncompiled
        raise error
    _log(error, times)


def _log(error: KernelDefect, times: int = 1) -> None:
    which = "the peer's message was" if times == 1 else f"{times} messages of peers were"
    logger.error("%s: %s; %s rejected", error, error.hint, which)


# Exceptions of users' kernels that run uncompiled, kept until compiled code has unwound.
_raised: dict[int, BaseException] = {}
MOST_RAISED = 64


def keep_raised(error: BaseException) -> int:
    """Store an exception and return the number by which compiled code passes it on, as the violation `RAISED`."""
    number = max(_raised, default=0) + 1
    _raised[number] = error
    _raised.pop(number - MOST_RAISED, None)
    return number


if _compiled:
    _compiled.set_up(_prepare, _raise_violation, _report)


def reads_peer(*, rejected: int) -> Callable[[_F], _F]:
    """Return a decorator, placed below `@kernel`, for a kernel that reads a peer's bytes.

    If a check fails, the kernel returns `rejected`, and the defect is logged: a peer's bytes never stop a robot.
    """

    def mark(function: _F) -> _F:
        function.__rejected__ = rejected  # type: ignore[attr-defined]
        return function

    return mark


@contextlib.contextmanager
def reading_peer() -> Iterator[None]:
    """Context for reading a peer's bytes with kernels that have no `reads_peer`.

    Raises: Defective: a kernel's check failed; the defect is logged.
    """
    try:
        yield
    except KernelDefect as error:
        _log(error)
        raise Defective(str(error)) from error


def _guarded(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return an uncompiled kernel with `reads_peer`, wrapped to return `rejected` if it fails."""

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        try:
            return function(*arguments)
        except OwnDefect as error:
            _log(error)
            return function.__rejected__  # type: ignore[attr-defined]
        except (IndexError, ValueError, ZeroDivisionError, OverflowError, KernelDefect):
            logger.exception("a defect of Phalanx, please report it; the peer's message was rejected")
            return function.__rejected__  # type: ignore[attr-defined]

    call.py_func = function  # type: ignore[attr-defined]
    return call


def kernel(function: _F) -> _F:
    """Return the compiled function of a kernel, or the function itself if it is not compiled."""
    function.__kernel__ = True  # type: ignore[attr-defined]
    if _compiled is None:
        DECLARED.append(function)
        if hasattr(function, "__rejected__") and not _BUILDING:
            guarded: Any = _guarded(function)
            return guarded  # type: ignore[no-any-return]
        return function
    number = _compiled.names.get(f"{function.__module__}.{function.__name__}")
    if number is None:
        if Path(function.__code__.co_filename).is_relative_to(binary.ROOT):
            raise Unavailable(f"the compiled kernels have no {function.__module__}.{function.__name__}", binary.HINT)
        return function
    made: Any = _compiled.kernel(number)
    made.py_func = made.__wrapped__ = function
    made.__name__, made.__doc__, made.__module__ = function.__name__, function.__doc__, function.__module__
    result: _F = made
    return result


def intrinsic(name: str) -> Callable[[_F], _F]:
    """Return a decorator for a function that the compiler implements under this name; uncompiled it runs as written."""

    def mark(function: _F) -> _F:
        function.__intrinsic__ = name  # type: ignore[attr-defined]
        return function

    return mark


@dataclass(frozen=True, slots=True)
class Linked:
    """Declaration of a kernel in another library: compiled code takes its address from a table that `link` sets.

    Attributes:
        symbol: C symbol of the table.
        most: number of addresses in the table.
        writes: names of the parameters that the kernel writes to.
    """

    symbol: str
    most: int
    writes: tuple[str, ...]


def linked(declared: _F, how: Linked, called: Callable[..., Any]) -> _F:
    """Return a kernel that another library implements; the first parameter of `declared` is its index in the table.

    Args:
        called: the function to call uncompiled.
    """
    declared.__kernel__, declared.__linked__ = True, how  # type: ignore[attr-defined]

    @functools.wraps(declared)
    def call(*arguments: Any) -> Any:
        return called(*arguments)

    call.py_func = declared  # type: ignore[attr-defined]
    result: Any = call
    return result  # type: ignore[no-any-return]


def link(symbol: str, address: int) -> None:
    """Set the address of a C function that kernels call, or of a table of such functions."""
    ADDRESSES[symbol] = address
    if symbol in _table["slots"]:
        _compiled.link(_table["slots"][symbol], address)


def written(declared: _F, body: list[str], scope: dict[str, Any]) -> _F:
    """Return a kernel with the signature of `declared` and the source lines `body`; `scope` defines their names."""
    lines = [f"def {declared.__name__}({', '.join(inspect.signature(declared).parameters)}):", *body]
    names = {**declared.__globals__, **scope}
    exec(compile("\n    ".join(lines), declared.__code__.co_filename, "exec"), names)  # noqa: S102 - declarations of ours
    made = names[declared.__name__]
    made.__annotations__, made.__doc__ = declared.__annotations__, declared.__doc__
    made.__module__, made.__kernel_body__, made.__kernel_line__ = (
        declared.__module__,
        body,
        declared.__code__.co_firstlineno,
    )
    result: _F = kernel(made)
    return result
