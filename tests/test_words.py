"""Keep retired words out of names, and relative clauses out of docstrings' first words."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SOURCES = sorted((ROOT / "src" / "phalanx").rglob("*.py"))
CLAUSE = re.compile(r"(What|Whether|Who|Whom|Whose|Where)\b")
# Names that gave way, and what took their place. A name may return only with another meaning, and then leaves here.
RETIRED = {
    "tor": "auditor",
    "tee": "auditee",
    "frame_max_bytes": "packet_max_bytes",
    "put_out": "send_output",
    "bring_up": "flush_state",
    "overheard": "forward_state",
    "may_say": "may_send",
    "hear_of": "record_state",
    "is_news": "is_new_order",
    "are_kept": "keeps_promises",
    "told_apart": "mark_lookalikes",
    "told_by": "fuse_matches",
    "roomiest": "most_spacious_start",
    "sort_out": "clip_ranges",
    "as_known": "moved_to_pose",
    "seen_again": "fix_from_known",
    "sees_again": "pose_from_known",
    "give_keys": "provision_keys",
    "drift_words": "format_drift",
    "said_of": "trial_fields",
    "said_where": "position_in",
    "put_askew": "put_rotated",
    "nobody_was_hurt": "check_no_harm",
}


def names_in(tree: ast.AST) -> Iterator[str]:
    """Yield every name that a module binds or uses."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name):
                yield name
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                yield name


def clauses_in(tree: ast.AST) -> Iterator[str]:
    """Yield the first line of each docstring that begins with a relative clause."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            doc = ast.get_docstring(node) or ""
            if CLAUSE.match(doc):
                yield doc.splitlines()[0]


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_source_uses_a_retired_name_or_begins_a_docstring_with_a_clause(path):
    tree = ast.parse(path.read_text())
    retired = {name: RETIRED[name] for name in names_in(tree) if name in RETIRED}
    assert not retired, f"say instead: {retired}"
    assert list(clauses_in(tree)) == [], "begin with a verb, or name the thing"


def test_the_lint_finds_what_it_looks_for():
    tree = ast.parse('def f(tor):\n    """What it does."""\n    return tor.may_say\n')
    assert {name for name in names_in(tree) if name in RETIRED} == {"tor", "may_say"}
    assert list(clauses_in(tree)) == ["What it does."]
