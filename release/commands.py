"""setuptools' commands, and what they do beside: pages are made, and the wheel carries its bill of materials."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from pages import make_pages
from sbom import bill_of_materials
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist


class BuildPy(build_py):
    """With the pages; an editable install has them from `make setup`."""

    def run(self) -> None:
        """Make the pages first."""
        if not self.editable_mode:
            make_pages()
        super().run()


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
            path.chmod(0o755 if path.is_dir() or path.suffix == ".so" else 0o644)
