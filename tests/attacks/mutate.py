"""Which mistakes in the auditor the quick tests notice: one at a time, made by rule in what `KERNELS` names.

`python tests/attacks/mutate.py [--only check_chains] [--take 60 --seed N]`. A mistake counts as found when one of the
tests in `TESTS` fails with it, uncompiled, in a process of its own. Each that none finds is printed, and the exit code
is 1 unless mutants.json says why it changes nothing.
"""

from __future__ import annotations
import __future__

import argparse
import ast
import importlib
import inspect
import json
import os
import random
import resource
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pytest

HERE = Path(__file__).parent
SOURCES = HERE.parent.parent / "src" / "phalanx"
EQUIVALENT = HERE / "mutants.json"
# None of these simulates a swarm: uncompiled that takes minutes.
TESTS = ["test_refusals.py", "test_refusals_of_form.py", "test_room_of_audits.py", "test_door.py"]
# Modules, and which of their functions; all of them if none is named.
KERNELS = {
    "bti/audit": (),
    "bti/log": ("piece_at",),
    "bti/request": ("admit",),
    "robot/replay": ("replay_bundled", "_begin"),
    "robot/handlers": ("handle_audit", "store_fragment", "knock", "judge", "answer"),
}
FEW = 60  # mistakes: for so few it does not pay to see which tests run them
CPU_S = 20  # a mistake may be a loop without an end
OTHER_COMPARISON = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
ONLY_0 = ("case", "settings", "shape")
OTHER_SIGN = {ast.Add: ast.Sub, ast.Sub: ast.Add}
OTHER_NAME = {
    "INPUT": "RECV", "RECV": "SEND", "SEND": "ACMD", "ACMD": "SEND", "FLUSH_S": "FLUSH_A", "FLUSH_A": "FLUSH_S",
    "CHECKPOINT": "EVIDENCE", "EVIDENCE": "CHECKPOINT", "HARDENED": "PAPER", "PAPER": "HARDENED", "delta": "skew", "skew": "delta",
    "AT_TOP_S": "AT_TOP_A", "AT_TOP_A": "AT_TOP_S", "AT_S_TOP": "AT_A_TOP", "AT_A_TOP": "AT_S_TOP",
    "AT_DUE": "AT_STEP", "AT_STEP": "AT_DUE", "FRAGMENT": "TOKEN", "max": "min",
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One mistake: a function's code as it then is."""

    module: str
    function: str
    what: str
    line: int
    code: CodeType
    lines: frozenset[int]  # a test that runs none of them cannot find it

    @property
    def name(self) -> str:
        return f"{self.function}: {self.what}"


def _places(node: ast.AST) -> Iterator[tuple[ast.AST, str, int | None]]:
    """Every child that something else could stand for: its parent, the field, the index in it."""
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list", "args") and not isinstance(node, ast.Call):
            continue
        for index, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if isinstance(child, ast.AST):
                yield node, field, index
                yield from _places(child)


def _instead(parent: ast.AST, child: ast.AST, scope: dict) -> Iterator[ast.AST]:
    """What a mistake could have put in the child's place."""
    never, always = ast.Constant(False), ast.Constant(True)
    if isinstance(parent, (ast.If, ast.IfExp)) and child is parent.test:
        yield never
        yield always
    match child:
        case ast.Compare():
            for k, op in enumerate(child.ops):
                if other := OTHER_COMPARISON.get(type(op)):
                    made = deepcopy(child)
                    made.ops[k] = other()
                    yield made
        case ast.BoolOp():
            for k in range(len(child.values)):
                rest = child.values[:k] + child.values[k + 1 :]
                yield ast.BoolOp(child.op, rest) if len(rest) > 1 else rest[0]
            yield ast.BoolOp(ast.And() if isinstance(child.op, ast.Or) else ast.Or(), child.values)
        case ast.BinOp() if type(child.op) in OTHER_SIGN and not _is_zero(child.right, scope):
            yield ast.BinOp(child.left, OTHER_SIGN[type(child.op)](), child.right)
        case ast.Constant(value=int(n)) if not isinstance(child.value, bool):
            # These are arrays of one, or have one axis: any other index is no program.
            if not (isinstance(parent, ast.Subscript) and ast.unparse(parent.value).endswith(ONLY_0)):
                yield ast.Constant(n + 1)
        case ast.Name(id=name, ctx=ast.Load()) if name in OTHER_NAME:
            yield ast.Name(OTHER_NAME[name], ast.Load())
        case ast.Attribute(attr=name, ctx=ast.Load()) if name in OTHER_NAME:
            yield ast.Attribute(child.value, OTHER_NAME[name], ast.Load())
        case ast.AugAssign() | ast.Expr(value=ast.Call()):
            yield ast.Pass()
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
            yield ast.Pass()
        case ast.Continue():
            yield ast.Pass()


def mutants() -> Iterator[Mutant]:
    """All mistakes that the rules make."""
    for module, wanted in KERNELS.items():
        path = SOURCES / f"{module}.py"
        tree, lines = ast.parse(path.read_text()), path.read_text().splitlines()
        scope = vars(importlib.import_module(f"phalanx.{module.replace('/', '.')}"))
        for function in [each for each in tree.body if isinstance(each, ast.FunctionDef)]:
            if wanted and function.name not in wanted:
                continue
            seen: Counter[str] = Counter()
            for parent, field, index in list(_places(function)):
                was = getattr(parent, field) if index is None else getattr(parent, field)[index]
                for instead in list(_instead(parent, was, scope)):
                    ast.copy_location(instead, was)
                    ast.fix_missing_locations(instead)
                    what = f"{_said(was)} -> {_said(instead)} in: {lines[was.lineno - 1].strip()}"
                    seen[what] += 1
                    _put(parent, field, index, instead)
                    made = compile(ast.Module([function], []), path, "exec", __future__.annotations.compiler_flag)
                    _put(parent, field, index, was)
                    code = next(each for each in made.co_consts if isinstance(each, CodeType))
                    again = f" (#{seen[what]})" if seen[what] > 1 else ""
                    at = {*range(was.lineno, was.end_lineno + 1), parent.lineno if hasattr(parent, "lineno") else 0}
                    yield Mutant(module, function.name, what + again, was.lineno, code, frozenset(at))


def _is_zero(node: ast.AST, scope: dict) -> bool:
    """Whether it is the offset of a first field: plus and minus are one."""
    try:
        return eval(ast.unparse(node), scope) == 0
    except NameError:
        return False


def _said(node: ast.AST) -> str:
    return " ".join(ast.unparse(node).split())


def _put(parent: ast.AST, field: str, index: int | None, node: ast.AST) -> None:
    if index is None:
        setattr(parent, field, node)
    else:
        getattr(parent, field)[index] = node


def _in_a_child(work: Callable[[], Any], most_s: int = resource.RLIM_INFINITY) -> Any:
    """What `work` returns, done in a process of its own; None if that takes longer, or ends by itself."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (most_s, most_s))
        sys.stdout = sys.stderr = Path(os.devnull).open("w")
        os.close(reading)
        with os.fdopen(writing, "w") as saying:
            saying.write(json.dumps(work()))
            saying.flush()
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as hearing:
        said = hearing.read()
    os.waitpid(child, 0)
    return json.loads(said) if said else None


def _fails(item: pytest.Item) -> bool:
    from _pytest.runner import runtestprotocol

    return any(report.failed for report in runtestprotocol(item, log=False, nextitem=None))


class Bench:
    """A pytest plugin: the tests are collected once, and those that run a mistake are run in a child for each."""

    def __init__(self, chosen: list[Mutant], known: dict[str, str]) -> None:
        self.chosen, self.known = chosen, known
        self.found: dict[Mutant, str | None] = {}  # by which test; None: it has no end

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        traced = len(self.chosen) > FEW
        ran = _in_a_child(lambda: self._lines_of(session.items, traced))
        if ran is None:
            sys.exit("there is a mistake before any was made")
        ran = [{tuple(each) for each in lines} for lines in ran]
        # The shorter first: most mistakes are found by any test.
        order = sorted(range(len(ran)), key=lambda k: len(ran[k]))
        for mutant in self.chosen:
            file = str(SOURCES / f"{mutant.module}.py")
            at = {(file, line) for line in mutant.lines}
            items = [session.items[k] for k in order if not traced or ran[k] & at]
            self.found[mutant] = _in_a_child(
                lambda mutant=mutant, items=items: self._first_failure(items, mutant), CPU_S
            )
            if self.found[mutant] == "" and mutant.name not in self.known:
                print(f"not found: {mutant.name} ({mutant.module}.py:{mutant.line})", flush=True)
        return True

    @staticmethod
    def _lines_of(items: list[pytest.Item], traced: bool) -> list[list[tuple[str, int]]]:
        """Which lines of kernels each test runs; none of them fails."""
        files = {str(SOURCES / f"{module}.py") for module in KERNELS}
        found = []
        for item in items:
            lines: set[tuple[str, int]] = set()

            def trace(frame, event, _, lines=lines):
                if frame.f_code.co_filename not in files:
                    return None
                lines.add((frame.f_code.co_filename, frame.f_lineno))
                return trace

            if traced:
                sys.settrace(trace)
            failed = _fails(item)
            sys.settrace(None)
            if failed:
                os._exit(1)
            found.append(sorted(lines))
        return found

    @staticmethod
    def _first_failure(items: list[pytest.Item], mutant: Mutant) -> str:
        module = importlib.import_module(f"phalanx.{mutant.module.replace('/', '.')}")
        inspect.unwrap(getattr(module, mutant.function)).__code__ = mutant.code
        return next((item.nodeid for item in items if _fails(item)), "")


def main() -> int:
    """Make them all, or some; print a score, and each that was not found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="those whose name has this in it: check_chains")
    parser.add_argument("--take", type=int, default=0, help="so many, drawn by chance; 0 is all")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    os.environ["PHALANX_PURE"] = "1"
    import pytest

    sys.path.insert(0, str(SOURCES.parent))
    made = list(mutants())
    known = json.loads(EQUIVALENT.read_text())
    if gone := set(known) - {each.name for each in made}:
        sys.exit(f"mutants.json explains what no rule makes any more: {sorted(gone)}")
    every = [each for each in made if options.only in each.name]
    if options.take:
        every = random.Random(options.seed).sample(every, min(options.take, len(every)))
    bench = Bench(every, known)
    pytest.main(["-q", "-p", "no:cacheprovider", *(str(HERE / name) for name in TESTS)], [bench])
    found = [each for each, by in bench.found.items() if by != ""]
    equal = [each for each in every if each not in found and each.name in known]
    wrong = [each for each in found if each.name in known]
    for each in wrong:
        print(f"found, though it should change nothing: {each.name} by {bench.found[each]}")
    counted = len(every) - len(equal)
    print(f"{len(found)} of {counted} mistakes found; {len(equal)} more change nothing")
    return int(len(found) < counted or bool(wrong) or not every)


if __name__ == "__main__":
    sys.exit(main())
