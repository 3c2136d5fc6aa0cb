"""Imports point one way: a package imports itself and anything strictly below it."""

from __future__ import annotations

import ast
import functools
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SRC, COMPILER = ROOT / "src" / "phalanx", ROOT / "phalanx_compiler"
LAYERS = [
    "errors _kernels",
    "binary",
    "kernel loading arrays",
    "config bundle",
    "wire pool _firmware_hardened _firmware_paper",
    "crypto",
    "link mission bti",
    "robot",
    "scenarios",
    "recording",
    "world net",
    "attacks",
    "gateway daemon papers",
    "lab bridges",
    "cli",
]
RANK = {package: i for i, row in enumerate(LAYERS) for package in row.split()}
LAYERS_OF_COMPILER = [
    "errors flags sources violations value_types",
    "parsing calling library",
    "writes constants assigned needed",
    "intrinsics",
    "typed_expressions",
    "typed",
    "values",
    "expressions",
    "calls",
    "statements",
    "unit",
    "own generate",
    "fresh",
]
RANK_IN_COMPILER = {module: i for i, row in enumerate(LAYERS_OF_COMPILER) for module in row.split()}
# The compiler knows the package only by its name, to import its kernels.
IMPORTS_KERNELS = {"generate.py", "fresh.py"}
# It stands above the simulator and does not import it: the process of a real robot.
APART = {"daemon": {"world"}}
# The one door upwards: people look for link.Server, which needs sockets (docs/adr/0003).
DOORS = {("link/__init__.py", "net")}
# No clock, socket, random source or await below the files of recordings: time and nonces are arguments.
IMPURE = {"asyncio", "socket", "time", "random", "secrets", "os", "subprocess", "threading", "aiomqtt", "aiohttp"}
PURE_BELOW = RANK["recording"]
# They read whether kernels are to run uncompiled, and look at nothing that a kernel could see.
HOUSEKEEPING = {"binary.py", "kernel.py"}
LONGEST = 400
# What auditors replay of a mission knows no function whose last bit depends on a machine, or on a Python.
REPLAYED = ("mission/walk", "mission/pose", "robot/controllers/mission")
EXACT = {"sqrt", "radians", "isnan", "isfinite", "inf", "nan", "pi", "floor", "ceil"}


def modules():
    return sorted(SRC.rglob("*.py"))


def floor_of(path: Path) -> str:
    return path.relative_to(SRC).parts[0].removesuffix(".py")


def compiler_modules():
    return sorted(each for each in COMPILER.glob("*.py") if each.name != "__init__.py")


@functools.cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


@functools.cache
def imported_names(path: Path) -> set[str]:
    root = SRC if path.is_relative_to(SRC) else COMPILER
    package = [root.name, *path.relative_to(root).parts[:-1]]
    names = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            names |= {f"{module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "import_module":
            names |= {arg.value for arg in node.args if isinstance(arg, ast.Constant)}
    return names


def check_import(importer: str, imported: str, path: object = "") -> None:
    below = RANK[imported] < RANK[importer] and imported not in APART.get(importer, ())
    assert importer == imported or below, f"{importer} -> {imported} {path}"


# One test for all files of a kind: a test of each would take longer to be collected than to run.
@pytest.mark.parametrize("floor", sorted({floor_of(path) for path in modules()}))
def test_imports_point_down(floor):
    here = {"__main__": "cli"}.get(floor, floor)
    assert here in (*RANK, "__init__"), f"{here} is not a floor of the house"
    for path in (each for each in modules() if floor_of(each) == floor):
        for name in imported_names(path):
            parts = name.split(".")
            if parts[0] != "phalanx" or parts[1:2] in (["__version__"], []):
                continue
            assert here != "__init__", f"{path} imports {name}"
            if (str(path.relative_to(SRC)), parts[1]) not in DOORS:
                check_import(here, parts[1], path)


def test_the_compilers_imports_point_down():
    for path in compiler_modules():
        for name in imported_names(path):
            package, *module = name.split(".")
            if package == "phalanx_compiler":
                assert RANK_IN_COMPILER[module[0]] < RANK_IN_COMPILER[path.stem], f"{path.stem} -> {module[0]}"
            assert package != "phalanx" or path.name in IMPORTS_KERNELS, f"{path}: the package imports the compiler"


def test_protocols_are_pure():
    below = [path for path in modules() if RANK.get(floor_of(path), 99) < PURE_BELOW and path.name not in HOUSEKEEPING]
    for path in below:
        assert not {name.split(".")[0] for name in imported_names(path)} & IMPURE, path
        assert not any(isinstance(node, ast.AsyncFunctionDef | ast.Await) for node in ast.walk(parsed(path))), path


def test_a_forbidden_import_is_caught():
    for importer, imported in (
        ("link", "net"),
        ("world", "net"),
        ("net", "world"),
        ("crypto", "link"),
        ("daemon", "world"),
    ):
        with pytest.raises(AssertionError):
            check_import(importer, imported)


def test_files_hold_one_concept():
    long = {
        path.name: n
        for path in [*modules(), *compiler_modules()]
        if (n := len(path.read_text().splitlines())) > LONGEST
    }
    assert not long


def test_a_reading_passes_few_files_on_its_way_to_its_token():
    command = [sys.executable, str(ROOT / "scripts" / "files_of_a_reading.py"), "--names"]
    environment = os.environ | {"PHALANX_PURE": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_file_is_named_for_nothing():
    nothing = {"utils.py", "helpers.py", "common.py", "base.py", "misc.py"}
    assert not [path for path in [*modules(), *compiler_modules()] if path.name in nothing]


@pytest.mark.parametrize("folder", REPLAYED)
def test_what_is_replayed_of_a_mission_has_the_same_bits_everywhere(folder: str) -> None:
    for path in (SRC / folder).glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "math":
                assert node.attr in EXACT, f"{path.name}: math.{node.attr}"
