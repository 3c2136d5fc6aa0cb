"""Fails when the trusted base outgrows budget.json: lines to be read, ROM and RAM (`gcc -Os`, for this host).

Lines are those with code on them: no comments, no blank lines. RAM is a node's own memory; the stack comes on top.
`python firmware/budget.py` prints what is used.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
SHARED = "hash mac bucket node snode anode".split()


def lines(path: Path) -> int:
    """Lines of code in a C file."""
    text = re.sub(r"/\*.*?\*/", "", path.read_text(), flags=re.DOTALL)
    return sum(bool(line.strip()) for line in text.splitlines())


def rom(profile: str) -> dict[str, int]:
    """Bytes of code and constants of each source, by its name."""
    sizes = {}
    (HERE / "build").mkdir(exist_ok=True)
    for name in [*SHARED, profile]:
        built = HERE / "build" / f"{name}-os.o"
        flags = ["-std=c99", "-Os", "-fno-asynchronous-unwind-tables", f"-I{HERE / 'include'}"]
        subprocess.run(["gcc", *flags, "-c", HERE / "src" / f"{name}.c", "-o", built], check=True)
        said = subprocess.run(["size", built], check=True, capture_output=True, text=True).stdout
        text, data, bss = (int(word) for word in said.splitlines()[1].split()[:3])
        if data or bss:
            sys.exit(f"firmware: {name}.c keeps {data + bss} bytes of its own; all memory is the caller's")
        sizes[name] = text
    return sizes


def ram() -> dict[str, int]:
    """Bytes of each node."""
    print_sizes = r'printf("%zu %zu\n", sizeof(phx_snode), sizeof(phx_anode));'
    program = f'#include <stdio.h>\n#include "phx.h"\nint main(void) {{ {print_sizes} return 0; }}\n'
    built = HERE / "build" / "sizes"
    flags = ["-std=c99", f"-I{HERE / 'include'}", "-x", "c", "-", "-o", built]
    subprocess.run(["gcc", *flags], check=True, input=program, text=True)
    said = subprocess.run([built], check=True, capture_output=True, text=True).stdout
    snode, anode = (int(word) for word in said.split())
    return {"ram_snode_bytes": snode, "ram_anode_bytes": anode}


def used() -> dict[str, int]:
    """What counts, by the names of budget.json."""
    sizes = rom("bound")
    sources = [HERE / "src" / f"{name}.c" for name in [*SHARED, "bound"]]
    return {
        "lines": sum(map(lines, [*sources, *(HERE / "include").glob("phx.h"), HERE / "src" / "internal.h"])),
        "lines_without_primitives": sum(map(lines, [path for path in sources if path.stem not in {"hash", "mac"}])),
        "rom_bytes": sum(sizes.values()),
        **ram(),
    }


def main() -> int:
    """Compare, and say by how much a ceiling is broken."""
    ceilings = json.loads((HERE / "budget.json").read_text())
    here = used()
    for name, value in here.items():
        sys.stdout.write(f"{name:26} {value:6} of {ceilings[name]:6}\n")
    return int(any(value > ceilings[name] for name, value in here.items()))


if __name__ == "__main__":
    sys.exit(main())
