"""Prints vectors/*.json as lines of words for port/check.c: `python firmware/vectors.py hardened`.

`python firmware/vectors.py serial` is for port/line.c: how many payloads, the stream, each payload.

A line is a function, then numbers, then byte strings in hexadecimal (`-` is empty); a `#` line names what follows.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
VECTORS = HERE.parent / "vectors"
ERRORS = {
    name: int(value) for name, value in re.findall(r"PHX_E_(\w+) = (-\d+)", (HERE / "include" / "phx.h").read_text())
}


def cases(name: str) -> list[dict[str, Any]]:
    """The cases of one file."""
    made: list[dict[str, Any]] = json.loads((VECTORS / f"{name}.json").read_text())["cases"]
    return made


def lines(profile: str) -> Iterator[list[object]]:
    """What one build is to answer, or what a board finds on its line."""
    if profile == "serial":
        yield from ([len(case["payloads"]), case["stream"], *case["payloads"]] for case in cases("serial"))
        return
    for case in cases("present"):
        yield ["present", case["key"], case["plain"], case["cipher"]]
    for case in cases("sha1"):
        yield ["sha1", case["times"], case["message"], case["digest"]]
    for case in cases("lightmac"):
        yield ["lightmac", ERRORS.get(case["expect"], 0), case["key"], case["message"], case.get("mac", "")]
    for case in [*cases("nodes"), *cases("sealed"), *cases("edges")]:
        if case["profile"] != profile:
            continue
        yield ["make", *case["limits"].values()]
        yield from (["refused", *limits.values()] for limits in case.get("refused", []))
        for call in case["calls"]:
            code = ERRORS.get(call["expect"], call["code"])
            # Four numbers and four byte strings always: what a call has not got is zero, or empty.
            numbers = (call["numbers"] + [0, 0, 0])[:3]
            texts = (call["bytes"] + ["", "", ""])[:3]
            yield [call["call"], call["robot"], code, *numbers, *texts, call["out"]]


if __name__ == "__main__":
    for words in lines(sys.argv[1]):
        sys.stdout.write(" ".join(str(word) or "-" for word in words) + "\n")
