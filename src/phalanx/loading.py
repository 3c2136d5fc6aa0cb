"""Packages whose names are loaded when they are first used: whoever wants one of them does not wait for all."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def loaded_when_used(package: str, found_in: Mapping[str, str]) -> Callable[[str], Any]:
    """A package's `__getattr__`.

    Args:
        found_in: of each name that is loaded so, its module within the package; behind a dot, beside the package.
    """

    def get(name: str) -> Any:
        if name in found_in:
            return getattr(import_module(f".{found_in[name]}", package), name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return get
