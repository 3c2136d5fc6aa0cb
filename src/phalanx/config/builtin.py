"""Data files of the package: scenarios, missions, maps of buildings."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

DATA = Path(__file__).parents[1] / "data"


def built_in(kind: Literal["scenarios", "missions", "maps"]) -> dict[str, Path]:
    """Return the YAML files of a kind by name, without the suffix, in alphabetical order."""
    return {path.stem: path for path in sorted((DATA / kind).glob("*.yaml"), key=lambda path: path.stem)}
