"""Bodies for protocols: a point mass, and two wheels that visitors may drive as well.

Protocols compute a target in metres, whatever the body; the classes here convert it to commands.
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

ID, FIRST_VALUE = 1, 3  # indices of fields in states, readings and commands: kind, id, t, then the rest
MOST_MPS2 = 5.0  # largest acceleration along each axis
# Gains: speed per metre of remaining distance, and acceleration per m/s of speed error.
PACE_PER_S, HASTE_PER_S = 1.5, 3.0
WHEELS_MPS = 0.3  # approximate top speed
STANDS_MM = 20.0  # distance to the target at which wheels stop, instead of circling around it
# Time after the last joystick order until a robot resumes its own work.
TAKEN_MS: Final = 5000


def is_fine(number: float) -> bool:
    """Return whether a number is valid as a coordinate or a speed: not NaN, and at most 10^6 in size."""
    return abs(number) <= LARGEST_NUMBER


def fields_of(record: Record, raw: bytes) -> tuple[Any, ...] | None:
    """Parse a record; return its fields, kind first, or None for another record or invalid numbers."""
    if len(raw) != record.size or raw[0] != record.tag:
        return None
    found = record.form.unpack(raw)
    rest = found[FIRST_VALUE:]
    # Fast path: if the sum of sizes is within the limit, each number is. A NaN fails both checks.
    return found if sum(map(abs, rest)) <= LARGEST_NUMBER or all(map(is_fine, rest)) else None


class PeerBody:
    """Body of a robot: a point mass that accelerates along each axis. It parses readings and makes commands and states.

    Args:
        pace_mps: top speed along each axis.

    Class attributes:
        sensor: record of the robot's own motion, the first part of a reading.
        per_m: units of length per metre in that record.
    """

    sensor: ClassVar[Record] = SENSOR
    per_m: ClassVar[int] = 1

    def __init__(self, rob_id: int, pace_mps: float) -> None:
        self.rob_id, self.pace_mps = rob_id, pace_mps

    def beside(self, reading: bytes) -> bytes:
        """Return the protocol's part of a reading, after the robot's own motion."""
        return reading[self.sensor.size :]

    def own(self, reading: bytes) -> tuple[Any, ...] | None:
        """Return the fields of the robot's own motion in a reading; None for an invalid reading."""
        own = fields_of(self.sensor, reading[: self.sensor.size])
        return own if own and own[ID] == self.rob_id else None

    def where(self, reading: bytes) -> Point | None:
        """Return the robot's position, m; None for an invalid reading."""
        own = self.own(reading)
        return (own[FIRST_VALUE] / self.per_m, own[FIRST_VALUE + 1] / self.per_m) if own else None

    def drive(self, step: int, t_ms: int, reading: bytes, aim_m: Point | None, *, speaks: bool) -> list[Output]:  # noqa: ARG002
        """Return a command towards `aim_m`, or to coast without one; if it `speaks`, also the robot's state."""
        own = self.own(reading)
        if own is None or aim_m is None:
            return [Act(ACCELERATION.form.pack(KIND_ACCELERATION, self.rob_id, t_ms, 0.0, 0.0))]
        x_m, y_m, *paces = own[FIRST_VALUE:]
        push = [
            HASTE_PER_S * (max(-self.pace_mps, min(self.pace_mps, PACE_PER_S * (to - at))) - pace)
            for to, at, pace in zip(aim_m, (x_m, y_m), paces, strict=True)
        ]
        push = [max(-MOST_MPS2, min(MOST_MPS2, each)) for each in push]
        outputs: list[Output] = [Act(ACCELERATION.form.pack(KIND_ACCELERATION, self.rob_id, t_ms, *push))]
        if speaks:
            outputs.append(Send(STATE.form.pack(KIND_STATE, self.rob_id, t_ms, *own[FIRST_VALUE:])))
        return outputs

    def position_in(self, packet: bytes) -> tuple[int, float, float] | None:
        """Return id and position, m, of the sender of a state; None for other packets."""
        fields = fields_of(STATE, packet)
        return (fields[ID], fields[FIRST_VALUE], fields[FIRST_VALUE + 1]) if fields else None

    def is_taken(self, t_ms: int) -> bool:  # noqa: ARG002 - a point mass takes no orders
        """Return whether the robot is held or driven by orders, so that the protocol does not control it."""
        return False

    def on_recv(self, t_ms: int, packet: bytes) -> None:
        """Handle a packet that does not belong to the protocol, such as an order."""

    def encode(self) -> bytes:
        """Return the encoded state of the body."""
        return b""

    def decode(self, encoding: bytes) -> bytes:
        """Restore the body's state from the start of an encoding; return the rest. Raises: MalformedRecord: invalid."""
        return encoding


class DrivenWheels(PeerBody):
    """Two wheels that obey signed orders as `wheels` does, and otherwise do the protocol's work.

    A `wheels` controller carries out orders: a stop, a route to its end, a joystick. While it is idle, the protocol
    drives. With `keeps_apart`, a reading ends with the robots nearby, and the robot always avoids them.
    """

    sensor, per_m = WHEELS_SENSOR, 1000

    def __init__(self, rob_id: int, params: Params, *, keeps_apart: bool = False) -> None:
        super().__init__(rob_id, WHEELS_MPS)
        self._near_bytes = NEAR_BYTES if keeps_apart else 0
        self._driven = compiled(dispatch.NUMBERS["wheels"], params)(rob_id)

    def drive(self, step: int, t_ms: int, reading: bytes, aim_m: Point | None, *, speaks: bool) -> list[Output]:  # noqa: ARG002
        """Return commands as `PeerBody` does, unless orders control the robot."""
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
        """Return the protocol's part of a reading, without the robots nearby."""
        return super().beside(reading[: len(reading) - self._near_bytes])

    def position_in(self, packet: bytes) -> tuple[int, float, float] | None:
        """Return id and position, m, of the sender of a state of wheels; None for other packets."""
        fields = fields_of(WHEELS_STATE, packet)
        if not fields:
            return None
        # Rounded to f32 as in a checkpoint, so that a replay from there gives the same outputs.
        x_m, y_m = (float(np.float32(fields[at] / self.per_m)) for at in (FIRST_VALUE, FIRST_VALUE + 1))
        return fields[ID], x_m, y_m

    def on_recv(self, t_ms: int, packet: bytes) -> None:
        """Obey the packet if it is an order for this robot."""
        self._driven.on_recv(t_ms, packet)

    def encode(self) -> bytes:
        """Return a `wheels_memory`."""
        return self._driven.encode()

    def decode(self, encoding: bytes) -> bytes:
        """Restore the `wheels_memory` at the start of an encoding; return the rest."""
        if len(encoding) < wheels.ROUTE:
            raise MalformedRecord(f"{len(encoding)} bytes, shorter than a wheels_memory")
        end = wheels.ROUTE + POINT_BYTES * encoding[wheels.COUNT]
        self._driven.decode(encoding[:end])
        return encoding[end:]

    def is_taken(self, t_ms: int) -> bool:
        """Return whether the robot is held or driven by orders."""
        state = row(self._driven.encode())
        heard_ms = get_u64(state, wheels.HEARD)
        return bool(state[wheels.HELD] or state[wheels.COUNT] or (heard_ms and t_ms - heard_ms <= TAKEN_MS))

    def _restrained(self, outputs: list[Output], own: tuple[Any, ...], near: list[Point]) -> list[Output]:
        """Return the outputs, with wheel speeds limited so that the robot does not drive towards robots nearby."""
        if not near:
            return outputs
        act = bytearray(outputs[0].payload)
        left, right = (get_i8(row(bytes(act)), wheels.BODY + at) for at in (0, wheels.COMMAND_RIGHT))
        left, right = restrain(left, right, *sine_cosine(own[FIRST_VALUE + 2]), near)
        act[wheels.BODY], act[wheels.BODY + wheels.COMMAND_RIGHT] = left & 255, right & 255
        return [Act(bytes(act)), *outputs[1:]]

    def _towards(self, own: tuple[Any, ...], goal_mm: Point, near: list[Point]) -> tuple[int, int]:
        x_mm, y_mm, direction_deg = own[FIRST_VALUE:]
        dx, dy = goal_mm[0] - x_mm, goal_mm[1] - y_mm
        away_mm = math.sqrt(dx * dx + dy * dy)
        if away_mm < STANDS_MM:
            return 0, 0
        if near:
            dx, dy = go_around((dx, dy), near)
        sin, cos = sine_cosine(direction_deg)
        return steer(dy * cos - dx * sin, -dx * cos - dy * sin, away_mm)
