"""Declarations of compiled controllers: bundled ones in bundled/, and users' in their own files.

Beside its `CONTROLLER`, such a file has six kernels, and `on_advice` if planners advise it. Their names and arguments
are those in dispatch.py, without `kind`. A state is stored in its encoded form, and `is_encoding` rejects invalid ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phalanx.config.flock import FlockConfig
from phalanx.wire.record import Record

if TYPE_CHECKING:  # lets names be listed without loading numpy
    from phalanx.arrays import Params


@dataclass(frozen=True, slots=True, kw_only=True)
class Declaration:
    """Wire records and parameters of a controller; `reads` and `commands` determine the robot's body."""

    reads: Record  # sensor readings
    commands: Record  # commands to the actuators
    says: Record  # broadcasts; the sender's id is at the same offset as in `state`
    remembers: tuple[Record, ...]  # the state; the last record may occur any number of times
    advised: Record | None = None  # a planner's advice; the file then has a kernel `on_advice`
    config: type[Any] = FlockConfig  # type of the mission's parameters
    params: Callable[[Any], Params]  # makes the kernels' parameters from a config


# Declarations of users' files that were loaded, by name (own_kernels.py).
OWN: dict[str, Declaration] = {}


def bundled() -> list[str]:
    """Return the names of the bundled controllers, which are those of their files."""
    return sorted(file.stem for file in Path(__file__).parent.glob("bundled/[a-z]*.py"))
