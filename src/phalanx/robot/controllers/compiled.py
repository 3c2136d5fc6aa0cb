"""Python objects for compiled controllers."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from phalanx.arrays import Params
from phalanx.errors import UsageError
from phalanx.kernel import reading_peer
from phalanx.wire.fields import row
from phalanx.wire.record import MalformedRecord
from phalanx.wire.table import ENTRY_HEADER_BYTES, PACKET_MAX

from . import dispatch
from .python_controller import Controller, Output, unpack_outputs

OUT_BYTES = 64  # more than the outputs of any bundled controller in one step
OWN_OUT_BYTES = 2 * (ENTRY_HEADER_BYTES + PACKET_MAX)  # as in compiled code (bti/work.py)


def compiled(kind: int, params: Params) -> Callable[[int], Controller]:
    """Return a function that makes the controller of this number (dispatch.NUMBERS, or 0) for a robot's id."""
    make: Any = partial(_Compiled, kind=kind, params=params)
    make.state_bytes = int(dispatch.capacity(kind, params))  # read by scenarios
    made: Callable[[int], Controller] = make
    return made


class _Compiled(Controller):
    def __init__(self, rob_id: int, *, kind: int, params: Params) -> None:
        if not 1 <= rob_id <= 0xFFFF:
            raise UsageError(f"robot id is {rob_id}", "1 to 65535")
        super().__init__(rob_id)
        self._kind, self._params = int(kind), params
        self.state_bytes = int(dispatch.capacity(self._kind, params))  # type: ignore[misc] # depends on the parameters
        self._state = np.zeros(self.state_bytes, np.uint8)
        self._out = np.zeros(OUT_BYTES if kind < dispatch.FIRST_OWN else OWN_OUT_BYTES, np.uint8)
        dispatch.begin(self._kind, params, rob_id, self._state)

    def encode(self) -> bytes:
        return self._state[: dispatch.size(self._kind, self._state)].tobytes()

    def decode(self, encoding: bytes) -> None:
        state = row(encoding)
        with reading_peer():
            is_encoding = dispatch.is_encoding(self._kind, self._params, self.rob_id, state, len(encoding))
        if not is_encoding:
            raise MalformedRecord(f"checkpoint is not a state of robot {self.rob_id}")
        self._state[: len(encoding)] = state

    def on_recv(self, t_ms: int, packet: bytes) -> None:
        with reading_peer():
            dispatch.on_recv(self._kind, self._params, self.rob_id, t_ms, row(packet), len(packet), self._state)

    def on_advice(self, advice: bytes) -> None:
        with reading_peer():
            dispatch.on_advice(self._kind, self._params, self.rob_id, row(advice), len(advice), self._state)

    def on_input(self, step: int, t_ms: int, reading: bytes) -> list[Output]:
        n = dispatch.on_input(
            self._kind, self._params, self.rob_id, step, t_ms, row(reading), len(reading), self._state, self._out
        )
        return unpack_outputs(self._out[:n].tobytes())
