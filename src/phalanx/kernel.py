"""`@kernel`: a function that runs compiled over one robot's bytes and numbers, and gives the same bytes uncompiled.

An auditor catches a liar by running its controller again and comparing bytes. That must give the same everywhere, or an
honest robot on another machine would be convicted; and a simulated fleet does it so often that plain Python would take
hours for minutes. So whatever robots run is written once, as a scalar function in the subset of Python that numba
compiles: fleets loop over robots inside compiled code, and `kernel.py_func` is the same function uncompiled, as are all
of them with NUMBA_DISABLE_JIT=1, for a debugger. The first call compiles, which takes seconds and is kept on disk;
`make setup` makes the first calls.

Rules a kernel lives by, so that both (and any two machines) agree to the bit: float64 with + - * / and `math.sqrt` in a
written order; no other function of `math`, no sum over an array, no division by what can be zero, no dict and no set.
Many arrays go to kernels together (bundle.py).
"""

from __future__ import annotations

import ast
import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba

_F = TypeVar("_F", bound=Callable[..., Any])
_ROOT = Path(__file__).parent
_OPTIONS: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "fastmath": False,  # nor contraction, which needs it: replay agrees to the bit
    "error_model": "numpy",
    "no_cfunc_wrapper": True,  # nobody calls kernels from C, and it would cost a third of the compilation
}
_CONFIG: Any = numba.config  # its attributes are made when it is imported


def _cache_somewhere() -> None:
    # In a read-only install without a home numba finds no place for its cache and refuses to compile at all.
    if _CONFIG.CACHE_DIR:
        return
    places = (_ROOT, Path.home() / ".cache")
    if not any(os.access(place, os.W_OK) for place in places):
        _CONFIG.CACHE_DIR = str(Path(tempfile.gettempdir()) / f"phalanx-kernels-{os.getuid()}")


@cache
def _imported(path: Path) -> tuple[Path, ...]:
    """The modules of ours that a module imports, by their files."""
    here = ["phalanx", *path.relative_to(_ROOT).parts[:-1]]
    found = []
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = here[: len(here) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            names = [module, *(f"{module}.{alias.name}" for alias in node.names)]
        else:
            continue
        for name in names:
            first, *rest = name.split(".")
            file = _ROOT.joinpath(*rest).with_suffix(".py") if rest else _ROOT
            if first == "phalanx" and file.is_file():
                found.append(file)
    return tuple(sorted(set(found)))


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


_cache_somewhere()


def kernel(function: _F) -> _F:
    """`function`, compiled when first called and cached on disk until it or what it imports changes."""
    compiled: Any = numba.njit(**_OPTIONS)(function)
    file = Path(function.__code__.co_filename)
    if not _CONFIG.DISABLE_JIT and file.is_relative_to(_ROOT):
        compiled._cache._cache_file._source_stamp = _stamp(file)  # noqa: SLF001
    result: _F = compiled
    return result
