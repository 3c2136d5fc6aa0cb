"""Fails when the trusted base outgrows budget.json: `python firmware/budget.py`.

Lines are those with code on them, of the logic without its primitives, each function's for one purpose: no comments, no
blank lines. For each target, of `make targets` (-Os): bytes of ROM, of a node's own memory, of stack of the hungriest
function and of the deepest call of the interface; and of the serial line, which a board has around its nodes, ROM, all
memory with the nodes', and the stack from its loop down, without what the port takes. Nothing is recursive or
called through a pointer, no memory is the nodes' own, and of a C library there are memcpy and memset alone.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).parent
LOGIC = "node snode anode hardened bucket".split()
PRIMITIVES = "hash mac".split()
SEALED = ["seal"]  # for a-nodes without a radio of their own: beside the rest, and in none of its sums
INTERFACE = re.compile(r"phx_([sa]node|sealed)_\w+")
LINE = "frame calls keep robot serve".split()  # a board's, around the nodes: it has memory of its own
PARTS = """#include "phx_seal.h"
char ram_snode[sizeof(phx_snode)], ram_anode[sizeof(phx_anode)], ram_seals[sizeof(phx_seals)];
"""


def functions(path: Path) -> Iterator[tuple[str, int]]:
    """Each function of a C file and its lines of code; what stands outside of them as ""."""
    text = re.sub(r"/\*.*?\*/", "", path.read_text(), flags=re.DOTALL)
    name, count = "", 0
    for line in filter(str.strip, text.splitlines()):
        if not name and (begun := re.match(r"[\w ]+?\*?(\w+)\((?!.*;$)", line)):
            name = begun[1]
        if not name:
            yield "", 1
            continue
        count += 1
        if line == "}":
            yield name, count
            name, count = "", 0


def lines() -> Iterator[tuple[str, int]]:
    """Lines of the logic by purpose; every function has just one, and the README has the same numbers."""
    purposes = json.loads((HERE / "budget.json").read_text())["lines"]
    paths = [
        *(HERE / "src" / f"{name}.c" for name in [*LOGIC, *SEALED]),
        *(HERE / "line" / f"{name}.c" for name in LINE),
    ]
    found = {path.stem: list(functions(path)) for path in paths}
    count = {name: n for each in found.values() for name, n in each if name}
    named = [name for purpose in purposes.values() for name in purpose["functions"].split()]
    if sorted(named) != sorted(count):
        sys.exit(f"budget.json does not say once what these are for: {sorted(set(named) ^ set(count))}")
    readme = (HERE / "README.md").read_text()
    total = sum(n for source in LOGIC for _, n in found[source])
    for what, n in [
        *((what, sum(count[name] for name in said["functions"].split())) for what, said in purposes.items()),
        ("in all, with what they include", total),
    ]:
        if f"| {what} | {n} |" not in readme:
            sys.exit(f"README.md does not have this row: | {what} | {n} |")
        yield what, n


@dataclass
class Calls:
    """Who calls whom on one target, and how many bytes of stack each takes."""

    stack: dict[str, int] = field(default_factory=dict)
    callees: dict[str, set[str]] = field(default_factory=dict)

    def read(self, path: Path) -> None:
        """What the compiler has written of a source."""
        text = path.read_text()
        for title, used, how in re.findall(r'title: "([^"]+)" label: "[^"]*?(\d+) bytes \((\w+)\)"', text):
            if how != "static":
                sys.exit(f"{path.stem}: the stack of {title} has no fixed size")
            self.stack[title] = int(used)
        for caller, callee in re.findall(r'sourcename: "([^"]+)" targetname: "([^"]+)"', text):
            if "indirect" in callee:
                sys.exit(f"{path.stem}: {caller} calls through a pointer")
            self.callees.setdefault(caller, set()).add(callee)

    def deepest(self, name: str, above: tuple[str, ...] = ()) -> int:
        """Bytes of stack of a function and all it calls; those of the library are the port's."""
        if name in above:
            sys.exit(f"recursive: {' -> '.join([*above, name])}")
        below = (self.deepest(callee, (*above, name)) for callee in self.callees.get(name, ()))
        return self.stack.get(name, 0) + max(below, default=0)


def said_by(*words: str, **more: str) -> str:
    """What a program prints."""
    return subprocess.run(words, check=True, capture_output=True, text=True, cwd=HERE, **more).stdout


def used(target: str, allowed: set[str]) -> Mapping[str, int]:
    """What counts of a target, by the names of budget.json."""
    built = HERE / "build" / target
    prefix, *flags = said_by(
        "make", "-s", "--no-print-directory", f"--eval=say: ; @echo $({target}-tools) $({target}-flags)", "say"
    ).split()
    sizes, kept, needed, given, calls = {}, {}, set(), set(), Calls()
    for name in [*LOGIC, *PRIMITIVES, *SEALED, *LINE]:
        text, data, bss = map(int, said_by(f"{prefix}size", str(built / f"{name}.o")).splitlines()[1].split()[:3])
        if (data or bss) and name not in LINE:
            sys.exit(f"{name}.c keeps {data + bss} bytes of its own; all memory is the caller's")
        sizes[name], kept[name] = text, data + bss
        for line in said_by(f"{prefix}nm", str(built / f"{name}.o")).splitlines():
            kind, symbol = line.split()[-2:]
            (needed if kind == "U" else given).add(symbol)
        calls.read(built / f"{name}.ci")
    if more := {name for name in needed - given - allowed if not name.startswith("phx_port_")}:
        sys.exit(f"{target}: of a library the nodes may not have {sorted(more)}")
    ram = built / "ram.o"
    said_by(
        f"{prefix}gcc",
        *flags,
        "-ffreestanding",
        "-Iinclude",
        "-fno-common",
        "-xc",
        "-c",
        "-",
        "-o",
        str(ram),
        input=PARTS,
    )
    memory = {row[3]: int(row[1], 16) for row in map(str.split, said_by(f"{prefix}nm", "-S", str(ram)).splitlines())}
    return {
        "rom_logic": sum(sizes[name] for name in LOGIC),
        "rom_primitives": sum(sizes[name] for name in PRIMITIVES),
        "rom_sealed": sum(sizes[name] for name in SEALED),
        "rom_line": sum(sizes[name] for name in LINE),
        **{name: memory[name] for name in ("ram_snode", "ram_anode", "ram_seals")},
        "ram_board": sum(kept.values()),
        "stack_function": max(calls.stack.values()),
        "stack_call": max(calls.deepest(name) for name in calls.stack if INTERFACE.fullmatch(name)),
        "stack_board": calls.deepest("phx_serve"),
    }


def main() -> int:
    """Compare, and say by how much a ceiling is broken."""
    budget = json.loads((HERE / "budget.json").read_text())
    broken = 0
    for what, n in lines():
        most = budget["lines"].get(what, {"at_most": n})["at_most"]
        broken += n > most
        sys.stdout.write(f"{n:4} of {most:4} lines: {what}\n")
    said_by("make", "-s", "targets")
    for target, ceilings in budget["targets"].items():
        here = used(target, {*budget["library"], *budget["compiler"]})
        broken += any(here[name] > ceilings[name] for name in here)
        row = "   ".join(f"{name} {n} of {ceilings[name]}" for name, n in here.items())
        sys.stdout.write(f"{target:14} {row}\n")
    return int(broken > 0)


if __name__ == "__main__":
    sys.exit(main())
