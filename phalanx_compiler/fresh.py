"""Import all kernels, which fails if one was compiled from other sources: `python -m phalanx_compiler.fresh`."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from .generate import import_kernels

if __name__ == "__main__":
    import_kernels(Path(str(import_module("phalanx").__file__)).parent)
