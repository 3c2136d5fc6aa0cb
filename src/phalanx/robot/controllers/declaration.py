"""Declare a controller of kernels: a bundled one in its file in bundled/, a user's in a file of one's own.

Beside its `CONTROLLER` such a file has six kernels, and `on_advice` if planners advise it, each named and called as in
dispatch.py, less the number. It keeps the rules of python_controller.py; its state is its own encoding, and
`is_encoding` lets no other through.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phalanx.config.flock import FlockConfig
from phalanx.wire.record import Record

if TYPE_CHECKING:  # whoever asks for names need not wait for numpy
    from .parameters import Params


@dataclass(frozen=True, slots=True, kw_only=True)
class Declaration:
    """A controller's sensor, actuators, broadcasts and state, as records of the byte table, and its mission's config.

    With `reads` and `commands` it says which body it drives (sim/audited/body.py).
    """

    reads: Record  # of its sensor
    commands: Record  # of its actuators
    says: Record  # what it broadcasts, in which the sender is where `state` has it
    remembers: tuple[Record, ...]  # its state; the last one as often as there is more
    advised: Record | None = None  # by a planner; its file then has a kernel `on_advice`
    config: type[Any] = FlockConfig  # of what its mission says
    params: Callable[[Any], Params]  # what kernels are given of one


# Of users' files that were loaded, by the words that name them (own_kernels.py).
OWN: dict[str, Declaration] = {}


def bundled() -> list[str]:
    """Names of the bundled controllers: those of their files."""
    return sorted(file.stem for file in Path(__file__).parent.glob("bundled/[a-z]*.py"))
