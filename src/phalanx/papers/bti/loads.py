"""RoboRebound Fig. 5a and Tables 1 and 2: cost of MACs and hashes, and worst-case load of the trusted nodes.

firmware/count.py counted the instructions. We assume one instruction per cycle, without stalls for flash or branches.
We assume that the c-node's bus carries 2 Mb/s, at which 2 kB in and out take the 20 ms that the paper assumes. As in
the paper, the node does nothing else during a transfer.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from phalanx._firmware_hardened import ffi, lib
from phalanx.papers.statement import Statement, quantiles
from phalanx.papers.table import Rows, Table, by_seed
from phalanx.wire.table import HASH_BYTES, KEY_BYTES

TARGETS = {"cortex-m3": "Cortex-M3", "mips32": "MIPS32"}
CLOCK_HZ = 50e6  # PIC32MX, as in the paper
# Tolerance for calls that consist of bus transfer only, where our framing may exceed the paper's.
NEAR = 1.05
MS_PER_BYTE = 10 / 2e6 * 1000
FRAMING_BYTES = 8  # of each message on the bus: start mark, length, kind, checksum
KINDS = ("mac", "hash")
COST_COLUMNS = ("kind", "bytes", "cortex_m3", "mips32", "host_ns")
REPEATS = 200
# Values from the paper's text, by bytes; the figure itself is a picture. Milliseconds on a PIC32MX at 50 MHz.
PAPER_MS = {("mac", 39): 5.36, ("hash", 270): 0.144}


@cache
def counts() -> dict[str, Any]:
    """Return the instruction counts by target: `mac` and `hash` by bytes, `calls` by name."""
    counted: dict[str, Any] = json.loads((files("phalanx") / "data" / "instructions.json").read_text())
    return counted


def instructions(target: str, kind: str, name: str) -> int:
    """Return the instruction count of one operation. Raises: KeyError: it was not counted."""
    return int(counts()[target][kind][name])


def milliseconds(number: float) -> float:
    """Return the least duration of that many instructions at 50 MHz."""
    return 1000 * number / CLOCK_HZ


@dataclass(frozen=True, slots=True)
class Call:
    """One row of the paper's table."""

    name: str  # as in firmware/count.py
    per_s: float
    bytes_in: int  # over the bus, without framing
    bytes_out: int
    paper_ms: float
    paper_pct: float

    @property
    def bus_ms(self) -> float:
        """Return the duration of the transfers to and from the node."""
        return (self.bytes_in + self.bytes_out + 2 * FRAMING_BYTES) * MS_PER_BYTE


# Transfers to radio, sensors or actuators count too. An audit packet has 2000 bytes, a state 27.
A_NODE = (
    Call("makeAuthenticator", 0.25, 8, 30, 12.0, 0.30),
    Call("isTokenValid", 2.0, 36, 1, 11.0, 2.20),
    Call("makeTokenRequest", 2.0, 2, 32, 11.0, 2.20),
    Call("sendWireless, 27 B", 3.17, 27, 61, 1.1, 0.35),
    Call("sendWireless, audit of 2000 B", 0.25, 2000, 2000, 20.1, 0.50),
    Call("recvWireless, 27 B", 9.17, 27, 34, 1.1, 1.01),
    Call("recvWireless, audit of 2000 B", 2.50, 2000, 2000, 20.1, 5.03),
    Call("actuatorCmd", 4.0, 19, 45, 1.1, 0.44),
    Call("issueToken", 2.50, 54, 8, 21.0, 5.25),
)
# With a sealed radio, in place of the four radio calls above; the seal crosses the bus as well.
SEALED = (
    Call("sendSealed, 27 B", 3.17, 27, 75, 1.1, 0.35),
    Call("sendSealed, audit of 2000 B", 0.25, 2000, 2014, 20.1, 0.50),
    Call("recvSealed, 27 B", 9.17, 41, 34, 1.1, 1.01),
    Call("recvSealed, audit of 2000 B", 2.50, 2014, 2000, 20.1, 5.03),
)
S_NODE = (
    Call("pollSensors", 4.0, 27, 34, 1.1, 0.44),
    Call("makeAuthenticator", 0.25, 8, 30, 12.0, 0.30),
    Call("checkAuthenticator", 2.50, 38, 1, 21.0, 5.25),
)


@dataclass(frozen=True, slots=True)
class Loads:
    """One of the two tables; its cases are its calls, independent of the number of seeds.

    Attributes:
        sealed: calls that replace the radio's with a sealed radio; the paper has only a plain radio.
    """

    calls: tuple[Call, ...]
    sealed: tuple[Call, ...] = ()
    COLUMNS: ClassVar[tuple[str, ...]] = ("per_s", "bus_ms", "cortex_m3", "mips32", "paper_ms", "paper_pct")

    def cases(self, _seeds: int) -> list[str]:
        """Return the names of the calls, without commas."""
        return [call.name.replace(",", "") for call in self.rows]

    @property
    def rows(self) -> tuple[Call, ...]:
        """Return the calls of all rows, the sealed ones last."""
        return self.calls + self.sealed

    def measure_case(self, case: str, tell: Callable[[float], None]) -> Rows:
        """Return the row of one call."""
        call = self.rows[self.cases(1).index(case)]
        tell(1.0)
        counted = (instructions(target, "calls", call.name) for target in TARGETS)
        return np.array([(call.per_s, call.bus_ms, *counted, call.paper_ms, call.paper_pct)])

    def loads_pct(self, table: Table, target: str) -> Rows:
        """Return (calls and sealed,) the share of time, in percent, for which each call occupies the node."""
        columns = {name: np.array([table.column(case, name)[0] for case in self.cases(1)]) for name in self.COLUMNS}
        ms = milliseconds(1.0) * columns[target.replace("-", "_")] + columns["bus_ms"]
        load: Rows = columns["per_s"] * ms / 10
        return load

    def compare(self, table: Table) -> list[Statement]:
        """Compare each call and their sum with the paper; with a sealed radio, its sum with the paper's plain one."""
        pct = {label: self.loads_pct(table, target) for target, label in TARGETS.items()}
        rows = [(call.name, call.paper_pct, [each[k] for each in pct.values()]) for k, call in enumerate(self.rows)]
        n, paper_all = len(self.calls), round(sum(call.paper_pct for call in self.calls), 2)
        plain = [k for k, call in enumerate(self.calls) if "Wireless" not in call.name]
        if self.sealed:
            with_seals = [each[plain].sum() + each[n:].sum() for each in pct.values()]
            rows.append(("all, radio sealed", paper_all, with_seals))
        rows.append(("all", paper_all, [each[:n].sum() for each in pct.values()]))
        return [
            Statement(
                what=f"{name}, % of the time",
                paper=f"{paper:.2f}",
                ours=", ".join(f"{load:.2f} {label}" for label, load in zip(pct, ours, strict=True)),
                agrees=bool(max(ours) <= NEAR * paper),
                asked="not worse",
                why=f"at most {NEAR:g} times the paper's; 50 MHz, one instruction a cycle, a bus of 2 Mb/s",
            )
            for name, paper, ours in rows
        ]


TABLE1 = Loads(A_NODE, SEALED)
TABLE2 = Loads(S_NODE)


def measure_costs(_case: str, tell: Callable[[float], None]) -> Rows:
    """Return a row per kind and length: counted instructions, and nanoseconds measured on this machine.

    The measured MAC expands its keys on every call, which no node does.
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


def costs_of(table: Table, kind: int) -> Rows:
    """Return (seeds, rows, columns) of one of KINDS, given by its index."""
    every = np.array(list(table.cases.values()))  # (seeds, rows, columns)
    return every[:, every[0, :, 0] == kind]


def compare_costs(table: Table) -> list[Statement]:
    """Compare the paper's times with the least times of our instruction counts."""
    statements = []
    for (name, length), paper_ms in PAPER_MS.items():
        ours = {label: milliseconds(instructions(target, name, str(length))) for target, label in TARGETS.items()}
        statements.append(
            Statement(
                what=f"{name} of {length} bytes at 50 MHz, ms",
                paper=f"{paper_ms:g}",
                ours=", ".join(f"{ms:.3f} {label}" for label, ms in ours.items()),
                agrees=max(ours.values()) <= paper_ms,
                asked="not worse",
                why="no more than the paper's; one instruction a cycle"
                + ("" if name == "mac" else "; our SHA-1 is optimised for size (-Os): 4 400 instructions per 64 bytes"),
            )
        )
    for kind, name in enumerate(KINDS):
        rows = costs_of(table, kind)
        statements.append(
            Statement(
                what=f"{name} of {rows[0, -1, 1]:.0f} bytes on this machine, ns a byte",
                ours=quantiles(rows[:, -1, 4] / rows[:, -1, 1], ".1f"),
                agrees=None,
                why="nothing: the paper has no value for this machine",
            )
        )
    return statements


FIG5 = SimpleNamespace(COLUMNS=COST_COLUMNS, cases=by_seed, measure_case=measure_costs, compare=compare_costs)
