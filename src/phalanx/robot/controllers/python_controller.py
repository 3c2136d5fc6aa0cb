"""The interface of controllers in plain Python, and checks of their results.

An auditor passes the same readings and packets to a copy of the controller, and compares every byte. So auditors refuse
honest robots if their controller is not deterministic. Packets may come from compromised robots: no packet may raise
an exception, and NaN must not spread.
Source: RoboRebound §3.7; docs/guides/own-controller.md (all rules); docs/adr/0012.
"""

from __future__ import annotations

import dis
import inspect
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

from phalanx.errors import OwnFileError, UsageError
from phalanx.wire.packing import MAY_BE, Packing, Unfit, packing_of
from phalanx.wire.record import MalformedRecord
from phalanx.wire.table import ENTRY_ACMD, ENTRY_SEND, KIND_AUDIT, OUTPUT
from phalanx.wire.typed_records import Command, Reading, State

from .senses import Senses


@dataclass(frozen=True, slots=True)
class Send:
    """A packet to broadcast."""

    payload: bytes


@dataclass(frozen=True, slots=True)
class Act:
    """A command to the actuators."""

    payload: bytes


Output = Send | Act
Decision = Iterable[Command | State | Output]
RETURNS = ("RETURN_VALUE", "RETURN_CONST")
TYPED = {"on_input": "on_reading", "on_recv": "on_state"}  # what the default of each byte method calls


class OwnMistake(OwnFileError):
    """Error: the `method` of an object from a user's file broke a rule."""

    def __init__(self, message: str, hint: str, controller: object, method: str = "on_input") -> None:
        super().__init__(message, hint)
        self.controller, self.method = controller, method

    @property
    def places(self) -> Iterator[tuple[str, int]]:
        """Yield file and line of the methods that may be wrong, the likeliest first; then those of the class."""
        kind = self.controller if isinstance(self.controller, type) else type(self.controller)
        for name in (self.method, TYPED.get(self.method, "")):
            method: Any = getattr(kind, name, None)
            code = getattr(method and inspect.unwrap(method), "__code__", None)
            if code:
                found = (each.positions for each in dis.get_instructions(code) if each.opname in RETURNS)
                returns = {place.lineno for place in found if place}
                yield code.co_filename, (len(returns) == 1 and returns.pop()) or code.co_firstlineno
        with suppress(OSError, TypeError):
            yield inspect.getsourcefile(kind) or "", inspect.getsourcelines(kind)[1]


class Controller:
    """Base class of controllers: one object per robot, whose id is 1..65535. A new object is in its state at boot.

    Override `on_reading` and, to receive other robots' states, `on_state`. Assign to `self.memory` to store state. To
    work with bytes instead, override `on_input` for `on_reading`, `on_recv` for `on_state`, `encode` and `decode` for
    `memory`, and return `Act` and `Send` for `Command` and `State`. These can be overridden independently.

    Class attributes:
        memory: state at boot: a frozen dataclass, whose fields determine the encoding (wire/packing.py).
        state_bytes: longest encoding; 0 for the scenario's limit.
        reading_bytes: longest reading of a robot whose driver has further sensors; 0 for the scenario's.
        senses: lidar and bumpers that simulations and arenas append to each reading.
        is_ours: whether our tests show that it is deterministic; a simulation then replays it once for all auditors.
    """

    memory: Any = None
    state_bytes: ClassVar[int] = 0
    reading_bytes: ClassVar[int] = 0
    senses: ClassVar[Senses | None] = None
    is_ours: ClassVar[bool] = False
    _packing: ClassVar[Packing | None] = None
    _encoding = b""
    _has_booted = False

    def __init_subclass__(cls) -> None:
        if cls.encode is not Controller.encode:  # the state is in other attributes
            cls.__setattr__ = object.__setattr__  # type: ignore[method-assign,assignment]
        elif cls.memory is not None:
            try:
                kind: Any = type(cls.memory)
                cls._packing = packing_of(kind)
                cls._encoding, cls.memory = cls._packing.settle(cls.memory)
            except Unfit as error:
                raise OwnMistake(str(error), MAY_BE, cls) from error
            cls.state_bytes = max(cls.state_bytes, cls._packing.size or 0)

    def __init__(self, rob_id: int) -> None:
        self.rob_id = rob_id

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute; round a new memory as its encoding does, so that auditors continue from equal numbers."""
        if name == "memory" and self._packing:
            try:
                self.__dict__["_encoding"], value = self._packing.settle(value)
            except Unfit as error:
                raise OwnMistake(str(error), "use a value that fits its type", self) from error
        elif self._has_booted:
            what = f"{type(self).__name__} sets {name}, which no checkpoint holds"
            raise OwnMistake(what, "use a field of its memory", self)
        self.__dict__[name] = value

    # --- typed -------------------------------------------------------------------------------------------------------

    def on_reading(self, step: int, t_ms: int, reading: Reading) -> Decision:  # noqa: ARG002
        """Return commands, then `State`s, for the `step`th reading from 0, taken at `t_ms` of the s-node's clock."""
        hint = "define on_reading(self, step, t_ms, reading)"
        raise OwnMistake(f"{type(self).__name__} has no on_reading", hint, self)

    def on_state(self, t_ms: int, state: State) -> None:
        """Handle another robot's state, received at `t_ms` of the a-node's clock; it may be false."""

    # --- bytes -------------------------------------------------------------------------------------------------------

    def encode(self) -> bytes:
        """Return the encoded state, which goes into checkpoints."""
        self.__dict__["_has_booted"] = True
        return self._encoding

    def decode(self, encoding: bytes) -> None:
        """Restore the state from a checkpoint. Raises: PeerError: not an encoding of this robot's state."""
        if self._packing:
            self.memory = self._packing.decode(encoding)
        elif encoding:
            raise MalformedRecord(f"{len(encoding)} bytes of state for a controller without memory")

    def on_recv(self, t_ms: int, packet: bytes) -> None:
        """Handle a packet, received at `t_ms` of the a-node's clock."""
        state = State.find(packet)
        if state:
            self.on_state(t_ms, state)

    def on_advice(self, advice: bytes) -> None:
        """Handle a planner's advice, which may be any bytes."""

    def on_input(self, step: int, t_ms: int, reading: bytes) -> Iterable[Output]:
        """Return the outputs for a reading as bytes. At an invalid reading the robot coasts and broadcasts nothing."""
        size = Reading.RECORD.size
        seen = Reading.find(reading[:size], beside=reading[size:])
        if seen is None or (self.senses and not self.senses.is_readable(seen.beside)):
            return [Act(Command(0.0, 0.0).encode(self.rob_id, t_ms))]
        outputs: Any = self.on_reading(step, t_ms, seen)
        is_some = isinstance(outputs, Iterable) and not isinstance(outputs, str | bytes)
        # `checked_outputs` rejects other results.
        return [self._in_bytes(each, t_ms) for each in outputs] if is_some else outputs

    def _in_bytes(self, output: Any, t_ms: int) -> Any:
        kind = Act if isinstance(output, Command) else Send if isinstance(output, State) else None
        if kind is None:
            return output
        try:
            return kind(output.encode(self.rob_id, t_ms))
        except UsageError as error:
            name = type(output).__name__
            raise OwnMistake(f"on_reading put out a {name}: {error}", "use finite numbers up to 10^6", self) from error


class EvidenceController(Controller, ABC):
    """Base class of controllers that also read data of which the chain has only a hash, such as scans."""

    @abstractmethod
    def keep(self, step: int, t_ms: int, reading: bytes, raw: bytes) -> bytes:
        """Return the part of `raw` to log as evidence, b"" for none; `reading` has its hash. No auditor calls this."""

    @abstractmethod
    def on_evidence(self, step: int, t_ms: int, reading: bytes, evidence: bytes) -> Iterable[Output]:
        """Return the outputs, as `on_input`, with logged evidence. Raises: PeerError: it does not match the reading."""

    def on_input(self, step: int, t_ms: int, reading: bytes) -> Iterable[Output]:
        """Return the outputs for a reading without evidence."""
        return self.on_evidence(step, t_ms, reading, b"")


def checked_outputs(returned: object, room: int, controller: object) -> list[Output]:
    """Return a controller's outputs as a list.

    Raises: OwnMistake: an item is not an output, out of order, or not of 1 to `room` bytes.
    """
    method = overridden(controller, "on_input")
    hint = f"return a list of {'Command and State' if method == 'on_reading' else 'Act and Send'}, or []"

    def refuse(what: str, hint: str) -> OwnMistake:
        return OwnMistake(f"{method} {what}", hint, controller)

    if type(returned) is not list and (not isinstance(returned, Iterable) or isinstance(returned, str | bytes)):
        raise refuse(f"returned {kind_of(returned)}", hint)
    outputs = list(returned)
    has_sent = False
    for output in outputs:
        if not isinstance(output, Send | Act):
            raise refuse(f"put out {kind_of(output)}", hint)
        payload, what = output.payload, f"put out {type(output).__name__} of {kind_of(output.payload)}"
        if not isinstance(payload, bytes):
            raise refuse(what, "use bytes, as struct.pack returns them")
        if not 1 <= len(payload) <= room:
            raise refuse(f"{what}, {len(payload)} long", f"1 to {room} bytes")
        if isinstance(output, Send):
            has_sent = True
            if payload[0] & KIND_AUDIT:
                raise refuse("sends a packet that begins like one of the audits", "use a first byte below 0x80")
        elif has_sent:
            raise refuse("sends before it acts", "return commands first, then broadcasts")
    return outputs


def checked_state(returned: object, room: int, controller: object) -> bytes:
    """Return the result of `encode` if it is valid. Raises: OwnMistake: it is not bytes, or longer than `room`."""
    if not isinstance(returned, bytes):
        hint = "return bytes, as struct.pack does, or b''"
        raise OwnMistake(f"encode returned {kind_of(returned)}", hint, controller, "encode")
    if len(returned) > room:
        hint = f"return at most {room}, or set state_bytes = {len(returned)} in its class"
        raise OwnMistake(f"encode returned {len(returned)} bytes", hint, controller, "encode")
    return returned


def overridden(controller: object, method: str) -> str:
    """Return the name of the method that the user wrote: the one for bytes, or the one for dataclasses."""
    return (
        TYPED.get(method, method) if getattr(type(controller), method, None) is getattr(Controller, method) else method
    )


def kind_of(value: object) -> str:
    """Return the name of an object's type, for messages."""
    return "None" if value is None else type(value).__name__


def pack_outputs(outputs: Iterable[Output]) -> bytes:
    """Encode outputs as kernels write them."""
    return b"".join(
        OUTPUT.form.pack(ENTRY_SEND if isinstance(output, Send) else ENTRY_ACMD, len(output.payload)) + output.payload
        for output in outputs
    )


def unpack_outputs(packed: bytes) -> list[Output]:
    """Decode the outputs of a kernel, which must be well formed."""
    outputs: list[Output] = []
    at = 0
    while at < len(packed):
        kind, length = OUTPUT.form.unpack_from(packed, at)
        begin, at = at + OUTPUT.size, at + OUTPUT.size + length
        outputs.append((Send if kind == ENTRY_SEND else Act)(packed[begin:at]))
    return outputs
