"""Lazy imports for packages: each name is imported when it is first used."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def loaded_when_used(package: str, found_in: Mapping[str, str]) -> Callable[[str], Any]:
    """Return a `__getattr__` for a package that imports names when they are first used.

    Args:
        found_in: maps each such name to the module that defines it: "module" in the package, ".module" beside it.
    """

    def get(name: str) -> Any:
        if name in found_in:
            return getattr(import_module(f".{found_in[name]}", package), name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return get
