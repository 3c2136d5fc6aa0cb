"""The interface of controllers in plain Python, and the checks of what they return.

An auditor gives a copy of the controller the same readings and packets, and compares every byte. So a controller that
can answer the same inputs differently makes auditors refuse honest robots. Packets come from compromised robots:
whatever their bytes, nothing may raise, and NaN must not spread.
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
TYPED = {"on_input": "on_reading", "on_recv": "on_state"}  # what each of these calls, unless it is overridden


class OwnMistake(OwnFileError):
    """An object of a researcher's file, `whose`, broke a rule in its `method`."""

    def __init__(self, message: str, hint: str, controller: object, method: str = "on_input") -> None:
        super().__init__(message, hint)
        self.controller, self.method = controller, method

    @property
    def places(self) -> Iterator[tuple[str, int]]:
        """Yield file and line of each method in which it may have happened, the likeliest first; then of the class."""
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
    """A robot's controller: one object for each robot, whose id is 1..65535. A new one has just booted.

    Override `on_reading` and, to listen to others, `on_state`; assign to `self.memory` to remember something. To work
    with bytes instead, override `on_input` for `on_reading`, `on_recv` for `on_state`, `encode` and `decode` for
    `memory`, and return `Act` and `Send` for `Command` and `State`. Each of these works by itself.

    Class attributes:
        memory: its state at boot: a frozen dataclass, whose fields decide the encoding (wire/packing.py).
        state_bytes: longest encoding; 0 for as much as the scenario has room for.
        reading_bytes: longest reading of a robot whose driver has further sensors; 0 for the scenario's.
        senses: a lidar and bumpers, which simulations and arenas then provide behind each reading.
        is_ours: our tests show that it is deterministic. Then a simulation replays it once, not for each auditor.
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
        if cls.encode is not Controller.encode:  # it keeps its state in attributes of its own
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
        """Set an attribute; encode a new memory at once, so that auditors continue from the same rounded numbers."""
        if name == "memory" and self._packing:
            try:
                self.__dict__["_encoding"], value = self._packing.settle(value)
            except Unfit as error:
                raise OwnMistake(str(error), "a value that its type has room for", self) from error
        elif self._has_booted:
            what = f"{type(self).__name__} sets {name}, which no checkpoint holds"
            raise OwnMistake(what, "a field of its memory", self)
        self.__dict__[name] = value

    # --- typed -------------------------------------------------------------------------------------------------------

    def on_reading(self, step: int, t_ms: int, reading: Reading) -> Decision:  # noqa: ARG002
        """Decide on a reading, the `step`th from 0, taken at `t_ms` of the s-node's clock: commands, then `State`s."""
        raise OwnMistake(f"{type(self).__name__} has no on_reading", "on_reading(self, step, t_ms, reading)", self)

    def on_state(self, t_ms: int, state: State) -> None:
        """Handle another robot's state, received at `t_ms` of the a-node's clock; it may be a lie."""

    # --- bytes -------------------------------------------------------------------------------------------------------

    def encode(self) -> bytes:
        """Return its whole state, encoded: the checkpoint."""
        self.__dict__["_has_booted"] = True
        return self._encoding

    def decode(self, encoding: bytes) -> None:
        """Replace its state by this checkpoint. Raises: PeerError: `encode` of this robot never returns these bytes."""
        if self._packing:
            self.memory = self._packing.decode(encoding)
        elif encoding:
            raise MalformedRecord(f"{len(encoding)} bytes of nothing")

    def on_recv(self, t_ms: int, packet: bytes) -> None:
        """Handle a packet, received at `t_ms` of the a-node's clock."""
        state = State.find(packet)
        if state:
            self.on_state(t_ms, state)

    def on_advice(self, advice: bytes) -> None:
        """Handle a planner's advice, which may be any bytes."""

    def on_input(self, step: int, t_ms: int, reading: bytes) -> Iterable[Output]:
        """Decide on a reading as bytes. At an invalid one the robot coasts and broadcasts nothing."""
        size = Reading.RECORD.size
        seen = Reading.find(reading[:size], beside=reading[size:])
        if seen is None or (self.senses and not self.senses.is_readable(seen.beside)):
            return [Act(Command(0.0, 0.0).encode(self.rob_id, t_ms))]
        outputs: Any = self.on_reading(step, t_ms, seen)
        is_some = isinstance(outputs, Iterable) and not isinstance(outputs, str | bytes)
        # `checked_outputs` refuses all else.
        return [self._in_bytes(each, t_ms) for each in outputs] if is_some else outputs

    def _in_bytes(self, output: Any, t_ms: int) -> Any:
        kind = Act if isinstance(output, Command) else Send if isinstance(output, State) else None
        if kind is None:
            return output
        try:
            return kind(output.encode(self.rob_id, t_ms))
        except UsageError as error:
            name = type(output).__name__
            raise OwnMistake(f"on_reading put out a {name}: {error}", "finite numbers up to 10^6", self) from error


class EvidenceController(Controller, ABC):
    """A controller that also reads data of which the chain has only a hash, such as scans."""

    @abstractmethod
    def keep(self, step: int, t_ms: int, reading: bytes, raw: bytes) -> bytes:
        """Return the part of `raw` to log as evidence, b"" for none; `reading` has its hash. No auditor calls this."""

    @abstractmethod
    def on_evidence(self, step: int, t_ms: int, reading: bytes, evidence: bytes) -> Iterable[Output]:
        """Decide as `on_input`, with logged evidence. Raises: PeerError: the evidence does not prove the reading."""

    def on_input(self, step: int, t_ms: int, reading: bytes) -> Iterable[Output]:
        """Decide on a reading without evidence."""
        return self.on_evidence(step, t_ms, reading, b"")


def checked_outputs(returned: object, room: int, controller: object) -> list[Output]:
    """Return a controller's outputs as a list.

    Raises: OwnMistake: one is no output, out of order, or not of 1 to `room` bytes.
    """
    asked = overridden(controller, "on_input")
    some = "a list of Command and State" if asked == "on_reading" else "a list of Act and Send"

    def refuse(what: str, hint: str) -> OwnMistake:
        return OwnMistake(f"{asked} {what}", hint, controller)

    if type(returned) is not list and (not isinstance(returned, Iterable) or isinstance(returned, str | bytes)):
        raise refuse(f"returned {kind_of(returned)}", f"{some}, empty for nothing")
    outputs = list(returned)
    has_sent = False
    for output in outputs:
        if not isinstance(output, Send | Act):
            raise refuse(f"put out {kind_of(output)}", f"{some}, empty for nothing")
        payload, what = output.payload, f"put out {type(output).__name__} of {kind_of(output.payload)}"
        if not isinstance(payload, bytes):
            raise refuse(what, "bytes, as struct packs them")
        if not 1 <= len(payload) <= room:
            raise refuse(f"{what}, {len(payload)} long", f"1 to {room} bytes")
        if isinstance(output, Send):
            has_sent = True
            if payload[0] & KIND_AUDIT:
                raise refuse("sends a packet that begins like one of the audits", "a first byte below 0x80")
        elif has_sent:
            raise refuse("sends before it acts", "commands first, then what it broadcasts")
    return outputs


def checked_state(returned: object, room: int, controller: object) -> bytes:
    """Return what `encode` returned. Raises: OwnMistake: it is not bytes, or longer than `room`."""
    if not isinstance(returned, bytes):
        hint = "bytes, as struct packs them; b'' for nothing"
        raise OwnMistake(f"encode returned {kind_of(returned)}", hint, controller, "encode")
    if len(returned) > room:
        hint = f"at most {room}, or state_bytes = {len(returned)} in its class"
        raise OwnMistake(f"encode returned {len(returned)} bytes", hint, controller, "encode")
    return returned


def overridden(controller: object, method: str) -> str:
    """Return the name of the method that a researcher wrote: the one for bytes, or the one for dataclasses."""
    return (
        TYPED.get(method, method) if getattr(type(controller), method, None) is getattr(Controller, method) else method
    )


def kind_of(value: object) -> str:
    """Return the name of an object's type, for messages."""
    return "None" if value is None else type(value).__name__


def pack_outputs(outputs: Iterable[Output]) -> bytes:
    """Return outputs in the bytes that kernels write."""
    return b"".join(
        OUTPUT.form.pack(ENTRY_SEND if isinstance(output, Send) else ENTRY_ACMD, len(output.payload)) + output.payload
        for output in outputs
    )


def unpack_outputs(packed: bytes) -> list[Output]:
    """Return the outputs that a kernel wrote; they must be well formed."""
    outputs: list[Output] = []
    at = 0
    while at < len(packed):
        kind, length = OUTPUT.form.unpack_from(packed, at)
        begin, at = at + OUTPUT.size, at + OUTPUT.size + length
        outputs.append((Send if kind == ENTRY_SEND else Act)(packed[begin:at]))
    return outputs
