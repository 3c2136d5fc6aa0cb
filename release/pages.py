"""The pages of a wheel: made from web/, or the build fails. A source distribution brings them made."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WEB = ROOT / "web"
PAGES = ROOT / "src/phalanx/gateway/pages"
MADE = PAGES / "built"
INSTALLED = WEB / "node_modules/.installed"
NODE_WANTED = (20, 19)


def make_pages() -> None:
    """The pages are there, and made of what web/ has now.

    Raises: SystemExit: they cannot be made; with a line that says why.
    """
    there = all((PAGES / page / "index.html").is_file() for page in ("visitor", "operator", "viewer"))
    from_sdist = (ROOT / "PKG-INFO").is_file()
    if there and (from_sdist or _is_newer(MADE, _sources())):
        return
    npm = _npm()
    if not _is_newer(INSTALLED, [WEB / "package-lock.json"]):
        _run(npm, "ci", "--no-audit", "--no-fund", "--loglevel=error")
        INSTALLED.touch()
    _run(npm, "run", "--silent", "build")
    MADE.touch()


def _sources() -> list[Path]:
    return [p for p in WEB.rglob("*") if p.is_file() and "node_modules" not in p.relative_to(WEB).parts]


def _is_newer(made: Path, sources: list[Path]) -> bool:
    return made.is_file() and all(made.stat().st_mtime >= source.stat().st_mtime for source in sources)


def _npm() -> str:
    npm, node = shutil.which("npm"), shutil.which("node")
    found = subprocess.run([node, "--version"], capture_output=True, text=True, check=False).stdout if node else ""
    version = tuple(int(part) for part in re.findall(r"\d+", found)[:2])
    if npm is None or version < NODE_WANTED:
        here = found.strip() or "none"
        raise SystemExit(
            f"error: the pages are made with npm and Node.js {'.'.join(map(str, NODE_WANTED))} or newer, {here} is here"
            "; hint: https://github.com/nodesource/distributions, or a source distribution, which has them made"
        )
    return npm


def _run(*command: str) -> None:
    if subprocess.run(command, cwd=WEB, check=False).returncode:
        raise SystemExit(f"error: the pages cannot be made: {' '.join(['npm', *command[1:]])} failed in {WEB.name}/")
