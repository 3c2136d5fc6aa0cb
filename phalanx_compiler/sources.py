"""Kernels that were declared, and hashes of source files: what a binary is compiled from."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

# All kernels that this process has declared and not found compiled, in the order of their declarations.
DECLARED: list[Callable[..., Any]] = []


def hash_of(file: Path) -> str:
    """Return a hash of a source file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]
