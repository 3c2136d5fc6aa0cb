"""Which program measured: every table says so, for another version may measure otherwise."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

from phalanx import __version__


def version() -> str:
    """Of this program; with the commit, if it runs from a checkout."""
    root = Path(__file__).parents[3]
    git = shutil.which("git")
    if git is None or not ((root / ".git").exists() and (root / "pyproject.toml").exists()):
        return __version__
    command = [git, "-C", str(root), "describe", "--always", "--dirty"]
    # Without the environment's word git would lock the index, and disturb whoever is committing.
    quiet = os.environ | {"GIT_OPTIONAL_LOCKS": "0"}
    try:
        found = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True, env=quiet)
    except (OSError, subprocess.SubprocessError):
        return __version__
    return f"{__version__} ({found.stdout.strip()})"
