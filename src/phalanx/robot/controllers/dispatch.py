"""The bundled controllers by number, so that one compiled loop runs whichever a mission has chosen.

Number 0, and any that is not bundled, holds a state of no bytes and puts out nothing.
"""

from __future__ import annotations

from enum import IntEnum

from phalanx.kernel import kernel

from . import flock, wheels
from .fields import Params, Row, whole


class Kind(IntEnum):
    """A bundled controller."""

    FLOCK = 1
    WHEELS = 2


FLOCK, WHEELS = int(Kind.FLOCK), int(Kind.WHEELS)


@kernel
def capacity(kind: int, params: Params) -> int:
    """The longest that a state gets, bytes: what its row must hold."""
    if kind == FLOCK:
        return whole(flock.capacity(params))
    if kind == WHEELS:
        return whole(wheels.CAPACITY_BYTES)
    return 0


@kernel
def size(kind: int, state: Row) -> int:
    """The length of the encoding that `state` holds now."""
    if kind == FLOCK:
        return flock.size(state)
    if kind == WHEELS:
        return wheels.size(state)
    return 0


@kernel
def begin(kind: int, params: Params, rob_id: int, state: Row) -> int:
    """The boot state is in `state`; its length."""
    if kind == FLOCK:
        return flock.begin(params, whole(rob_id), state)
    if kind == WHEELS:
        return wheels.begin(params, whole(rob_id), state)
    return 0


@kernel
def is_encoding(kind: int, params: Params, rob_id: int, state: Row, length: int) -> bool:
    """Whether the first `length` bytes are a state of this robot; ask it of every foreign checkpoint."""
    if kind == FLOCK:
        return flock.is_encoding(params, whole(rob_id), state, whole(length))
    if kind == WHEELS:
        return wheels.is_encoding(params, whole(rob_id), state, whole(length))
    return False


@kernel
def on_recv(kind: int, params: Params, rob_id: int, t_ms: int, frame: Row, length: int, state: Row) -> int:
    """A frame was heard; the new length of the encoding."""
    if kind == FLOCK:
        return flock.on_recv(params, whole(rob_id), whole(t_ms), frame, whole(length), state)
    if kind == WHEELS:
        return wheels.on_recv(params, whole(rob_id), whole(t_ms), frame, whole(length), state)
    return 0


@kernel
def on_input(
    kind: int, params: Params, rob_id: int, step: int, t_ms: int, reading: Row, length: int, state: Row, out: Row
) -> int:
    """The sensors said something; the length of what is in `out` (outputs.py)."""
    if kind == FLOCK:
        return flock.on_input(params, whole(rob_id), whole(step), whole(t_ms), reading, whole(length), state, out)
    if kind == WHEELS:
        return wheels.on_input(params, whole(rob_id), whole(step), whole(t_ms), reading, whole(length), state, out)
    return 0
