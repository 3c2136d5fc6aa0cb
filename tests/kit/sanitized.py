"""Run the kernels of a module that was compiled with sanitizers: `python sanitized.py MODULE LIBRARY INPUTS`.

A process of its own, as the sanitizers' library has to be loaded before Python.
"""

from __future__ import annotations

import importlib
import logging
import random
import sys
from pathlib import Path

from harness import kernels_of, loaded, outcome, value_of
from phalanx.errors import KernelDefect
from phalanx_compiler.value_types import signature_of

LARGE = [-1, 5, 6, 10**6, -(2**63), 2**63 - 1, 1 << 40]


def main() -> None:
    """Call each kernel with the module's inputs, with random ones, and with indices and numbers of any size."""
    logging.disable()
    module = importlib.import_module(sys.argv[1])
    kernels = kernels_of(module)
    made = loaded(Path(sys.argv[2]), kernels)
    calls = raised = 0
    for function in kernels:
        draw = random.Random(function.__name__)
        parameters, _ = signature_of(function)
        rows, only = getattr(module, "GIVEN", {}).get(function.__name__, ([], False))
        for n in range(int(sys.argv[3])):
            drawn = [value_of(typ, draw, name) for name, typ in parameters.items()]
            if n % 2 and not only and sys.argv[1] == "violations":
                drawn = [draw.choice(LARGE) if type(each) is int else each for each in drawn]
            rows.append(drawn)
        for row in rows if not only else rows[: len(rows) - int(sys.argv[3])]:
            raised += outcome(made[function.__name__], list(row), function) is KernelDefect
            calls += 1
    print(f"{len(kernels)} kernels, {calls} calls, {raised} violations")


if __name__ == "__main__":
    main()
