"""The files that come with the package: scenarios, missions, maps of buildings."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

DATA = Path(__file__).parents[1] / "data"


def built_in(kind: Literal["scenarios", "missions", "maps"]) -> dict[str, Path]:
    """The YAML files of a kind, each by its name without the ending, in order."""
    return {path.stem: path for path in sorted((DATA / kind).glob("*.yaml"), key=lambda path: path.stem)}
