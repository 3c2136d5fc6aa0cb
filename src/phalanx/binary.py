"""Load the compiled kernels; reject a binary that does not match the sources or the trusted nodes.

This file needs no kernels, so `phalanx doctor` can report what is wrong with them.
"""

from __future__ import annotations

import importlib
import json
import os
from pathlib import Path
from typing import Any

import phalanx_compiler
from phalanx_compiler.sources import hash_of, sizes_of_nodes

from .errors import Unavailable

INSTALL_COMPILER = "install gcc or clang, or name one in CC"
NAME = "phalanx._kernels"
ROOT = Path(__file__).parent
HINT = "run make setup, or pip install ., to compile them; PHALANX_PURE=1 runs them as slow Python"


def is_pure() -> bool:
    """Return True if all kernels run as Python: the environment sets PHALANX_PURE."""
    return os.environ.get("PHALANX_PURE", "0") not in ("", "0")


def load_binary() -> tuple[Any, dict[str, dict[str, Any]]]:
    """Return the module of the compiled kernels and its table: hashes of sources, and slots of linked functions.

    Raises: Unavailable: the binary is missing or cannot be loaded, or a source or the size of a trusted node has
        changed since the kernels were compiled.
    """
    try:
        module = importlib.import_module(NAME)
    except ModuleNotFoundError as error:
        raise Unavailable("the kernels are not compiled", HINT) from error
    except ImportError as error:
        raise Unavailable(f"the compiled kernels cannot be loaded: {error}", HINT) from error
    table: dict[str, dict[str, Any]] = json.loads(module.table)
    _check_age(table["sources"])
    _check_nodes(table["nodes"])
    return module, table


def _check_age(hashes: dict[str, str]) -> None:
    """Raise Unavailable if a source has changed since the kernels were compiled."""
    roots = {"phalanx": ROOT, "phalanx_compiler": Path(phalanx_compiler.__file__).parent}
    for name, known in hashes.items():
        root, _, rest = name.partition("/")
        file = roots[root] / rest
        if not file.is_file() or hash_of(file) != known:
            raise Unavailable(f"the kernels were compiled before {name} changed", HINT)


def _check_nodes(sizes: dict[str, list[int]]) -> None:
    """Raise Unavailable if the installed trusted nodes differ in size from those the kernels were compiled for."""
    try:
        found = sizes_of_nodes()
    except ImportError:  # not installed: bti/trusted.py raises when a kernel needs them
        return
    if found != sizes:
        raise Unavailable("the kernels were compiled for trusted nodes of another size", HINT)
