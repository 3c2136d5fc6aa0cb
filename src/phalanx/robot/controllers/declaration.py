"""Declare a controller of kernels: a bundled one in its file in bundled/, or a user's in the user's own file.

Beside its `CONTROLLER` such a file has six kernels, and `on_advice` if planners advise it, with the names and arguments
of dispatch.py without the number. A state is its own encoding, and `is_encoding` rejects every other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phalanx.config.flock import FlockConfig
from phalanx.wire.record import Record

if TYPE_CHECKING:  # names are listed without loading numpy
    from phalanx.arrays import Params


@dataclass(frozen=True, slots=True, kw_only=True)
class Declaration:
    """A controller's records of the byte table, and its parameters; `reads` and `commands` select the body."""

    reads: Record  # its sensor's readings
    commands: Record  # for its actuators
    says: Record  # its broadcasts; the sender stands where `state` has it
    remembers: tuple[Record, ...]  # its state; the last record repeats as often as there is more
    advised: Record | None = None  # a planner's advice; the file then has a kernel `on_advice`
    config: type[Any] = FlockConfig  # the mission's parameters
    params: Callable[[Any], Params]  # makes the kernels' parameters of a config


# Declarations of users' files that were loaded, by the words that name them (own_kernels.py).
OWN: dict[str, Declaration] = {}


def bundled() -> list[str]:
    """Return the names of the bundled controllers: those of their files."""
    return sorted(file.stem for file in Path(__file__).parent.glob("bundled/[a-z]*.py"))
