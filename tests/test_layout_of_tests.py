"""How tests are laid out: what they share is in the kit, no test imports another, and files are short."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

TESTS = Path(__file__).parent
FILES = {str(path.relative_to(TESTS)): path for path in TESTS.rglob("*.py") if "node_modules" not in path.parts}
MOST_LINES = 400
# Each holds one concept; whoever shortens one takes it out.
LONGER = {
    "behaviour/observe.py",
    "kit/constructs.py",
    "kit/second_decoder.py",
    "mission/test_walker.py",
    "test_cli_sim.py",
    "test_docs.py",
    "test_dotbots.py",
    "test_far_planner.py",
    "test_firmware.py",
    "test_guarded.py",
    "test_kernel.py",
    "test_own_kernels.py",
    "test_protected.py",
    "test_protocols.py",
    "test_robot_alone.py",
    "test_robot_processes.py",
    "test_robot_swarm.py",
    "test_session_server.py",
    "test_sweep.py",
}
# Uses of other objects' private attributes by tests; fewer each time.
PRIVATE_USES = 219


def modules_of(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            yield node.module or ""
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def private_uses(tree: ast.AST) -> int:
    attributes = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute) and node.attr[0] == "_"]
    return sum(
        not (isinstance(node.value, ast.Name) and node.value.id in ("self", "cls"))
        for node in attributes
        if not node.attr.startswith("__") and node.attr != "_replace"  # a method of named tuples
    )


def test_no_test_is_imported():
    for name, path in FILES.items():
        imported = [module for module in modules_of(ast.parse(path.read_text())) if "test_" in module]
        assert not imported, name


def test_helpers_are_in_the_kit_and_say_what_they_hold():
    """Helpers of attacks stand beside them. The digests' cases and peers are run from outside."""
    for name, path in FILES.items():
        if name.startswith(("kit/", "attacks/")):
            assert ast.get_docstring(ast.parse(path.read_text())), name
        elif not name.startswith(("behaviour/", "peers/")):
            assert path.stem.startswith("test_") or name == "conftest.py", name


def test_only_files_that_are_listed_are_long():
    assert {name for name, path in FILES.items() if path.read_text().count("\n") > MOST_LINES} == LONGER


def test_private_attributes_are_not_used_more_than_they_were():
    outside = [path for name, path in FILES.items() if not name.startswith("kit/")]
    assert sum(private_uses(ast.parse(path.read_text())) for path in outside) <= PRIVATE_USES
