"""setuptools' commands, and what they make: the kernels' C, the pages, the nodes' program, a bill of materials."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

import numpy as np
from pages import make_pages
from sbom import bill_of_materials
from setuptools import Extension
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

from phalanx_compiler.flags import FLAGS as FLAGS_OF_KERNELS

# The trusted nodes as a program, for robots that have no board (firmware/ports/process.c).
PROGRAM = "trusted_node"
SOURCES = [
    *(f"src/{name}" for name in ("hash", "mac", "bucket", "node", "snode", "anode", "hardened", "seal")),
    *(f"line/{name}" for name in ("frame", "calls", "keep", "robot", "serve")),
    "ports/process",
]
FLAGS = ["-std=c99", "-Wall", "-Wextra", "-O2", "-g0", "-s", "-ffile-prefix-map=firmware=."]


# Kernels, translated to C when the package is built (docs/reference/kernels.md).
# Strict floating point: replay compares bytes.
KERNELS = Extension(
    "phalanx._kernels",
    sources=["build/kernels/_kernels.c"],
    include_dirs=[np.get_include()],
    extra_compile_args=[
        *FLAGS_OF_KERNELS,
        *["-Wall", "-Wextra", "-Wno-missing-braces", "-Wno-unused-parameter"],
        *["-Wno-unused-but-set-variable", "-Wno-unused-function"],
        f"-ffile-prefix-map={Path.cwd()}=.",
    ],
    libraries=["m"],
    py_limited_api=True,
)


class BuildExt(build_ext):
    """Compile the trusted nodes, then the kernels: their C takes constants from the nodes' headers."""

    def finalize_options(self) -> None:
        """Put the kernels last."""
        super().finalize_options()
        self.extensions.sort(key=lambda each: each.name == KERNELS.name)

    def run(self) -> None:
        """Compile. Raises: SystemExit: there is no C compiler."""
        compiler = os.environ.get("CC", sysconfig.get_config_var("CC")).split()[0]
        if not shutil.which(compiler):
            raise SystemExit(
                f"error: no C compiler: {compiler} is not here; hint: apt-get install gcc libc6-dev, or set CC"
            )
        super().run()

    def build_extension(self, ext: Extension) -> None:
        """Translate the kernels first. Raises: SystemExit: a kernel is outside the subset; its line was printed."""
        if ext.name == KERNELS.name:
            # A build for another machine takes the constants from the nodes of this one, which are built in place.
            crossing = "_PYTHON_HOST_PLATFORM" in os.environ
            nodes = (
                Path("src/phalanx") if crossing else Path(self.get_ext_fullpath("phalanx._firmware_hardened")).parent
            )
            self._translate(Path(ext.sources[0]), nodes.resolve())
        super().build_extension(ext)

    @staticmethod
    def _translate(source: Path, nodes: Path) -> None:
        source.parent.mkdir(parents=True, exist_ok=True)
        env = os.environ | {"PYTHONPATH": os.pathsep.join([".", "src", *filter(None, sys.path)])}
        command = [sys.executable, "-m", "phalanx_compiler.generate", source, "src/phalanx", nodes]
        if subprocess.run(command, env=env, check=False).returncode:
            raise SystemExit(1)


def make_program(folder: Path) -> None:
    """Compile it into a folder. Raises: CalledProcessError: the compiler said why."""
    compiler = os.environ.get("CC", sysconfig.get_config_var("CC")).split()
    where = [f"-Ifirmware/{name}" for name in ("include", "port", "src")]
    sources = [f"firmware/{name}.c" for name in SOURCES]
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run([*compiler, *FLAGS, *where, *sources, "-o", folder / PROGRAM], check=True)


def copy_documents(folder: Path) -> None:
    """Copy what `phalanx docs` prints into a folder: whoever installed a wheel has no clone to read it in."""
    for name in ("docs", "examples", "deploy"):
        shutil.copytree(name, folder / name, ignore=shutil.ignore_patterns("img", "evidence", "*.csv", "__pycache__"))


class BuildPy(build_py):
    """With the pages, the nodes' program and the documents; an editable install has the pages from `make setup`."""

    def run(self) -> None:
        """Make the pages first."""
        if not self.editable_mode:
            make_pages()
        super().run()
        package = Path("src" if self.editable_mode else self.build_lib) / "phalanx"
        make_program(package)
        if not self.editable_mode:
            copy_documents(package / "documents")


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
