"""`@kernel`: a function that runs compiled over one robot's bytes and numbers, and gives the same bytes uncompiled.

An auditor catches a liar by running its controller again and comparing bytes. That must give the same everywhere, or an
honest robot on another machine would be convicted; and a simulated fleet does it so often that plain Python would take
hours for minutes. So whatever robots run is written once, as a scalar function in the subset of Python that numba
compiles: fleets loop over robots inside compiled code, and `kernel.py_func` is the same function uncompiled, as are all
of them with NUMBA_DISABLE_JIT=1, for a debugger. The first call compiles, which takes seconds and is kept on disk;
`make setup` makes the first calls.

Rules a kernel lives by, so that both (and any two machines) agree to the bit: float64 with + - * / and `math.sqrt` in a
written order; no other function of `math`, no sum over an array, no division by what can be zero, no dict and no set.
Compiled, a quotient may be made in another way that gives the same bits (robot/controllers/sine.py).
Many arrays go to kernels together (bundle.py).

To keep what is compiled we reach into numba, which promises nobody to stay as it is inside. Where it is not what we
know, kernels are compiled at each start, and all else is the same; so it is in `bundle`, `memory` and `sim.compiling`.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import inspect
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba import types

try:
    from numba.core import caching, cgutils  # noqa: F401  # without it memory.py makes arrays, which have to be counted
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.options import DefaultOptions
    from numba.core.runtime.nrt import rtsys
    from numba.np import arrayobj  # noqa: F401  # as cgutils
except ImportError:
    caching = DefaultOptions = None  # type: ignore[assignment,misc]

_F = TypeVar("_F", bound=Callable[..., Any])
FunctionCache: Any = getattr(caching, "FunctionCache", None)
_ROOT = Path(__file__).parent
_OPTIONS: dict[str, Any] = {
    "nogil": True,
    "fastmath": False,  # nor contraction, which needs it: replay agrees to the bit
    "error_model": "numpy",
    "no_cfunc_wrapper": True,  # nobody calls kernels from C, and it would cost a third of the compilation
}
# Whether it is counted who refers to an array: two calls for each array of each call. An unknown numba always does.
_COUNTS: str | None = "_nrt" if hasattr(DefaultOptions, "_nrt") else None
_CONFIG: Any = numba.config  # its attributes are made when it is imported


def _cache_somewhere() -> None:
    # In a read-only install without a home numba finds no place for its cache and refuses to compile at all.
    if _CONFIG.CACHE_DIR:
        return
    places = (_ROOT, Path.home() / ".cache")
    if not any(os.access(place, os.W_OK) for place in places):
        _CONFIG.CACHE_DIR = str(Path(tempfile.gettempdir()) / f"phalanx-kernels-{os.getuid()}")


# As text: a parser would take a tenth of a second at every start. What looks like an import and is none does no harm.
_IMPORT = re.compile(rb"^[ \t]*(?:from +(\.*)([\w.]*) +)?import +(\([^)]*\)|.*)", re.MULTILINE)
# Whatever lies there is imported (robot/controllers/declaration.py).
_NAME = re.compile(r"[\w.]+")
_GLOB = re.compile(rb"\.glob\(\"([^\"]+)\"")


@cache
def _imported(path: Path) -> tuple[Path, ...]:
    """The modules of ours that a module imports, by their files; what C became imports none."""
    if path.suffix != ".py":
        return ()
    here = ["phalanx", *path.relative_to(_ROOT).parts[:-1]]
    text = path.read_bytes()
    found = {file for pattern in _GLOB.findall(text) for file in path.parent.glob(pattern.decode())}
    for dots, module, named in _IMPORT.findall(text):
        base = [*here[: len(here) - len(dots) + 1 if dots else 0], *filter(None, module.decode().split("."))]
        for name in ["", *_NAME.findall(named.decode())]:
            first, *rest = [*base, *filter(None, name.split("."))] or [""]
            if first == "phalanx" and rest:
                here_is = _ROOT.joinpath(*rest)
                found |= {file for end in (".py", ".abi3.so") if (file := here_is.with_suffix(end)).is_file()}
    return tuple(sorted(found))


@cache
def _stamp(path: Path) -> str:
    """A hash of a module and of all that it imports of ours.

    numba keeps a compiled kernel as long as its own file is unchanged, although it has the kernels it calls built in.
    """
    seen, todo = {path}, [path]
    while todo:
        new = set(_imported(todo.pop())) - seen
        seen |= new
        todo += new
    return hashlib.sha256(b"".join(hashlib.sha256(file.read_bytes()).digest() for file in sorted(seen))).hexdigest()


@cache
def _lock_file(folder: str) -> int:
    return os.open(Path(folder, "kernels.lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)


@contextlib.contextmanager
def _alone(folder: str, name: str) -> Iterator[None]:
    """No other process is in a body with the same folder and name; where files cannot be locked, another may be."""
    # A byte a name, far beyond the end of the file. Nobody waits in a circle, since kernels do not recurse.
    place = int.from_bytes(hashlib.sha256(name.encode()).digest()[:7]) >> 1
    try:
        fcntl.lockf(_lock_file(folder), fcntl.LOCK_EX, 1, place)
    except OSError:
        yield
        return
    try:
        yield
    finally:
        fcntl.lockf(_lock_file(folder), fcntl.LOCK_UN, 1, place)


def _cache_of(compiled: Any) -> Any:
    """What keeps a kernel on disk, None if this numba does it in a way that we do not know."""
    cached = FunctionCache and hasattr(compiled, "_cache") and FunctionCache(compiled.py_func)
    on_disk = getattr(cached, "_cache_file", None)
    known = hasattr(cached, "_load_overload") and all(
        hasattr(on_disk, name) for name in ("_cache_path", "_index_name", "_load_index", "_source_stamp", "save")
    )
    return cached if known else None


def _share(compiled: Any, stamp: Path) -> None:
    """Processes that need the same kernel at the same time compile it once, and lose nothing that another has kept.

    numba reads its index, adds a line and writes it back: of two processes one would lose its kernel, or be given the
    other's. Where what is kept lies is looked up at the first call: of 230 kernels a run calls a dozen itself.
    """
    compile_it = compiled.compile

    @cache
    def kept() -> tuple[str, str] | None:
        found = _cache_of(compiled)
        if not found:
            return None
        on_disk = found._cache_file  # noqa: SLF001
        folder, name, save = on_disk._cache_path, on_disk._index_name, on_disk.save  # noqa: SLF001
        index = on_disk._load_index  # noqa: SLF001

        def readable() -> Any:
            # numba reads all of it before it looks how old it is; it may name types that an older version of us had.
            try:
                return index()
            except (AttributeError, ImportError):
                return {}

        def save_once(key: Any, data: Any) -> None:
            with _alone(folder, name):
                save(key, data)

        on_disk._source_stamp, on_disk.save, on_disk._load_index = _stamp(stamp), save_once, readable  # noqa: SLF001
        _load_alone(found)
        compiled._cache = found  # noqa: SLF001
        return folder, name

    def compile_once(signature: Any) -> Any:
        place = kept()
        if not place:
            return compile_it(signature)
        folder, name = place
        # Threads first: whoever held a process's lock and waited for a thread of its own would wait for ever.
        with global_compiler_lock, _alone(folder, f"{name} {signature}"):
            return compile_it(signature)

    compiled.compile = compile_once


def _load_alone(kept: Any) -> None:
    """What is on disk is loaded without all that numba knows of Python, which it gathers in a sixth of a second.

    To compile it gathers that as well, by itself.
    """
    load = kept._load_overload  # noqa: SLF001

    def load_overload(signature: Any, context: Any) -> Any:
        rtsys.initialize(context)  # compiled code allocates by it
        return load(signature, context)

    kept.load_overload = load_overload


def _wide(kind: Any) -> Any:
    kind = types.unliteral(kind)  # type: ignore[no-untyped-call]
    return types.int64 if kind in {types.int8, types.int16, types.int32} else kind


def _take_whole_numbers_alike(compiled: Any) -> None:
    """A kernel that others call with a constant, or a narrow number, is the one for every number.

    numba would compile it, and all that it calls, again for each.
    """
    template = getattr(compiled, "get_call_template", None)
    if not template:
        return

    def of_wide(args: Any, words: Any) -> Any:
        return template(tuple(map(_wide, args)), {name: _wide(kind) for name, kind in words.items()})

    compiled.get_call_template = of_wide


_cache_somewhere()


def counting_kernel(function: _F) -> _F:
    """As `kernel`, of a function that makes arrays or returns them: who refers to them is counted at each call."""
    return _compiled(function, counts=True)


def kernel(function: _F) -> _F:
    """`function`, compiled when first called and cached on disk until it or what it imports changes.

    It borrows its arrays, and makes none; nor does it call what returns one that it made, which would never be freed.
    """
    return _compiled(function, counts=False)


def _compiled(function: _F, *, counts: bool) -> _F:
    file = Path(function.__code__.co_filename)
    ours = not _CONFIG.DISABLE_JIT and file.is_relative_to(_ROOT)
    options = {**_OPTIONS, _COUNTS: counts} if _COUNTS else _OPTIONS
    compiled: Any = numba.njit(cache=not ours, **options)(function)
    if ours:
        _share(compiled, file)
        _take_whole_numbers_alike(compiled)
    result: _F = compiled
    return result


def kept_in(compiled: Any) -> Path | None:
    """The folder where a kernel's compiled code is kept, called or not; None if it is not."""
    found = _cache_of(compiled)
    return Path(found.cache_path) if found else None


def written(declared: _F, body: list[str], scope: dict[str, Any]) -> _F:
    """The kernel of a function that is only declared: `body` are its lines, `scope` what they name."""
    lines = [f"def {declared.__name__}({', '.join(inspect.signature(declared).parameters)}):", *body]
    # In its file, at its own line: numba keeps compiled code beside the file of its source.
    code = declared.__code__
    source = "\n" * (code.co_firstlineno - 1) + "\n    ".join(lines)
    names = {"__name__": declared.__module__, **scope}
    exec(compile(source, code.co_filename, "exec"), names)  # noqa: S102 - of declarations of ours
    result: _F = kernel(names[declared.__name__])
    return result
