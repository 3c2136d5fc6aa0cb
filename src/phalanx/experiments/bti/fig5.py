"""RoboRebound Fig. 5a: what a MAC and a hash cost, by the length of what they are of."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from phalanx._firmware_bound import ffi, lib
from phalanx.experiments.plot import BLUE, VERMILION, Picture
from phalanx.experiments.statement import Statement, quantiles
from phalanx.experiments.table import Rows, Table, by_seed
from phalanx.wire.table import HASH_BYTES, KEY_BYTES

from .loads import TARGETS, counts, instructions, milliseconds

__all__ = ["COLUMNS", "cases", "compare", "draw", "measure_case"]

KINDS = ("mac", "hash")
COLUMNS = ("kind", "bytes", "cortex_m3", "mips32", "host_ns")
cases = by_seed
REPEATS = 200
# What the text says of the figure, which is a picture: bytes and ms on a PIC32MX at 50 MHz.
PAPER_MS = {("mac", 39): 5.36, ("hash", 270): 0.144}


def measure_case(_case: str, tell: Callable[[float], None]) -> Rows:
    """Each length: instructions as they were counted, ns as they are taken now on this machine.

    Here a MAC expands its keys each time, as no node does.
    """
    rows = []
    for kind, name in enumerate(KINDS):
        for length in map(int, counts()["cortex-m3"][name]):
            rows.append((kind, length, *(instructions(t, name, str(length)) for t in TARGETS), _host_ns(name, length)))
            tell(len(rows) / 20)
    return np.array(rows, np.float64)


def _host_ns(name: str, length: int) -> float:
    data, out = ffi.new("uint8_t[]", length), ffi.new("uint8_t[]", HASH_BYTES)
    key = ffi.new("uint8_t[]", KEY_BYTES)
    best = np.inf
    for _ in range(5):
        began = time.perf_counter_ns()
        for _ in range(REPEATS):
            if name == "mac":
                lib.phx_lightmac(key, data, length, out)
            else:
                lib.phx_sha1(data, length, out)
        best = min(best, (time.perf_counter_ns() - began) / REPEATS)
    return float(best)


def _rows(table: Table, kind: int) -> Rows:
    every = np.array(list(table.cases.values()))  # (seeds, rows, columns)
    return every[:, every[0, :, 0] == kind]


def compare(table: Table) -> list[Statement]:
    """The paper's times, and ours at least."""
    told = []
    for (name, length), paper_ms in PAPER_MS.items():
        ours = {words: milliseconds(instructions(target, name, str(length))) for target, words in TARGETS.items()}
        told.append(
            Statement(
                what=f"{name} of {length} bytes at 50 MHz, ms",
                paper=f"{paper_ms:g}",
                ours=", ".join(f"{ms:.3f} {words}" for words, ms in ours.items()),
                agrees=max(ours.values()) <= paper_ms,
                why="no more than the paper's; one instruction a cycle"
                + ("" if name == "mac" else "; ours is SHA-1 made small (-Os), 64 bytes of it 4 400 instructions"),
            )
        )
    for kind, name in enumerate(KINDS):
        rows = _rows(table, kind)
        told.append(
            Statement(
                what=f"{name} of {rows[0, -1, 1]:.0f} bytes on this machine, ns a byte",
                paper="",
                ours=quantiles(rows[:, -1, 4] / rows[:, -1, 1], ".1f"),
                agrees=True,
                why="as fast as it is",
            )
        )
    return told


def draw(table: Table, picture: Picture) -> None:
    """Ours solid, the paper's hollow."""
    axes = picture.subplots()
    for kind, (name, line) in enumerate(zip(KINDS, ("-", "--"), strict=True)):
        rows = _rows(table, kind)[0]
        for column, (colour, words) in enumerate(zip((BLUE, VERMILION), TARGETS.values(), strict=True), start=2):
            axes.plot(rows[:, 1], milliseconds(rows[:, column]), line, color=colour, label=f"{name}, {words}")
    for (name, length), ms in PAPER_MS.items():
        axes.plot(length, ms, "o" if name == "mac" else "s", mfc="none", mec="black", label=f"{name}, paper's PIC32MX")
    axes.set(xlabel="bytes", ylabel="ms at 50 MHz, one instruction a cycle", xscale="log", yscale="log")
    axes.legend(fontsize=8)
