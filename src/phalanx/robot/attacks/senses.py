"""Sensors: deceived or broken ones, which no audit can know of, and readings that a c-node takes at another time."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from phalanx.bti import rounds
from phalanx.bti.audit import INPUT
from phalanx.bti.fleet import START
from phalanx.robot.actions import Action
from phalanx.robot.controllers.peer_bodies import BEHIND_T, fields_of
from phalanx.robot.controllers.peers import PeerController
from phalanx.wire.fields import put_u32
from phalanx.wire.protocols import SEEN, SIGHTING
from phalanx.wire.table import SENSOR

from .attack import Scene
from .liar import MOTION, Liar

DRIFT_MPS = 5.0


class SpoofGps(Liar):
    """Somebody outside draws the robot's position sensor aside; the robot itself is honest."""

    def read(self, now_ms: int, reading: bytes) -> bytes:
        if not self.lies(now_ms) or reading[0] != SENSOR.tag:
            return reading
        aside_m = DRIFT_MPS * (now_ms - self.plan.start_ms) / 1000
        kind, rob_id, t, x_m, y_m, vx_mps, vy_mps = MOTION.unpack_from(reading)
        aside = MOTION.pack(kind, rob_id, t, x_m + aside_m, y_m - aside_m, vx_mps, vy_mps)
        return aside + reading[SENSOR.size :]  # what it sees, it sees from where it is


class ShowThing(Liar):
    """Somebody outside shows its sensor, close by, the thing that was spoken of last; the robot itself is honest."""

    scene: ClassVar[Scene] = "protocol"
    ASIDE_STEPS: ClassVar[float] = 0.125  # along each axis
    _number = 0  # until somebody has spoken of one

    def on_packet(self, now_ms: int, frame: bytes) -> list[Action]:
        if said := fields_of(SIGHTING, frame):
            self._number = said[BEHIND_T]
        return super().on_packet(now_ms, frame)

    def read(self, now_ms: int, reading: bytes) -> bytes:
        """Return the reading, and what is not there; nothing to a sensor that sees no things."""
        mine = self._honest
        if not self.lies(now_ms) or not isinstance(mine, PeerController) or len(mine.body.beside(reading)) != SEEN.size:
            return reading
        aside_m = self.ASIDE_STEPS * mine.task.step_m
        return reading[: mine.body.sensor.size] + SEEN.form.pack(self._number, aside_m, aside_m)


class StuckSensor(Liar):
    """A fault: the position sensor says the same for ever; the robot itself is honest."""

    _stuck = b""

    def read(self, now_ms: int, reading: bytes) -> bytes:
        if not self.lies(now_ms):
            return reading
        self._stuck = self._stuck or reading
        return self._stuck


class StarveSensors(Liar):
    """Polls its sensors no more: without an INPUT no command and no message is due, and the log shows no fault.

    If it has not polled them since boot, it says each time that it has just got its key, and nothing is missing yet.
    """

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        return []

    def next_packet(self, now_ms: int) -> list[Action]:
        if self.lies(now_ms) and self.f.robot[self.i].booted:
            put_u32(self.f.checkpoint[self.i, START], 0, now_ms)
            self.f.robot[self.i].t_key = now_ms
        return super().next_packet(now_ms)


class KeyOfTomorrow(StarveSensors):
    """Polls its sensors no more, and says that its log begins at boot and its mission key comes in 49 days.

    A hole of ours, closed in bti/audit.py.
    """

    T_KEY_MS: ClassVar[int] = (1 << 32) - (1 << 16)

    def next_packet(self, now_ms: int) -> list[Action]:
        r = self.f.robot[self.i]
        if self.lies(now_ms) and r.t_key != self.T_KEY_MS:
            r.t_key = self.T_KEY_MS
            rounds.forget_checkpoint(self.f, self.i)
        return Liar.next_packet(self, now_ms)


class Interleave(Liar):
    """Polls a stock of readings at one moment, and lives on them for seconds: each is answered as if it were new.

    Two chains fix the order of readings and that of messages and commands, not which of them came before which. When
    the stock is used up it asks for audits, and then stocks up again.
    Source: docs/spec/rebound.md (free interleaving).
    """

    STOCK: ClassVar[int] = 12
    SETTLED_MS: ClassVar[int] = 200
    _round_waits = False
    _asked_ms = 0

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._stock: list[np.ndarray[Any, np.dtype[np.uint8]]] = []

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        """Act on the oldest reading of the stock; if there is none, on this one, of which the stock is made."""
        if self._stock:
            entry = self._stock.pop(0)
            self.w.entry[: len(entry)] = entry
            self.record(entry)
            actions = self.carry_out(now_ms, len(entry))
            if not self._stock and self._round_waits:
                self._round_waits = False
                actions += super().round_due(now_ms)
                self._asked_ms = now_ms
            return actions
        actions = super().sensed(now_ms, reading)
        if now_ms - self._asked_ms >= self.SETTLED_MS and self.f.robot[self.i].request_len == 0:
            for _ in range(self.STOCK):
                n = self.chain(INPUT, now_ms, reading)
                if n > 0:
                    self._stock.append(self.w.entry[:n].copy())
            self.deviates(now_ms)
        return actions

    def round_due(self, now_ms: int) -> list[Action]:
        """Wait while readings are left that the s-node has chained and the log does not show."""
        if self._stock:
            self._round_waits = True
            return []
        self._asked_ms = now_ms
        return super().round_due(now_ms)

    def next_packet(self, now_ms: int) -> list[Action]:
        return [] if self._stock else super().next_packet(now_ms)
