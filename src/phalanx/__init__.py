"""Phalanx keeps robot swarms in honest hands: who may command, what may be done, what is really done."""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

__all__ = ["__version__"]

ROOMS = ("bti", "link", "mission", "robot", "sim")


def __getattr__(name: str) -> Any:
    # `import phalanx` alone is enough for `phalanx.link.Server`, and costs nobody the rooms that are not used.
    if name in ROOMS:
        return import_module(f"phalanx.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
