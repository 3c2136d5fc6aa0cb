"""Write the C of all kernels of the package: `python -m phalanx_compiler.generate OUT.c PACKAGE [NODES]`.

The package is imported uncompiled, so that names in kernels mean what they mean when they run.
"""

from __future__ import annotations

import importlib
import json
import os
import re
import sys
from pathlib import Path

from .errors import SubsetError
from .sources import DECLARED, PROFILES, hash_of, sizes_of_nodes
from .unit import Unit

HERE = Path(__file__).parent
# A module with kernels imports one of the functions of phalanx.kernel that make them.
MAKES_KERNELS = re.compile(r"^from [.\w]*\bkernel import (\([^)]*|.*)\b(kernel|linked|written)\b", re.MULTILINE)


def package_source(root: Path, nodes: Path | None = None) -> str:
    """Return the C of all kernels in the package at `root`.

    Args:
        nodes: folder of the compiled trusted nodes, which go before those that an older build left in the package.
    Raises: SubsetError: a kernel is outside the subset.
    """
    os.environ["PHALANX_PURE"] = "build"
    if nodes:
        path = importlib.import_module("phalanx").__path__
        path.insert(0, str(nodes))
        for profile in PROFILES:
            importlib.import_module(f"phalanx._firmware_{profile}")
        path.remove(str(nodes))
    import_kernels(root)
    unit = Unit()
    text = unit.text(DECLARED)
    table = json.dumps({"sources": _hashes(root), "slots": unit.slots, "nodes": sizes_of_nodes()})
    return "\n".join([text, f"#define TABLE {json.dumps(table)}", (HERE / "call.c").read_text()])


def import_kernels(root: Path) -> None:
    """Import all modules of the package at `root` that have kernels."""
    for file in sorted(root.rglob("*.py")):
        if MAKES_KERNELS.search(file.read_text(encoding="utf-8")):
            importlib.import_module(".".join(["phalanx", *file.relative_to(root).with_suffix("").parts]))


def _hashes(root: Path) -> dict[str, str]:
    """Return the hashes of all sources that the C was made of: the package's modules, and the compiler."""
    named = [
        getattr(module, "__file__", None)
        for name, module in list(sys.modules.items())
        if name.split(".")[0] == "phalanx"
    ]
    files = {f"phalanx/{Path(each).relative_to(root)}": Path(each) for each in named if each and each.endswith(".py")}
    files |= {f"phalanx_compiler/{each.name}": each for each in HERE.iterdir() if each.suffix in (".py", ".c", ".h")}
    return {name: hash_of(files[name]) for name in sorted(files)}


def main() -> int:
    """Write the file that is named on the command line; print one line if a kernel is outside the subset."""
    target, root, *nodes = map(Path, sys.argv[1:])
    try:
        text = package_source(root.resolve(), nodes[0] if nodes else None)
    except SubsetError as error:
        sys.stderr.write(f"error: {error}\n")
        return 1
    if not target.exists() or target.read_text() != text:  # or all would be compiled again
        target.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
