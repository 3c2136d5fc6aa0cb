"""Writes what is made from wire/table.py: `python firmware/generate.py`.

That is include/phx_wire.h, include/phx_line_wire.h, web/client/wire.ts, src/phalanx/wire/typed_records.py, and the
tables in docs/spec/ (rebound-nodes.md, rebound.md, serial.md, mission.md, orders.md and vocabulary.md) between
`<!-- NAME:begin -->` and `<!-- NAME:end -->`; tests/test_wire.py checks that what is committed is what this writes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from phalanx.wire import Record, driven, lines, missions, table

HERE = Path(__file__).parent
HEADER = HERE / "include" / "phx_wire.h"
LINE_HEADER = HERE / "include" / "phx_line_wire.h"
SPEC = HERE.parent / "docs" / "spec"
PAGES = HERE.parent / "web" / "client" / "wire.ts"
TYPED = HERE.parent / "src" / "phalanx" / "wire" / "typed_records.py"

SIZES = "HASH_BYTES MAC_BYTES KEY_BYTES NONCE_BYTES PACKET_MAX ENTRY_HEADER_BYTES AUDIT_HEADER_BYTES".split()
CODES = "ENTRY_INPUT ENTRY_RECV ENTRY_SEND ENTRY_ACMD KIND_AUDIT".split()
LINE = "VERSION MARK CRC_BYTES RUN_MAX TOLD_CLOCK TOLD_READINGS SEALED".split()


def c_header() -> str:
    """The C header: sizes and codes, then each MACed message's tag, size and offsets."""
    made = [
        "/* Made by firmware/generate.py from src/phalanx/wire/table.py. */",
        "#ifndef PHX_WIRE_H",
        "#define PHX_WIRE_H",
        "",
    ]
    made += [f"#define PHX_{name} {getattr(table, name)}u" for name in [*SIZES, *CODES]]
    for record in table.MACED:
        made += defined(record)
    made += defined(table.SEAL)
    made += ["", "/* frames with the AUDIT bit */"]
    made += [f"#define PHX_AUDIT_{name.upper()} {table.AUDIT_HELLO.at(name)}u" for name in ("src", "dst")]
    return "\n".join([*made, "", "#endif", ""])


def defined(record: Record) -> list[str]:
    """A record's tag, size without what it leaves open, and offsets, as C has them."""
    name = f"PHX_{record.name.upper()}"
    tag = [] if record.tag is None else [f"#define {name} 0x{record.tag:02x}u"]
    places = [f"#define {name}_{field.name.upper()} {record.at(field.name)}u" for field in record.fields]
    return ["", f"/* {record.doc} */", *tag, f"#define {name}_BYTES {record.size}u", *places]


def line_header() -> str:
    """The C header of the serial line."""
    made = [
        "/* Made by firmware/generate.py from src/phalanx/wire/lines.py. */",
        "#ifndef PHX_LINE_WIRE_H",
        "#define PHX_LINE_WIRE_H",
        "",
    ]
    made += [f"#define PHX_LINE_{name} {getattr(lines, name)}u" for name in LINE]
    made += [f"#define PHX_LINE_{name} ({getattr(lines, name)})" for name in ("E_CALL", "E_HELLO")]
    for record in lines.RECORDS:
        made += defined(record)
    return "\n".join([*made, "", "#endif", ""])


def for_pages() -> str:
    """The TypeScript module: what pages read of records."""
    shown = {"PLACE": table.ROBOT_PLACE, "POINT": table.ROUTE_POINT}
    return "\n".join(
        [
            "// Made by firmware/generate.py from src/phalanx/wire/table.py.",
            "",
            *(line for name, record in shown.items() for line in layout(name, record)),
            f"export const TURN_DEG = {table.TURN_DEG};",
            f"export const PASS_BY = {table.PASS_BY};",
            "",
        ]
    )


def layout(name: str, record: Record) -> list[str]:
    """Return lines of TypeScript: where a record's fields are."""
    where = ", ".join(f"{field.name}: {record.at(field.name)}" for field in record.fields)
    return [f"/** {record.doc}. */", f"export const {name} = {{ bytes: {record.size}, {where} }};"]


# Dataclasses for controllers. `id` and `t` of what a robot sends may be left out.
CLASSES = {"Reading": table.SENSOR, "Command": table.ACCELERATION, "State": table.STATE}
LEFT_OUT = {"id": "0: the sender's own", "t": "0: now"}
BESIDE = {"Reading": "what further sensors say (`Senses` reads it)"}
UNITS = {"m": "m", "mps": "m/s", "mps2": "m/s²"}


def dataclasses() -> str:
    """The Python module: what controllers see of records."""
    widths = sorted({field.type.upper() for record in CLASSES.values() for field in record.fields})
    made = [
        '"""Records of the byte table as dataclasses. Made by firmware/generate.py from src/phalanx/wire/table.py."""',
        "",
        "from __future__ import annotations",
        "",
        "from dataclasses import dataclass, field",
        "from typing import ClassVar",
        "",
        "from . import table",
        "from .record import Record",
        "from .typed import Typed",
        f"from .widths import {', '.join(widths)}",
    ]
    for name, record in CLASSES.items():
        made += dataclass_of(name, record)
    return "\n".join([*made, ""])


def dataclass_of(name: str, record: Record) -> list[str]:
    """A record's class: its own fields by position, `id` and `t` by name."""
    variable = next(key for key, value in vars(table).items() if value is record)
    made = ["", "", "@dataclass(frozen=True, slots=True)", f"class {name}(Typed):"]
    made += [f'    """{record.doc[0].upper()}{record.doc[1:]}.', "", "    Attributes:"]
    made += [f"        {names}: {doc}." for names, doc in documented(name, record)]
    made += ['    """', "", f"    RECORD: ClassVar[Record] = table.{variable}", ""]
    for each in record.fields:
        default = " = field(default=0, kw_only=True)" if each.name in LEFT_OUT else ""
        made.append(f"    {each.name}: {each.type.upper()}{default}")
    return [*made, '    beside: bytes = field(default=b"", kw_only=True)'] if name in BESIDE else made


def documented(name: str, record: Record) -> list[tuple[str, str]]:
    """Names of fields that are explained together, and the words."""
    found: list[tuple[str, str]] = []
    for each in record.fields:
        unit = UNITS.get(each.name.rpartition("_")[2])
        words = each.doc + (f", {unit}" if unit else "")
        if each.name in LEFT_OUT and name not in BESIDE:
            words += f"; {LEFT_OUT[each.name]}"
        if each.doc:
            found.append((each.name, words))
        else:
            names, words = found[-1]
            found[-1] = f"{names}, {each.name}", words
    return [*found, ("beside", BESIDE[name])] if name in BESIDE else found


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
    "serial.md": {"calls": markdown(lines.CALLS), "answers": markdown([lines.ANSWER, lines.ABOUT])},
    "mission.md": {
        "hashed": markdown(missions.HASHED),
        "file": markdown(missions.FILE),
        "sealed": markdown(missions.SEALED),
        "key": markdown(missions.KEY),
        "claim": markdown([missions.CLAIM, missions.SENSED, missions.SEEN_CODE]),
        "walked": markdown(missions.WALKED),
    },
    "orders.md": {"orders": markdown(driven.ORDERS)},
    "vocabulary.md": {"places": markdown([table.ROBOT_PLACE]), "routes": markdown([table.ROUTE_POINT])},
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
    LINE_HEADER.write_text(line_header())
    PAGES.write_text(for_pages())
    TYPED.write_text(dataclasses())
    for each in BLOCKS:
        (SPEC / each).write_text(page(SPEC / each))
