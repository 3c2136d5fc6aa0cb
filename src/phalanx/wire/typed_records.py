"""Records of the byte table as dataclasses. Made by firmware/generate.py from src/phalanx/wire/table.py."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from . import table
from .record import Record
from .typed import Typed
from .widths import F32, U16, U64


@dataclass(frozen=True, slots=True)
class Reading(Typed):
    """Reading of the position sensor.

    Attributes:
        id: robot id.
        t: ms, sender's clock.
        x_m, y_m: position, world frame, m.
        vx_mps, vy_mps: velocity, world frame, m/s.
        beside: what further sensors say (`Senses` reads it).
    """

    RECORD: ClassVar[Record] = table.SENSOR

    id: U16 = field(default=0, kw_only=True)
    t: U64 = field(default=0, kw_only=True)
    x_m: F32
    y_m: F32
    vx_mps: F32
    vy_mps: F32
    beside: bytes = field(default=b"", kw_only=True)


@dataclass(frozen=True, slots=True)
class Command(Typed):
    """Command to the actuators.

    Attributes:
        id: robot id; 0: the sender's own.
        t: ms, sender's clock; 0: now.
        ax_mps2, ay_mps2: acceleration, world frame, m/s².
    """

    RECORD: ClassVar[Record] = table.ACCELERATION

    id: U16 = field(default=0, kw_only=True)
    t: U64 = field(default=0, kw_only=True)
    ax_mps2: F32
    ay_mps2: F32


@dataclass(frozen=True, slots=True)
class State(Typed):
    """Broadcast: position and velocity of a robot.

    Attributes:
        id: robot id; 0: the sender's own.
        t: ms, sender's clock; 0: now.
        x_m, y_m: position, world frame, m.
        vx_mps, vy_mps: velocity, world frame, m/s.
    """

    RECORD: ClassVar[Record] = table.STATE

    id: U16 = field(default=0, kw_only=True)
    t: U64 = field(default=0, kw_only=True)
    x_m: F32
    y_m: F32
    vx_mps: F32
    vy_mps: F32
