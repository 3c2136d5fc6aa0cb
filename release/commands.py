"""setuptools' commands, and what they do beside: pages and the nodes' program, and a wheel's bill of materials."""

from __future__ import annotations

import json
import shutil
import subprocess
import sysconfig
from pathlib import Path
from typing import Any

from pages import make_pages
from sbom import bill_of_materials
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

# The trusted nodes as a program, for robots that have no board (firmware/ports/process.c).
PROGRAM = "trusted_node"
SOURCES = [
    *(f"src/{name}" for name in ("hash", "mac", "bucket", "node", "snode", "anode", "bound", "seal")),
    *(f"line/{name}" for name in ("frame", "calls", "keep", "robot", "serve")),
    "ports/process",
]
FLAGS = ["-std=c99", "-Wall", "-Wextra", "-O2", "-g0", "-s", "-ffile-prefix-map=firmware=."]


def make_program(folder: Path) -> None:
    """Compile it into a folder. Raises: CalledProcessError: the compiler said why."""
    compiler = sysconfig.get_config_var("CC").split()
    where = [f"-Ifirmware/{name}" for name in ("include", "port", "src")]
    sources = [f"firmware/{name}.c" for name in SOURCES]
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run([*compiler, *FLAGS, *where, *sources, "-o", folder / PROGRAM], check=True)


class BuildPy(build_py):
    """With the pages and the nodes' program; an editable install has the pages from `make setup`."""

    def run(self) -> None:
        """Make the pages first."""
        if not self.editable_mode:
            make_pages()
        super().run()
        make_program(Path("src" if self.editable_mode else self.build_lib) / "phalanx")


class Sdist(sdist):
    """With the pages: who builds from it needs no node."""

    def run(self) -> None:
        """Make the pages first."""
        make_pages()
        super().run()


class BdistWheel(bdist_wheel):
    """Nothing in it from an earlier build, and a bill of materials."""

    def run(self) -> None:
        """Begin with an empty folder: setuptools would pack what modules were once called."""
        shutil.rmtree(self.get_finalized_command("build").build_base, ignore_errors=True)
        super().run()

    def write_wheelfile(self, wheelfile_base: str, *more: Any) -> None:
        """Add the bill of materials, where PEP 770 has it."""
        super().write_wheelfile(wheelfile_base, *more)
        folder = Path(wheelfile_base) / "sboms"
        folder.mkdir(exist_ok=True)
        bill = bill_of_materials(self.distribution.get_version())
        (folder / "phalanx-swarm.cdx.json").write_text(json.dumps(bill, indent=1) + "\n", encoding="utf-8")
        # Whoever checked out the sources has a umask, which is nobody else's business.
        for path in Path(self.bdist_dir).rglob("*"):
            runs = path.is_dir() or path.suffix == ".so" or path.name == PROGRAM or path.parent.name == "scripts"
            path.chmod(0o755 if runs else 0o644)
