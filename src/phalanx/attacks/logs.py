"""Logs that show another past than the trusted nodes chained, and readings that are false or from another time.

No audit can know of a sensor that is deceived or broken.
"""

from __future__ import annotations

from typing import ClassVar

from phalanx.bti import log, request, rounds, trusted
from phalanx.bti.audit import INPUT, RECV
from phalanx.bti.fleet import PENDING, START
from phalanx.bti.log import ENTRY_HEAD_BYTES
from phalanx.robot.actions import Action
from phalanx.robot.adversary.attack import Scene
from phalanx.robot.adversary.liar import MOTION, Liar
from phalanx.robot.controllers.peer_bodies import BEHIND_T, fields_of
from phalanx.robot.controllers.peers import PeerController
from phalanx.wire.fields import put_u32, row
from phalanx.wire.protocols import SEEN, SIGHTING
from phalanx.wire.table import HASH_BYTES, KIND_STATE, MAC_BYTES, SENSOR

from .hijack import Hijack

ASIDE_M = 30.0
BELIEVED_AFTER_MS = 3000
DRIFT_MPS = 5.0


class DropEntries(Liar):
    """Has not heard its neighbours, it says: nobody is in its way, and it drives straight to the goal."""

    def heard(self, now_ms: int, packet: bytes) -> list[Action]:
        """Pretend that what is no audit traffic never came; the a-node chains it all the same."""
        if packet[0] & request.AUDIT:
            return super().heard(now_ms, packet)
        self.chain(RECV, now_ms, packet)
        return []


class AlterEntries(Liar):
    """Writes another reading into its log than the s-node gave it, and acts on that."""

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        n = self.chain(INPUT, now_ms, reading)
        if n <= 0:
            return []
        if reading[0] == SENSOR.tag:
            kind, rob_id, t, x_m, *rest = MOTION.unpack_from(self.w.entry[ENTRY_HEAD_BYTES:n].tobytes())
            altered = MOTION.pack(kind, rob_id, t, x_m + ASIDE_M, *rest)
            self.w.entry[ENTRY_HEAD_BYTES : ENTRY_HEAD_BYTES + SENSOR.size] = memoryview(altered)
        self.record(self.w.entry[:n])
        return self.carry_out(now_ms, n)


class ReorderEntries(DropEntries):
    """Shows what it heard later than it heard it, so that it acts on where its neighbours were."""

    _held: tuple[tuple[int, bytes], ...] = ()

    def heard(self, now_ms: int, packet: bytes) -> list[Action]:
        if not packet[0] & request.AUDIT:
            self._held += ((now_ms, packet),)
        return super().heard(now_ms, packet)

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        while self._held and self._held[0][0] + BELIEVED_AFTER_MS <= now_ms:
            self.believe(*self._held[0])
            self._held = self._held[1:]
        return super().sensed(now_ms, reading)


class InsertEntries(Liar):
    """Has heard a robot that is not there: its log gives a reason to drive where it wants."""

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        """Log an invented state before each reading: beside it on the side of the goal, coming nearer."""
        if reading[0] == SENSOR.tag:
            _, _, _, x_m, y_m, vx_mps, vy_mps = MOTION.unpack_from(reading)
            nobody = max(self.plan.ids) + 1
            state = MOTION.pack(KIND_STATE, nobody, now_ms, x_m + 3.0, y_m, vx_mps - 5.0, vy_mps)
            self.believe(now_ms, state)
        return super().sensed(now_ms, reading)


class TruncateLog(Hijack):
    """Has just been switched on, it says at each round: before that, no log."""

    def round_due(self, now_ms: int) -> list[Action]:
        rounds.forget_checkpoint(self.f, self.i)
        put_u32(self.f.checkpoint[self.i, START], rounds.AT_T_KEY, now_ms)
        return super().round_due(now_ms)


class ForgeCheckpoint(Hijack):
    """Starts its log at a checkpoint of its own making, taken after what it did, under tokens of an older one."""

    def next_packet(self, now_ms: int) -> list[Action]:
        actions = super().next_packet(now_ms)
        f, i, r = self.f, self.i, self.f.robot[self.i]
        if self.lies(now_ms) and r.checkpoint_at >= 0:
            f.checkpoint[i, START] = f.checkpoint[i, PENDING]
            f.hckpt[i, START] = f.hckpt[i, PENDING]
            r.start_len, r.booted = r.pending_len, 0
            log.truncate(f, i)
        return actions


class SwapNodes(Hijack):
    """Shows one node's chain where the other's belongs."""

    def make_request(self, now_ms: int) -> bool:
        made = super().make_request(now_ms)
        if not made or not self.lies(now_ms):
            return made
        q = self.f.request.rows[self.f.robot[self.i].request_row]
        for a, s, size in (
            (request.AT_TOP_A, request.AT_TOP_S, HASH_BYTES),
            (request.AT_AUTH_A, request.AT_AUTH_S, MAC_BYTES),
        ):
            kept = q[a : a + size].copy()
            q[a : a + size] = q[s : s + size]
            q[s : s + size] = kept
        return True


class StaleLog(Hijack):
    """Shows the log of its honest days to each fresh token request, for ever.

    Source: docs/spec/rebound.md (stale log).
    """

    _kept = b""

    def next_packet(self, now_ms: int) -> list[Action]:
        actions = super().next_packet(now_ms)
        r = self.f.robot[self.i]
        if not self.lies(now_ms) and r.request_len > 0:
            self._kept = self.f.request.rows[r.request_row, : r.request_len].tobytes()
        return actions

    def make_request(self, now_ms: int) -> bool:
        """Show the kept request, if there is one, with a fresh token request in it."""
        if not self.lies(now_ms) or not self._kept:
            return super().make_request(now_ms)
        f, i, r = self.f, self.i, self.f.robot[self.i]
        treq = self.w.small[0]
        auditor = int(rounds.next_candidate(f, i, now_ms))
        if r.quota <= 0 or auditor == 0:
            return False
        if trusted.anode_token_request(self.profile, f.anode[i], now_ms, auditor, treq) < 0:
            r.quota = 0
            return False
        f.peer[i, rounds.peer_at(f, i, auditor)].asked = r.round_no
        r.quota -= 1
        r.request_no = (int(r.request_no) + 1) & 0xFFFF
        r.request_to, r.request_next, r.asked_at, r.request_len = auditor, 0, now_ms, len(self._kept)
        q = f.request.rows[request.row_of(f, i)]
        q[: len(self._kept)] = memoryview(self._kept)
        q[request.AT_T : request.AT_TOP_A] = treq[: rounds.TREQ_TOP]
        q[request.AT_TREQ_MAC : request.AT_TOP_S] = treq[rounds.TREQ_MAC :]
        return True


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

    def on_packet(self, now_ms: int, packet: bytes) -> list[Action]:
        if said := fields_of(SIGHTING, packet):
            self._number = said[BEHIND_T]
        return super().on_packet(now_ms, packet)

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
    _stock: tuple[bytes, ...] = ()

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        """Act on the oldest reading of the stock; if there is none, on this one, of which the stock is made."""
        if self._stock:
            entry, self._stock = self._stock[0], self._stock[1:]
            self.w.entry[: len(entry)] = row(entry)
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
                    self._stock += (self.w.entry[:n].tobytes(),)
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
