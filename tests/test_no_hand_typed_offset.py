"""No offset, width or tag is typed by hand outside wire/: what reads or writes bytes takes them from the table."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

SRC = Path(__file__).parent.parent / "src" / "phalanx"
FLOORS = ("bti", "mission", "robot", "sim", "gateway", "experiments", "demo", "daemon", "cli")
# Which arguments of the calls that take bytes apart say where: their positions and names.
PLACES = {
    **dict.fromkeys(("get_u16", "get_u32", "get_u64", "get_f32", "get_i8"), ((1,), ("at",))),
    **dict.fromkeys(("put_u16", "put_u32", "put_u64", "put_f32"), ((1,), ("at",))),
    **dict.fromkeys(("copy", "same"), ((1, 3, 4), ("to_at", "one_at", "source_at", "other_at", "length"))),
    "are_fine": ((1, 2), ("at", "count")),
    **dict.fromkeys(("take", "number", "behind"), ((0,), ("count",))),
}
# Names that bytes go by, beside what is declared or made as such.
BYTES = frozenset({"frame", "reading", "command", "payload", "treq", "auth_s", "auth_a", "state", "checkpoint"})
DECLARED = {"Row", "bytes", "bytearray", "memoryview"}
MAKERS = {"bytes", "bytearray", "memoryview", "row", "tobytes", "digest", "sha3_256", "sha1", "sha256", "scrypt"}
MAKERS |= {"hkdf_sha256", "urlsafe_b64decode", "take", "behind", "to_bytes", "fromhex", "urandom"}
FIRST_BYTE = ":1"  # of what may be empty
LAYOUT = re.compile(r"[<>=!]\d*[a-zA-Z?][\w?]*")  # a struct's, or numpy's
ALLOWED = {
    # The digest of a run is over numbers that nobody reads again.
    *(("world/missions/report.py", what) for what in ("struct", "'<3q'", "'<i'")),
    ("mission/landmarks/gridmap.py", "'>u2'"),  # a PGM picture
    # Bits and bytes that are wrong on purpose, wherever they lie.
    ("attacks/missions/files.py", "altered[]"),
    *(("lab/determinism/calls.py", what) for what in ("'<u4'", "'<f4'", "b'\\xff'", "frame[]", "usual[]")),
    # A hash's input is patched in eight bytes at a time, wherever it is told.
    *(("papers/missions/fig8c.py", what) for what in ("trial[]", "to_bytes")),
    ("papers/table.py", "data[]"),  # lines of text
    ("bridges/ros2/node.py", "bytes"),  # a level of ROS is a byte
}


@dataclass(frozen=True)
class Known:
    """Names, where a line stands: those of bytes, and those of numbers that were typed."""

    held: frozenset[str] = BYTES
    typed: frozenset[str] = frozenset()

    def literal(self, node: ast.expr | None) -> bool:
        """Whether a number other than 0 is typed in it; what an index in brackets holds is another matter."""
        if node is None or isinstance(node, ast.Subscript):
            return False
        if isinstance(node, ast.Constant):
            return type(node.value) is int and node.value != 0
        if isinstance(node, ast.Name):
            return node.id in self.typed
        return any(self.literal(child) for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr))

    def bytes(self, node: ast.expr) -> bool:
        """Whether it is bytes, as far as its name or its maker tells."""
        return name_of(node.func) in MAKERS if isinstance(node, ast.Call) else name_of(node) in self.held


def name_of(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def declared(annotation: ast.expr | None) -> bool:
    """Whether that says bytes; or none."""
    if isinstance(annotation, ast.BinOp):
        return declared(annotation.left) or declared(annotation.right)
    return annotation is not None and name_of(annotation) in DECLARED


def own(scope: ast.AST) -> Iterator[ast.AST]:
    """All that stands in a function, a class or a module, and not in a function inside."""
    for node in ast.iter_child_nodes(scope):
        yield node
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield from own(node)


def inside(scope: ast.AST, known: Known) -> Known:
    """What is known of names in a scope: by its parameters, and by what is assigned there."""
    held, typed, other = set(known.held), set(known.typed), set()
    if isinstance(scope, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
        given = (*scope.args.posonlyargs, *scope.args.args, *scope.args.kwonlyargs)
        names = {each.arg for each in given}
        held, typed = held - names, typed - names
        held |= {each.arg for each in given if declared(each.annotation)}
        if isinstance(scope, ast.Lambda):
            held |= names & BYTES
    for node in own(scope):
        match node:
            case ast.AnnAssign(target, annotation) if declared(annotation):
                held.add(name_of(target))
            case ast.Assign([ast.Tuple(targets)], ast.Tuple(values)) if len(targets) == len(values):
                typed |= {name_of(a) for a, b in zip(targets, values, strict=True) if is_number(b)}
            case ast.Assign([ast.Tuple(targets)], ast.Call(ast.Name("range"))):
                typed |= {name_of(each) for each in targets}
            case ast.Assign([target], value) | ast.AnnAssign(target, _, value) | ast.NamedExpr(target, value):
                if is_number(value):
                    typed.add(name_of(target))
                elif isinstance(value, ast.Call) and name_of(value.func) in MAKERS:
                    held.add(name_of(target))
                else:
                    other.add(name_of(target))
            case ast.For(target, ast.Call(ast.Name("range"), args)) if any(map(is_number, args)):
                typed.add(name_of(target))
            case ast.For(target):
                other.add(name_of(target))
    return replace(known, held=frozenset(held - {""}), typed=frozenset(typed - other - {""}))


def is_number(node: ast.expr | None) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) is int and node.value != 0


def is_place(node: ast.expr) -> bool:
    return name_of(node).split("_")[-1] == "at"


def is_tag(node: ast.expr) -> bool:
    return name_of(node).isupper()


def typed_by_hand(scope: ast.AST, known: Known | None = None) -> Iterator[tuple[int, str]]:
    """(line, what) of each place where an offset into bytes is a number, or a byte of them."""
    known = inside(scope, known or Known())
    for node in own(scope):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield from typed_by_hand(node, known)
        else:
            yield from ((getattr(node, "lineno", 0), what) for what in faults(node, known))


def faults(node: ast.AST, known: Known) -> Iterator[str]:
    match node:
        case ast.Call(func, args, keywords):
            called = name_of(func)
            at, named = PLACES.get(called, ((), ()))
            places = [args[k] for k in at if k < len(args)] + [each.value for each in keywords if each.arg in named]
            if any(map(known.literal, places)):
                yield called
            if called in {"from_bytes", "to_bytes"}:
                yield called
            # A length, a count or a tag of one byte.
            if called == "bytes" and args and isinstance(args[0], ast.List) and not all(map(is_tag, args[0].elts)):
                yield called
        case ast.Subscript(value, where) if known.bytes(value) and ast.unparse(where) != FIRST_BYTE:
            parts = (where.lower, where.upper) if isinstance(where, ast.Slice) else (where,)
            if any(map(known.literal, parts)):
                yield f"{name_of(value)}[]"
        case ast.Compare(ast.Subscript(value, where), [ast.Eq() | ast.NotEq()], [right]):
            if known.bytes(value) and not isinstance(where, ast.Slice) and known.literal(right):
                yield f"{name_of(value)}[] == number"
        case ast.Assign([ast.Subscript(value, where)], right):
            if known.bytes(value) and not isinstance(where, ast.Slice) and is_number(right):
                yield f"{name_of(value)}[] = number"
        case ast.AugAssign(target, _, value) if known.held - BYTES and is_number(value) and is_place(target):
            yield f"{name_of(target)} += number"
        case ast.Import(names) if any(each.name == "struct" for each in names):
            yield "struct"
        case ast.ImportFrom("struct"):
            yield "struct"
        case ast.Constant(str(text)) if LAYOUT.fullmatch(text):
            yield repr(text)
        case ast.Constant(bytes(raw)) if re.search(rb"[^\0\n\t\x20-\x7e]", raw):
            yield repr(raw)


@pytest.mark.parametrize("floor", FLOORS)
def test_offsets_come_from_the_table(floor):
    found = [
        f"{path.relative_to(SRC)}:{line} {what}"
        for path in sorted((SRC / floor).rglob("*.py"))
        for line, what in typed_by_hand(ast.parse(path.read_text()))
        if (str(path.relative_to(SRC)), what) not in ALLOWED
    ]
    assert not found


def read_by_pages(text: str) -> list[str]:
    """Where a view of bytes is read in TypeScript, if a number is typed there."""
    places = re.findall(r"\.[gs]et(?:Big)?(?:Uint|Int|Float)\d+\(([^,)]*)", text)
    return [place for place in places if re.search(r"\d", place)]


def test_pages_take_offsets_from_what_is_made_of_the_table():
    web = SRC.parent.parent / "web"
    pages = [
        path for folder in ("client", "map", "visitor", "operator", "viewer") for path in (web / folder).rglob("*.ts*")
    ]
    assert any("getUint16(" in path.read_text() for path in pages)
    assert not [f"{path.name}: {place}" for path in pages for place in read_by_pages(path.read_text())]
    assert read_by_pages("x: left + step * record.getUint16(at + 2, true),") == ["at + 2"]


@pytest.mark.parametrize(
    "line",
    [
        "t = get_u32(frame, 8)",
        "t = get_u32(row=frame, at=8)",
        "put_u16(w.frame, 6, number)",
        "copy(c, 8, top, 0, HASH_BYTES)",
        "copy(c, AT_TOP, top, 0, 20)",
        "t = get_u32(q, at + 1)",
        "AT = 8\ndef take(q: Row) -> int:\n    return get_u32(q, AT)",
        "HEAD, TAIL = 8, 12\nmac = frame[HEAD:TAIL]",
        "def take(q: Row) -> int:\n    at = 5\n    return q[at]",
        "for k in range(3):\n    led[k] = command[RED + k]",
        "mac = frame[12:20]",
        "kind = w.frame[at + 2]",
        "def take(q: Row) -> int:\n    return q[5]",
        "def take(q: bytes | None) -> bytes:\n    return q[5:]",
        "async def take(q: bytes) -> bytes:\n    return q[5:]",
        "q: Row = world.reading\nq[5] = 0",
        "class A:\n    mark: bytes\ndef short(a: A) -> bytes:\n    return a.mark[:4]",
        "tail = lambda frame: frame[5:]",
        "name = sha3_256(salt)[:16]",
        "out = scrypt(what, salt, length=64)\nmark = out[:32]",
        "if frame[0] == 4:\n    pass",
        "def skip(q: Row, case: Case) -> None:\n    case.at += 1",
        "q: Row = out\nq[0] = 6",
        'COMMAND = struct.Struct("<BHQff")',
        "import struct",
        "from struct import unpack_from",
        'records = np.zeros((9, 3), "<u2")',
        'src = int.from_bytes(frame[a:b], "little")',
        'src = int.from_bytes(frame[a:b], byteorder="little")',
        "mission_id = reader.take(16)",
        "mission_id = reader.take(count=16)",
        "nodes = reader.number(4)",
        "out.append(bytes([len(text)]) + text)",
        "out = bytes([alias]) + core",
        'frame = b"\\x04" + body',
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
        "AT = RECORD.at('x')\nx = get_u32(frame, AT)",
        "MOST = 8\ndef f(frame: Row, at: int) -> int:\n    return frame[at] if at < MOST else 0",
        "for k in range(COUNT):\n    led[k] = command[RED + k]",
        'head = b"PHXM"',
        'sign = ">="',
    ],
)
def test_other_numbers_are_left_alone(line):
    assert not list(typed_by_hand(ast.parse(line)))
