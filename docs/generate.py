"""Rewrites the parts of the documentation that are made from code: `python docs/generate.py`.

A generated part stands between `<!-- NAME:begin -->` and `<!-- NAME:end -->`; tests/test_docs.py checks that what is
committed is what this writes.
"""

from __future__ import annotations

import sys
from pathlib import Path

from phalanx.link.rotation import TABLE, State

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


BLOCKS = {"rotation-table": (DOCS / "spec" / "link.md", rotation_table)}


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
    return 0


if __name__ == "__main__":
    sys.exit(main())
