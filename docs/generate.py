"""Rewrites the parts of the documentation that are made from code: `python docs/generate.py`.

A generated part stands between `<!-- NAME:begin -->` and `<!-- NAME:end -->`; tests/test_docs.py checks that what is
committed is what this writes. So does tests/test_session_vectors.py for the TypeScript module of a session's records.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from functools import partial
from pathlib import Path

from phalanx.link.rotation import TABLE, State
from phalanx.link.session.errors import EndReason, Reason
from phalanx.wire import Field, Record, sessions

DOCS = Path(__file__).parent

MEANING = {
    State.FIRST: "nothing: there was no rotation yet",
    State.OVERLAP: "the old epoch, in full",
    State.SETTLED: "the last epoch's request topic, to tell late phones where to go",
}


def rotation_table() -> str:
    """The state machine of a rotation, as a diagram and as two tables."""
    lines = ["```mermaid", "stateDiagram-v2", f"    [*] --> {State.FIRST.value}"]
    lines += [f"    {state.value} --> {after.value} : {event.value}" for (state, event), (after, _) in TABLE.items()]
    lines += ["```", "", "| state | what lives beside the current epoch |", "|---|---|"]
    lines += [f"| {state.value} | {MEANING[state]} |" for state in State]
    lines += ["", "| state | event | the server does, in this order | then |", "|---|---|---|---|"]
    lines += [
        f"| {state.value} | {event.value} | {'; '.join(act.value for act in acts)} | {after.value} |"
        for (state, event), (after, acts) in TABLE.items()
    ]
    return "\n".join(lines)


def record_table(records: Iterable[Record]) -> str:
    """A table of records: name, fields in their order, bytes, meaning."""
    lines = ["| record | bytes, in this order | size | what it is |", "|---|---|---|---|"]
    for record in records:
        fields = [f"{f.name} {f.type}" + ("" if f.value is None else f" = {f.value:#04x}") for f in record.all_fields]
        grows = "+" if any(f.type in {"v8", "v16", "rest"} for f in record.fields) else ""
        lines.append(f"| {record.name} | `{' ‖ '.join(fields)}` | {record.size}{grows} | {record.doc} |")
    return "\n".join(lines)


def field_table(records: Iterable[Record]) -> str:
    """A table of what their fields mean."""
    lines = ["| record | field | meaning |", "|---|---|---|"]
    lines += [f"| {r.name} | {f.name} | {f.doc} |" for r in records for f in r.fields if f.doc]
    return "\n".join(lines)


def reasons() -> str:
    """The numbers of why something was refused, and of why a session is over."""
    lines = ["| number | refused: reason | end: reason |", "|---|---|---|"]
    names = [{each.value: each.name.lower() for each in kind} for kind in (Reason, EndReason)]
    lines += [f"| {n} | {names[0].get(n, '')} | {names[1].get(n, '')} |" for n in sorted(names[0] | names[1])]
    return "\n".join(lines)


TYPES = {"rest": "Uint8Array", "v": "Uint8Array", "b": "Uint8Array", "u": "number"}


def typescript_records() -> str:
    """The TypeScript module of a session's records."""
    made = [
        "// Made by docs/generate.py from src/phalanx/wire/sessions.py.",
        "",
        'import { layout } from "./layout";',
        "",
        f"export const VERSION = {sessions.VERSION};",
        f"export const TAG_BYTES = {sessions.TAG_BYTES};",
    ]
    for record in sessions.ON_THE_WIRE:
        name = "".join(map(str.capitalize, record.name.split("_"))) + "Fields"
        made += ["", f"/** {record.doc} */", f"export interface {name} {{"]
        made += [f"  readonly {f.name}: {_type(f)};" for f in record.fields]
        made += ["}"] if record.fields else []
        if not record.fields:
            made[-1] = f"export type {name} = object;"
        fields = ", ".join(f'{f.name}: "{f.type}"' for f in record.fields)
        tag = "undefined" if record.tag is None else f"{record.tag:#04x}"
        line = f'export const {record.name.upper()} = layout<{name}>("{record.name}", {tag}, {{ {fields} }});'
        made.append(line.replace("{  }", "{}"))
    return "\n".join([*made, ""])


def _type(field: Field) -> str:
    return next(kind for begin, kind in TYPES.items() if field.type.startswith(begin))


SESSION = DOCS / "spec" / "session.md"
PARTS = {
    "invitations": (sessions.INVITATION,),
    "handshake": sessions.HANDSHAKE,
    "sealed": sessions.SEALED,
    "from-client": sessions.FROM_CLIENT,
    "from-server": sessions.FROM_SERVER,
    "store": sessions.STORE,
}
MODULES = {DOCS.parent / "web" / "client" / "session" / "records.ts": typescript_records}
BLOCKS = {"rotation-table": (DOCS / "spec" / "link.md", rotation_table), "reasons": (SESSION, reasons)}
BLOCKS |= {name: (SESSION, partial(record_table, records)) for name, records in PARTS.items()}
BLOCKS |= {f"{name}-fields": (SESSION, partial(field_table, records)) for name, records in PARTS.items()}


def replaced(text: str, name: str, block: str) -> str:
    """`text` with the generated part `name` made anew.

    Raises: ValueError: the text has no such part, or more than one.
    """
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    before, _, rest = text.partition(begin)
    _, _, after = rest.partition(end)
    if text.count(begin) != 1 or rest.count(end) != 1:
        raise ValueError(f"not exactly one {begin} … {end}")
    return f"{before}{begin}\n\n{block}\n\n{end}{after}"


def main() -> int:
    """Write every generated part."""
    for name, (path, make) in BLOCKS.items():
        path.write_text(replaced(path.read_text(), name, make()))
        print(f"{path.relative_to(DOCS)}: {name}", file=sys.stderr)
    for path, make in MODULES.items():
        path.write_text(make())
    return 0


if __name__ == "__main__":
    sys.exit(main())
