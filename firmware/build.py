"""Compiles the trusted nodes into the package, once for each profile; setup.py names `hardened` and `paper`.

Python sees what the headers declare: the prototypes are taken from them and written nowhere else.
"""

from __future__ import annotations

import re
from pathlib import Path

from cffi import FFI

HERE = Path(__file__).parent
SHARED = ["bucket", "node", "snode", "anode"]
PROFILES = {"hardened": ["hardened", "seal"], "paper": ["paper"]}
# In their place: what a simulator computes all day, as fast as the processor can (port/host/host.h).
HOST = ["hash", "mac"]
# What checks orders' signatures, once for both profiles (port/order.h).
ORDERS = ["order", "monocypher/monocypher", "monocypher/monocypher-ed25519"]
# Without a word of where they were compiled: the same sources give the same bytes.
FLAGS = ["-O2", "-std=c99", "-Wall", "-Wextra", "-fvisibility=hidden", "-g0", f"-ffile-prefix-map={Path.cwd()}=."]


def declarations(header: Path) -> str:
    """What cffi can read of a header: constants of enums, the limits, the functions; nodes stay opaque."""
    text = re.sub(r"/\*.*?\*/", "", header.read_text(), flags=re.DOTALL)
    text = re.sub(r"\[PHX_\w+\]", "[]", text)
    found = re.findall(
        r"^enum \{.*?^\};|^typedef struct \{[^}]*\} phx_limits;|^(?:int|void|size_t) phx_\w+\([^;]*\);",
        text,
        re.MULTILINE | re.DOTALL,
    )
    return "\n".join(found)


def profile(name: str, headers: list[str], more: list[str] | None = None) -> FFI:
    """The builder of `phalanx._firmware_<name>`, with `more` sources of port/."""
    ffi = FFI()
    kept = ["phx_snode", "phx_anode", *(["phx_seals"] if "seal" in PROFILES[name] else [])]
    ffi.cdef("".join(f"typedef struct {{ ...; }} {each};\n" for each in kept))
    paths = [HERE / "include" / "phx.h", *(HERE / header for header in headers)]
    for path in paths:
        ffi.cdef(declarations(path))
    ffi.set_source(
        f"phalanx._firmware_{name}",
        "\n".join(f'#include "{path.name}"' for path in paths),
        # Relative to setup.py: absolute paths would end up in what is built.
        sources=[f"firmware/src/{source}.c" for source in [*SHARED, *PROFILES[name]]]
        + [f"firmware/port/host/{source}.c" for source in HOST]
        + [f"firmware/port/{source}.c" for source in more or []],
        include_dirs=["firmware/include", "firmware/src", "firmware/port", "firmware/port/host"],
        depends=[str(path.relative_to(HERE.parent)) for path in sorted([*HERE.rglob("*.h"), *HERE.glob("src/*.c")])],
        extra_compile_args=FLAGS,
    )
    return ffi


def hardened() -> FFI:
    """The default."""
    return profile("hardened", ["include/phx_seal.h", "port/host/host.h", "port/order.h"], ORDERS)


def paper() -> FFI:
    """As printed, for experiments."""
    return profile("paper", ["include/phx_paper.h", "port/host/host.h"])
