"""The bodies that protocols drive: a point mass, and two wheels that visitors may drive as well.

Protocols decide in metres, the same for both; here their decisions become commands.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, Final

import numpy as np

from phalanx.arrays import Params
from phalanx.robot.follow import steer
from phalanx.wire.fields import get_i8, get_u16, get_u64, row
from phalanx.wire.record import LARGEST_NUMBER, MalformedRecord, Record
from phalanx.wire.table import ACCELERATION, KIND_ACCELERATION, KIND_STATE, SENSOR, STATE, WHEELS_SENSOR, WHEELS_STATE

from . import dispatch
from .bundled import wheels
from .compiled import compiled
from .keep_apart import NEAR_BYTES, decode_near, go_around, restrain
from .orders import POINT_BYTES, POINT_X, POINT_Y
from .protocol import Point
from .python_controller import Act, Output, Send
from .sine import sine_cosine

ID, BEHIND_T = 1, 3  # of the fields of what robots say, sense and do, by number: kind, id, t, and the rest
MOST_MPS2 = 5.0  # along each axis, as the body can
# Of the drive: pace for each metre that is left, and share of a wrong pace that is undone in a second.
PACE_PER_S, HASTE_PER_S = 1.5, 3.0
WHEELS_MPS = 0.3  # about what wheels do
STANDS_MM = 20.0  # so near to where they are to be they stand, and do not circle around it
# Who drives a robot by joystick has it for so long after the last word; then it goes back to its work.
TAKEN_MS: Final = 5000


def is_fine(number: float) -> bool:
    """Return whether it is a number that a place or a pace may be: neither NaN nor beyond 10^6."""
    return abs(number) <= LARGEST_NUMBER


def fields_of(record: Record, said: bytes) -> tuple[Any, ...] | None:
    """Return a record's fields, the kind first; None if it is no such, or has numbers that nothing can be."""
    if len(said) != record.size or said[0] != record.tag:
        return None
    found = record.form.unpack(said)
    rest = found[BEHIND_T:]
    # Mostly all together are no more than one may be, which is quickly said; of a NaN it is not.
    return found if sum(map(abs, rest)) <= LARGEST_NUMBER or all(map(is_fine, rest)) else None


class PeerBody:
    """How one robot of a protocol senses, moves, and says where it is: a point mass that accelerates along each axis.

    Args:
        pace_mps: its top speed along each axis.

    Class attributes:
        sensor: what a reading says of the robot itself; what else it sees is behind that.
        per_m: of the lengths in there.
    """

    sensor: ClassVar[Record] = SENSOR
    per_m: ClassVar[int] = 1

    def __init__(self, rob_id: int, pace_mps: float) -> None:
        self.rob_id, self.pace_mps = rob_id, pace_mps

    def beside(self, reading: bytes) -> bytes:
        """Return what a reading says of other things than the robot: a protocol's own matter."""
        return reading[self.sensor.size :]

    def own(self, reading: bytes) -> tuple[Any, ...] | None:
        """Return what a reading says of the robot, as fields; None if it makes no sense."""
        own = fields_of(self.sensor, reading[: self.sensor.size])
        return own if own and own[ID] == self.rob_id else None

    def where(self, reading: bytes) -> Point | None:
        """Return where the robot is, m; None if the reading makes no sense."""
        own = self.own(reading)
        return (own[BEHIND_T] / self.per_m, own[BEHIND_T + 1] / self.per_m) if own else None

    def drive(self, step: int, t_ms: int, reading: bytes, aim_m: Point | None, *, speaks: bool) -> list[Output]:  # noqa: ARG002
        """Return a command towards a place, or to stand; and where it is, if it is to speak."""
        own = self.own(reading)
        if own is None or aim_m is None:
            return [Act(ACCELERATION.form.pack(KIND_ACCELERATION, self.rob_id, t_ms, 0.0, 0.0))]
        x_m, y_m, *paces = own[BEHIND_T:]
        push = [
            HASTE_PER_S * (max(-self.pace_mps, min(self.pace_mps, PACE_PER_S * (to - at))) - pace)
            for to, at, pace in zip(aim_m, (x_m, y_m), paces, strict=True)
        ]
        push = [max(-MOST_MPS2, min(MOST_MPS2, each)) for each in push]
        outputs: list[Output] = [Act(ACCELERATION.form.pack(KIND_ACCELERATION, self.rob_id, t_ms, *push))]
        if speaks:
            outputs.append(Send(STATE.form.pack(KIND_STATE, self.rob_id, t_ms, *own[BEHIND_T:])))
        return outputs

    def position_in(self, packet: bytes) -> tuple[int, float, float] | None:
        """Return the id of a robot that says where it is, and that, m; None if the packet says nothing of it."""
        said = fields_of(STATE, packet)
        return (said[ID], said[BEHIND_T], said[BEHIND_T + 1]) if said else None

    def is_taken(self, t_ms: int) -> bool:  # noqa: ARG002 - a point mass obeys nobody
        """Return whether it is held, or somebody drives it: what the protocol wants is not done."""
        return False

    def on_recv(self, t_ms: int, packet: bytes) -> None:
        """Hear a packet that is no word of the protocol: an order, perhaps."""

    def encode(self) -> bytes:
        """Return all that it remembers."""
        return b""

    def decode(self, encoding: bytes) -> bytes:
        """Remember what an encoding begins with; return the rest. Raises: MalformedRecord: `encode` gives no such."""
        return encoding


class DrivenWheels(PeerBody):
    """Two wheels that obey signed orders as `wheels` do, and otherwise do the protocol's work.

    A `wheels` controller does what orders demand: a stop, a route to its end, a joystick. This drives while it is idle.
    With `keeps_apart` a reading ends with who is nearby, and the robot avoids them, whoever drives it.
    """

    sensor, per_m = WHEELS_SENSOR, 1000

    def __init__(self, rob_id: int, params: Params, *, keeps_apart: bool = False) -> None:
        super().__init__(rob_id, WHEELS_MPS)
        self._near_bytes = NEAR_BYTES if keeps_apart else 0
        self._driven = compiled(dispatch.NUMBERS["wheels"], params)(rob_id)

    def drive(self, step: int, t_ms: int, reading: bytes, aim_m: Point | None, *, speaks: bool) -> list[Output]:  # noqa: ARG002
        """As a body's, where nobody else drives it."""
        outputs = list(self._driven.on_input(step, t_ms, reading[: self.sensor.size]))
        own = self.own(reading)
        if own is None or aim_m is None:
            return outputs
        near = decode_near(reading[len(reading) - self._near_bytes :])
        state = row(self._driven.encode())
        goal = (aim_m[0] * self.per_m, aim_m[1] * self.per_m)
        if state[wheels.COUNT] and near:
            goal = (float(get_u16(state, wheels.ROUTE + POINT_X)), float(get_u16(state, wheels.ROUTE + POINT_Y)))
        elif self.is_taken(t_ms):
            return self._restrained(outputs, own, near)
        act = bytearray(outputs[0].payload)
        left, right = self._towards(own, goal, near)
        act[wheels.BODY], act[wheels.BODY + wheels.COMMAND_RIGHT] = left & 255, right & 255
        return self._restrained([Act(bytes(act)), *outputs[1:]], own, near)

    def beside(self, reading: bytes) -> bytes:
        """As a body's, without who is nearby."""
        return super().beside(reading[: len(reading) - self._near_bytes])

    def position_in(self, packet: bytes) -> tuple[int, float, float] | None:
        """As a body's, from millimetres."""
        said = fields_of(WHEELS_STATE, packet)
        if not said:
            return None
        # As it is remembered in a checkpoint: who replays from there is to decide the same.
        x_m, y_m = (float(np.float32(said[at] / self.per_m)) for at in (BEHIND_T, BEHIND_T + 1))
        return said[ID], x_m, y_m

    def on_recv(self, t_ms: int, packet: bytes) -> None:
        """Obey an order, if it is one for this robot."""
        self._driven.on_recv(t_ms, packet)

    def encode(self) -> bytes:
        """Return a `wheels_memory`."""
        return self._driven.encode()

    def decode(self, encoding: bytes) -> bytes:
        """Remember a `wheels_memory`; return what stands behind it."""
        if len(encoding) < wheels.ROUTE:
            raise MalformedRecord(f"{len(encoding)} bytes of wheels")
        end = wheels.ROUTE + POINT_BYTES * encoding[wheels.COUNT]
        self._driven.decode(encoding[:end])
        return encoding[end:]

    def is_taken(self, t_ms: int) -> bool:
        """Return whether it is held, or drives by orders."""
        state = row(self._driven.encode())
        heard_ms = get_u64(state, wheels.HEARD)
        return bool(state[wheels.HELD] or state[wheels.COUNT] or (heard_ms and t_ms - heard_ms <= TAKEN_MS))

    def _restrained(self, outputs: list[Output], own: tuple[Any, ...], near: list[Point]) -> list[Output]:
        """Return the outputs with wheels that do not drive towards a robot nearby."""
        if not near:
            return outputs
        act = bytearray(outputs[0].payload)
        left, right = (get_i8(row(bytes(act)), wheels.BODY + at) for at in (0, wheels.COMMAND_RIGHT))
        left, right = restrain(left, right, *sine_cosine(own[BEHIND_T + 2]), near)
        act[wheels.BODY], act[wheels.BODY + wheels.COMMAND_RIGHT] = left & 255, right & 255
        return [Act(bytes(act)), *outputs[1:]]

    def _towards(self, own: tuple[Any, ...], goal_mm: Point, near: list[Point]) -> tuple[int, int]:
        x_mm, y_mm, direction_deg = own[BEHIND_T:]
        dx, dy = goal_mm[0] - x_mm, goal_mm[1] - y_mm
        away_mm = math.sqrt(dx * dx + dy * dy)
        if away_mm < STANDS_MM:
            return 0, 0
        if near:
            dx, dy = go_around((dx, dy), near)
        sin, cos = sine_cosine(direction_deg)
        return steer(dy * cos - dx * sin, -dx * cos - dy * sin, away_mm)
