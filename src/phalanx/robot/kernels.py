"""Names for compiled controllers of your own (docs/guides/own-controller.md)."""

from phalanx.arrays import Params
from phalanx.kernel import kernel
from phalanx.wire import table
from phalanx.wire.fields import (
    Row,
    are_fine,
    copy,
    get_f32,
    get_i8,
    get_u16,
    get_u32,
    get_u64,
    put_f32,
    put_head,
    put_u16,
    put_u32,
    put_u64,
    same,
    whole,
)

from .controllers import neighbours
from .controllers.declaration import Declaration
from .controllers.flock_law import limited
from .controllers.sine import sine, sine_cosine

__all__ = [
    "Declaration",
    "Params",
    "Row",
    "are_fine",
    "copy",
    "get_f32",
    "get_i8",
    "get_u16",
    "get_u32",
    "get_u64",
    "kernel",
    "limited",
    "neighbours",
    "put_f32",
    "put_head",
    "put_u16",
    "put_u32",
    "put_u64",
    "same",
    "sine",
    "sine_cosine",
    "table",
    "whole",
]
