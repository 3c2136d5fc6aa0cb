"""Writes what is made from wire/table.py: `python firmware/generate.py`.

That is include/phx_wire.h, web/client/wire.ts, and the tables in docs/spec/rebound-nodes.md, rebound.md, mission.md and
vocabulary.md between `<!-- NAME:begin -->` and `<!-- NAME:end -->`; tests/test_wire.py checks that what is committed is
what this writes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from phalanx.wire import Record, missions, table

HERE = Path(__file__).parent
HEADER = HERE / "include" / "phx_wire.h"
SPEC = HERE.parent / "docs" / "spec"
PAGES = HERE.parent / "web" / "client" / "wire.ts"

SIZES = "HASH_BYTES MAC_BYTES KEY_BYTES NONCE_BYTES FRAME_MAX ENTRY_HEADER_BYTES AUDIT_HEADER_BYTES".split()
CODES = "ENTRY_INPUT ENTRY_RECV ENTRY_SEND ENTRY_ACMD KIND_AUDIT".split()


def c_header() -> str:
    """The C header: sizes and codes, then each MACed message's tag, size and offsets."""
    lines = [
        "/* Made by firmware/generate.py from src/phalanx/wire/table.py. */",
        "#ifndef PHX_WIRE_H",
        "#define PHX_WIRE_H",
        "",
    ]
    lines += [f"#define PHX_{name} {getattr(table, name)}u" for name in [*SIZES, *CODES]]
    for record in table.MACED:
        name = f"PHX_{record.name.upper()}"
        lines += [
            "",
            f"/* {record.doc} */",
            f"#define {name} 0x{record.tag:02x}u",
            f"#define {name}_BYTES {record.size}u",
        ]
        lines += [f"#define {name}_{field.name.upper()} {record.at(field.name)}u" for field in record.fields]
    lines += ["", "/* frames with the AUDIT bit */"]
    lines += [f"#define PHX_AUDIT_{name.upper()} {table.AUDIT_HELLO.at(name)}u" for name in ("src", "dst")]
    return "\n".join([*lines, "", "#endif", ""])


def for_pages() -> str:
    """The TypeScript module: what pages read of records."""
    place = table.ROBOT_PLACE
    where = ", ".join(f"{field.name}: {place.at(field.name)}" for field in place.fields)
    return "\n".join(
        [
            "// Made by firmware/generate.py from src/phalanx/wire/table.py.",
            "",
            f"/** {place.doc}. */",
            f"export const PLACE = {{ bytes: {place.size}, {where} }};",
            f"export const TURN_DEG = {table.TURN_DEG};",
            f"export const PASS_BY = {table.PASS_BY};",
            "",
        ]
    )


def markdown(records: Iterable[Record]) -> str:
    """A table of records: name, tag, fields in their order, bytes, meaning."""
    rows = ["| name | bytes, in this order | size | what it is |", "|---|---|---|---|"]
    for record in records:
        fields = [
            f"{field.name} {field.type}" + ("" if field.value is None else f" = {field.value:#04x}")
            for field in record.all_fields
        ]
        grows = "+" if any(field.type in {"v8", "v16", "rest"} for field in record.fields) else ""
        rows.append(f"| {record.name} | `{' ‖ '.join(fields)}` | {record.size}{grows} | {record.doc} |")
    return "\n".join(rows)


def errors() -> str:
    """A table of what nodes refuse with, from the enum in phx.h."""
    found = re.findall(r"PHX_E_(\w+) = (-\d+),? +/\* (.*?) \*/", (HERE / "include" / "phx.h").read_text())
    rows = [f"| `{name}` | {number} | {meaning} |" for name, number, meaning in found]
    return "\n".join(["| error | code | meaning |", "|---|---|---|", *rows])


BLOCKS = {
    "rebound-nodes.md": {
        "entries": markdown([table.ENTRY]),
        "payloads": markdown(table.PAYLOADS),
        "maced": markdown(table.MACED),
        "handed_out": markdown(table.HANDED_OUT),
        "errors": errors(),
    },
    "rebound.md": {
        "logged": markdown(table.LOGGED),
        "shown": markdown(table.SHOWN),
        "remembered": markdown(table.REMEMBERED),
    },
    "mission.md": {
        "hashed": markdown(missions.HASHED),
        "file": markdown(missions.FILE),
        "sealed": markdown(missions.SEALED),
        "key": markdown(missions.KEY),
        "claim": markdown([missions.CLAIM, missions.SENSED, missions.SEEN_CODE]),
        "walked": markdown(missions.WALKED),
    },
    "vocabulary.md": {"places": markdown([table.ROBOT_PLACE])},
}


def page(path: Path) -> str:
    """What a page of the specification holds with its tables made anew."""
    text = path.read_text()
    for name, block in BLOCKS[path.name].items():
        begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
        text, found = re.subn(
            f"{begin}.*?{end}", lambda _, b=begin, e=end, x=block: f"{b}\n\n{x}\n\n{e}", text, flags=re.DOTALL
        )
        if found != 1:
            raise ValueError(f"not exactly one {begin} … {end}")
    return text


if __name__ == "__main__":
    HEADER.write_text(c_header())
    PAGES.write_text(for_pages())
    for each in BLOCKS:
        (SPEC / each).write_text(page(SPEC / each))
