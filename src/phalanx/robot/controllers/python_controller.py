"""How a researcher writes a controller in plain Python, and the bundled ones behind the same interface.

An auditor feeds a copy of the controller the same readings and frames and compares every byte. A controller that can
answer the same inputs differently convicts honest robots. So:

- what it does depends on the mission, its robot's id, and the calls so far: no clock but `t_ms`, no random source, no
  file, no global that changes, no thread;
- nothing is iterated whose order can differ: no `set`, no `id()`, no `hash()` of a string;
- floats know + - * / and `math.sqrt`, in a written order. `math.sin`, `exp`, `**`, `sum` of an array and anything of a
  linear-algebra library differ between machines in the last bit (`controllers.sine` has a sine that does not);
- numbers are rounded once, where they become bytes;
- all that it remembers is in `encode()`, and `decode(encode())` changes nothing that follows. The easiest way to be
  sure is to keep nothing but those bytes, as the bundled ones do;
- it remembers a bounded number of bytes, however many others talk to it;
- frames come from liars, readings from the world: whatever they hold, nothing raises, and NaN goes no further.

Source: RoboRebound §3.7 (deterministic replay); docs/adr/0012-determinism-of-controllers.md.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from phalanx.errors import UsageError
from phalanx.kernel import reading_peer
from phalanx.wire.fields import row
from phalanx.wire.record import MalformedRecord
from phalanx.wire.table import ENTRY_ACMD, ENTRY_HEADER_BYTES, ENTRY_SEND, FRAME_MAX, KIND_AUDIT, OUTPUT

from . import dispatch
from .outputs import OUT_BYTES
from .parameters import Params
from .senses import Senses


@dataclass(frozen=True, slots=True)
class Send:
    """A frame for everybody in range."""

    payload: bytes


@dataclass(frozen=True, slots=True)
class Act:
    """A command to the actuators."""

    payload: bytes


Output = Send | Act
OWN_OUT_BYTES = 2 * (ENTRY_HEADER_BYTES + FRAME_MAX)  # as in compiled code (bti/work.py)


class OwnMistake(UsageError):
    """A researcher's class did what it must not; `whose` is the object that did it."""

    def __init__(self, message: str, hint: str, whose: object) -> None:
        super().__init__(message, hint)
        self.whose = whose


class Controller(ABC):
    """What decides for one robot. A new one is in its boot state.

    Args:
        rob_id: 1..65535.

    Class attributes:
        state_bytes: longest encoding; 0 for as much as the scenario has room for.
        reading_bytes: longest reading, of a robot whose driver has sensors of its own; 0 for the scenario's.
        senses: a lidar and bumpers, which simulations and arenas then have; their readings are as much longer.
        is_ours: it is tested that it answers the same inputs alike: a simulation replays what it did once, and not for
            each auditor. Of a researcher's own each replay may be the one that tells.
    """

    state_bytes: ClassVar[int] = 0
    reading_bytes: ClassVar[int] = 0
    senses: ClassVar[Senses | None] = None
    is_ours: ClassVar[bool] = False

    def __init__(self, rob_id: int) -> None:
        self.rob_id = rob_id

    @abstractmethod
    def encode(self) -> bytes:
        """All that it remembers: the checkpoint."""

    @abstractmethod
    def decode(self, encoding: bytes) -> None:
        """It remembers what this checkpoint says, and nothing else.

        Raises: PeerError: not what `encode` of this robot's controller can give.
        """

    @abstractmethod
    def on_recv(self, t_ms: int, frame: bytes) -> None:
        """A frame was heard at `t_ms` of the a-node's clock."""

    def on_advice(self, advice: bytes) -> None:  # noqa: B027 - most have no planner
        """A planner said something, whatever it is; what is done with it is the controller's own affair."""

    @abstractmethod
    def on_input(self, step: int, t_ms: int, reading: bytes) -> Iterable[Output]:
        """The sensors said something at `t_ms` of the s-node's clock, for the `step`th time from 0.

        Returns: what to do and to say, in the order in which it is put out: commands first.
        """


def compiled(kind: int, params: Params) -> Callable[[int], Controller]:
    """What makes the bundled controller of a number (dispatch.NUMBERS; 0 does nothing) for a robot's id, in Python."""
    return partial(_Compiled, kind=kind, params=params)


class _Compiled(Controller):
    """A bundled one; `longest_bytes` is what a scenario leaves room for."""

    def __init__(self, rob_id: int, *, kind: int, params: Params) -> None:
        if not 1 <= rob_id <= 0xFFFF:
            raise UsageError(f"robot id {rob_id}", "1 to 65535")
        super().__init__(rob_id)
        self._kind, self._params = int(kind), params
        self.longest_bytes = int(dispatch.capacity(self._kind, params))
        self._state = np.zeros(self.longest_bytes, np.uint8)
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

    def on_recv(self, t_ms: int, frame: bytes) -> None:
        with reading_peer():
            dispatch.on_recv(self._kind, self._params, self.rob_id, t_ms, row(frame), len(frame), self._state)

    def on_advice(self, advice: bytes) -> None:
        with reading_peer():
            dispatch.on_advice(self._kind, self._params, self.rob_id, row(advice), len(advice), self._state)

    def on_input(self, step: int, t_ms: int, reading: bytes) -> list[Output]:
        n = dispatch.on_input(
            self._kind, self._params, self.rob_id, step, t_ms, row(reading), len(reading), self._state, self._out
        )
        return unpack_outputs(self._out[:n].tobytes())


def checked_outputs(told: object, room: int, whose: object) -> list[Output]:
    """What a researcher's `on_input` returned, if it can be put out at all: of at most `room` bytes each.

    Raises: OwnMistake: no outputs, or one that no a-node lets out. Source: docs/own-controller.md.
    """
    if type(told) is not list and (not isinstance(told, Iterable) or isinstance(told, str | bytes)):
        raise OwnMistake(f"on_input returned {kind_of(told)}", "a list of Act and Send, empty for nothing", whose)
    outputs = list(told)
    for output in outputs:
        if not isinstance(output, Send | Act):
            raise OwnMistake(f"on_input put out {kind_of(output)}", "a list of Act and Send, empty for nothing", whose)
        if not isinstance(output.payload, bytes) or not 1 <= len(output.payload) <= room:
            what = f"{type(output).__name__} of {kind_of(output.payload)}"
            if not isinstance(output.payload, bytes):
                raise OwnMistake(f"on_input put out {what}", "bytes, as struct packs them", whose)
            raise OwnMistake(f"on_input put out {what}, {len(output.payload)} long", f"1 to {room} bytes", whose)
        if isinstance(output, Send) and output.payload[0] & KIND_AUDIT:
            raise OwnMistake(
                "on_input sends a frame that begins like one of the audits", "a first byte below 0x80", whose
            )
    return outputs


def checked_state(told: object, room: int, whose: object) -> bytes:
    """What a researcher's `encode` returned, if there is room for it: at most so many bytes.

    Raises: OwnMistake: not bytes, or too many. Source: docs/own-controller.md.
    """
    if not isinstance(told, bytes):
        raise OwnMistake(f"encode returned {kind_of(told)}", "bytes, as struct packs them; b'' for nothing", whose)
    if len(told) > room:
        raise OwnMistake(
            f"encode returned {len(told)} bytes", f"at most {room}, or state_bytes = {len(told)} in its class", whose
        )
    return told


def kind_of(told: object) -> str:
    """What was given instead, for people."""
    return "None" if told is None else type(told).__name__


def pack_outputs(outputs: Iterable[Output]) -> bytes:
    """Outputs as kernels put them out (outputs.py)."""
    return b"".join(
        OUTPUT.form.pack(ENTRY_SEND if isinstance(output, Send) else ENTRY_ACMD, len(output.payload)) + output.payload
        for output in outputs
    )


def unpack_outputs(packed: bytes) -> list[Output]:
    """The outputs of a kernel of ours, which are well formed."""
    outputs: list[Output] = []
    at = 0
    while at < len(packed):
        kind, length = OUTPUT.form.unpack_from(packed, at)
        begin, at = at + OUTPUT.size, at + OUTPUT.size + length
        outputs.append((Send if kind == ENTRY_SEND else Act)(packed[begin:at]))
    return outputs
