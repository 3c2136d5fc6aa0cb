"""Kernels that were declared, hashes of source files, sizes of trusted nodes: what a binary is compiled from."""

from __future__ import annotations

import hashlib
import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

# All kernels that this process has declared and not found compiled, in the order of their declarations.
DECLARED: list[Callable[..., Any]] = []
PROFILES = ("hardened", "paper")


def sizes_of_nodes() -> dict[str, list[int]]:
    """Return the bytes of an s-node and of an a-node in each profile, which kernels have as constants.

    Raises: ImportError: the trusted nodes are not compiled.
    """
    libs = {each: importlib.import_module(f"phalanx._firmware_{each}").lib for each in PROFILES}
    return {each: [lib.phx_snode_size(), lib.phx_anode_size()] for each, lib in libs.items()}


def hash_of(file: Path) -> str:
    """Return a hash of a source file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]
