"""Packages whose names are loaded when they are first used: whoever wants one of them does not wait for all."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def loaded_when_used(package: str, found_in: Mapping[str, str]) -> Callable[[str], Any]:
    """Return a package's `__getattr__`.

    Args:
        found_in: of each name that is loaded so, the module that has it: "module" within the package, ".module" beside.
    """

    def get(name: str) -> Any:
        if name in found_in:
            return getattr(import_module(f".{found_in[name]}", package), name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return get
