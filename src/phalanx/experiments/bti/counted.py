"""Instructions of the trusted nodes on microcontrollers, as firmware/count.py counted them, and what they are in time.

A processor there is taken to finish one instruction a cycle: what it waits for its flash, and for branches, is on top.
"""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any

TARGETS = {"cortex-m3": "Cortex-M3", "mips32": "MIPS32"}
CLOCK_HZ = 50e6  # the paper's PIC32MX


@cache
def counts() -> dict[str, Any]:
    """By target: `mac` and `hash` by bytes, `calls` by name, all in instructions."""
    told: dict[str, Any] = json.loads((files("phalanx") / "data" / "instructions.json").read_text())
    return told


def instructions(target: str, kind: str, name: str) -> int:
    """Of one thing. Raises: KeyError: nobody counted it."""
    return int(counts()[target][kind][name])


def milliseconds(number: float) -> float:
    """So many instructions take at least that long at 50 MHz."""
    return 1000 * number / CLOCK_HZ
