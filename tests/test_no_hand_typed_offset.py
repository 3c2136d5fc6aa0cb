"""No offset, width or tag is typed by hand outside wire/: what reads or writes bytes takes them from the table."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

SRC = Path(__file__).parent.parent / "src" / "phalanx"
FLOORS = ("bti", "mission", "robot", "sim", "gateway")
# Which arguments of the calls that take bytes apart say where.
PLACES = {
    **dict.fromkeys(("get_u16", "get_u32", "get_u64", "get_f32", "get_i8"), (1,)),
    **dict.fromkeys(("put_u16", "put_u32", "put_u64", "put_f32"), (1,)),
    **dict.fromkeys(("copy", "same"), (1, 3, 4)),
    "are_fine": (1, 2),
    **dict.fromkeys(("take", "number", "behind"), (0,)),
}
# Names that bytes go by, beside parameters that are declared as such.
BYTES = {"frame", "reading", "command", "payload", "treq", "auth_s", "auth_a", "state", "checkpoint"}
DECLARED = {"Row", "bytes", "bytearray"}
FIRST_BYTE = ":1"  # of what may be empty
PACKERS = {"Struct", "pack", "unpack", "pack_into", "unpack_from", "iter_unpack", "calcsize"}
# The digest of a run is over numbers that nobody reads again.
ALLOWED = {("sim/missions/report.py", "struct.pack")}


def literals(node: ast.expr | None) -> bool:
    """Whether a number other than 0 is typed in it; what an index in brackets holds is another matter."""
    if node is None or isinstance(node, ast.Subscript):
        return False
    if isinstance(node, ast.Constant):
        return type(node.value) is int and node.value != 0
    return any(literals(child) for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr))


def name_of(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def typed_by_hand(tree: ast.AST, held: frozenset[str] = frozenset(BYTES)) -> Iterator[tuple[int, str]]:
    """(line, what) of each place where an offset into bytes is a number."""
    for node in ast.iter_child_nodes(tree):
        inside = held
        if isinstance(node, ast.FunctionDef):
            given = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
            rows = {a.arg for a in given if a.annotation is not None and name_of(a.annotation) in DECLARED}
            inside = (held - {a.arg for a in given}) | rows
        elif isinstance(node, ast.Call):
            called = name_of(node.func)
            if any(literals(node.args[k]) for k in PLACES.get(called, ()) if k < len(node.args)):
                yield node.lineno, called
            if isinstance(node.func, ast.Attribute) and name_of(node.func.value) == "struct" and called in PACKERS:
                yield node.lineno, f"struct.{called}"
            if isinstance(node.func, ast.Attribute) and called in {"from_bytes", "to_bytes"} and len(node.args) == 2:
                yield node.lineno, called
            # A length or a count of one byte.
            if called == "bytes" and node.args and isinstance(node.args[0], ast.List) and "len(" in ast.unparse(node):
                yield node.lineno, called
        elif isinstance(node, ast.Subscript) and name_of(node.value) in held:
            parts = (node.slice.lower, node.slice.upper) if isinstance(node.slice, ast.Slice) else (node.slice,)
            if ast.unparse(node.slice) != FIRST_BYTE and any(literals(part) for part in parts):
                yield node.lineno, f"{name_of(node.value)}[]"
        yield from typed_by_hand(node, inside)


@pytest.mark.parametrize("floor", FLOORS)
def test_offsets_come_from_the_table(floor):
    found = [
        f"{path.relative_to(SRC)}:{line} {what}"
        for path in sorted((SRC / floor).rglob("*.py"))
        for line, what in typed_by_hand(ast.parse(path.read_text()))
        if (str(path.relative_to(SRC)), what) not in ALLOWED
    ]
    assert not found


@pytest.mark.parametrize(
    "line",
    [
        "t = get_u32(frame, 8)",
        "put_u16(w.frame, 6, number)",
        "copy(c, 8, top, 0, HASH_BYTES)",
        "copy(c, AT_TOP, top, 0, 20)",
        "t = get_u32(q, at + 1)",
        "mac = frame[12:20]",
        "kind = w.frame[at + 2]",
        "def take(q: Row) -> int:\n    return q[5]",
        'COMMAND = struct.Struct("<BHQff")',
        'src = int.from_bytes(frame[a:b], "little")',
        "mission_id = reader.take(16)",
        "nodes = reader.number(4)",
        "out.append(bytes([len(text)]) + text)",
    ],
)
def test_an_offset_that_is_typed_by_hand_is_found(line):
    assert list(typed_by_hand(ast.parse(line)))


@pytest.mark.parametrize(
    "line",
    [
        "kind = frame[0]",
        "kind = frame[:1]",
        "put_u32(c, AT_T, 5)",
        "x, y = pose[1], pose[2]",
        "q = f.rx[i, 2]",
        "n = state[COUNT]",
    ],
)
def test_other_numbers_are_left_alone(line):
    assert not list(typed_by_hand(ast.parse(line)))
