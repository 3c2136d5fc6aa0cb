"""What a bundled controller declares, in its file in bundled/: there is no other list of them.

Beside its `CONTROLLER` such a file has six kernels, each named and called as in dispatch.py, less the number. It keeps
the rules of python_controller.py; its state is its own encoding, and `is_encoding` lets no other through.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from phalanx.config.flock import FlockConfig
from phalanx.wire.record import Record

if TYPE_CHECKING:  # whoever asks for names need not wait for a compiler
    from .fields import Params


@dataclass(frozen=True, slots=True, kw_only=True)
class Declaration:
    """What a controller's robots have to be.

    Args:
        reads: record of its sensor; with `commands` it says which body it drives (sim/audited/body.py).
        commands: record of its actuators.
        says: record that it broadcasts, in which the sender is where `state` has it.
        params: what kernels are given of a scenario's parameters; None for one that scenarios do not run.
    """

    reads: Record
    commands: Record
    says: Record
    params: Callable[[FlockConfig], Params] | None = None


def bundled() -> list[str]:
    """Names of the bundled controllers: those of their files."""
    # phalanx.kernel looks for this: what lies there is what compiled code depends on.
    return sorted(file.stem for file in Path(__file__).parent.glob("bundled/[a-z]*.py"))
