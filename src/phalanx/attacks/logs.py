"""Attacks on logs: entries that differ from what the trusted nodes chained, and false or old sensor readings.

No audit can detect a sensor that is deceived or broken.
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
from phalanx.robot.controllers.peer_bodies import FIRST_VALUE, fields_of
from phalanx.robot.controllers.peers import PeerController
from phalanx.wire.fields import put_u32, row
from phalanx.wire.protocols import SEEN, SIGHTING
from phalanx.wire.table import HASH_BYTES, KIND_STATE, MAC_BYTES, SENSOR

from .hijack import Hijack

ASIDE_M = 30.0
BELIEVED_AFTER_MS = 3000
DRIFT_MPS = 5.0


class DropEntries(Liar):
    """Leave neighbours' messages out of the log, and drive to the goal as if alone."""

    def heard(self, now_ms: int, packet: bytes) -> list[Action]:
        """Ignore all packets but audit traffic; the a-node chains them nevertheless."""
        if packet[0] & request.AUDIT:
            return super().heard(now_ms, packet)
        self.chain(RECV, now_ms, packet)
        return []


class AlterEntries(Liar):
    """Log another reading than the s-node chained, and act on it."""

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
    """Log messages later than they came, and act on where neighbours were then."""

    _held: tuple[tuple[int, bytes], ...] = ()

    def heard(self, now_ms: int, packet: bytes) -> list[Action]:
        if not packet[0] & request.AUDIT:
            self._held += ((now_ms, packet),)
        return super().heard(now_ms, packet)

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        while self._held and self._held[0][0] + BELIEVED_AFTER_MS <= now_ms:
            self.accept_packet_at(*self._held[0])
            self._held = self._held[1:]
        return super().sensed(now_ms, reading)


class InsertEntries(Liar):
    """Log messages of an invented robot, which justify driving where the attacker wants."""

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        """Log an invented state before each reading: 3 m aside, approaching."""
        if reading[0] == SENSOR.tag:
            _, _, _, x_m, y_m, vx_mps, vy_mps = MOTION.unpack_from(reading)
            nobody = max(self.plan.ids) + 1
            state = MOTION.pack(KIND_STATE, nobody, now_ms, x_m + 3.0, y_m, vx_mps - 5.0, vy_mps)
            self.accept_packet_at(now_ms, state)
        return super().sensed(now_ms, reading)


class TruncateLog(Hijack):
    """Claim at each round that it has just booted, so that no earlier log exists."""

    def round_due(self, now_ms: int) -> list[Action]:
        rounds.forget_checkpoint(self.f, self.i)
        put_u32(self.f.checkpoint[self.i, START], rounds.AT_T_KEY, now_ms)
        return super().round_due(now_ms)


class ForgeCheckpoint(Hijack):
    """Begin the log at a forged checkpoint, taken after the misbehaviour, with the tokens of an older one."""

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
    """Present the a-node's chain as the s-node's, and the reverse."""

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
    """Present the last honest log with each new token request.

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
        """Send the stored request, if there is one, with a fresh token request in it."""
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
    """Spoof the position sensor from outside so that it drifts; the robot itself is honest."""

    def read(self, now_ms: int, reading: bytes) -> bytes:
        if not self.lies(now_ms) or reading[0] != SENSOR.tag:
            return reading
        aside_m = DRIFT_MPS * (now_ms - self.plan.start_ms) / 1000
        kind, rob_id, t, x_m, y_m, vx_mps, vy_mps = MOTION.unpack_from(reading)
        aside = MOTION.pack(kind, rob_id, t, x_m + aside_m, y_m - aside_m, vx_mps, vy_mps)
        return aside + reading[SENSOR.size :]  # other sensors see from the true position


class ShowThing(Liar):
    """Show the robot's sensor, from outside, the object that was reported last; the robot itself is honest."""

    scene: ClassVar[Scene] = "protocol"
    ASIDE_STEPS: ClassVar[float] = 0.125  # along each axis
    _number = 0  # until the first sighting

    def on_packet(self, now_ms: int, packet: bytes) -> list[Action]:
        if said := fields_of(SIGHTING, packet):
            self._number = said[FIRST_VALUE]
        return super().on_packet(now_ms, packet)

    def read(self, now_ms: int, reading: bytes) -> bytes:
        """Return the reading with a false object beside the robot, if its sensor detects objects."""
        mine = self._honest
        if not self.lies(now_ms) or not isinstance(mine, PeerController) or len(mine.body.beside(reading)) != SEEN.size:
            return reading
        aside_m = self.ASIDE_STEPS * mine.task.step_m
        return reading[: mine.body.sensor.size] + SEEN.form.pack(self._number, aside_m, aside_m)


class StuckSensor(Liar):
    """Freeze the position sensor, a fault; the robot itself is honest."""

    _stuck = b""

    def read(self, now_ms: int, reading: bytes) -> bytes:
        if not self.lies(now_ms):
            return reading
        self._stuck = self._stuck or reading
        return self._stuck


class StarveSensors(Liar):
    """Stop polling sensors: without an INPUT no command and no message is due, and the log shows no fault.

    If it has not polled them since boot, it claims each time that its key has just come, so that no reading is missing.
    """

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        return []

    def next_packet(self, now_ms: int) -> list[Action]:
        if self.lies(now_ms) and self.f.robot[self.i].booted:
            put_u32(self.f.checkpoint[self.i, START], 0, now_ms)
            self.f.robot[self.i].t_key = now_ms
        return super().next_packet(now_ms)


class KeyOfTomorrow(StarveSensors):
    """Stop polling sensors, and claim that the log begins at boot and the mission key comes in 49 days.

    This once passed audits; bti/audit.py has the defence.
    """

    T_KEY_MS: ClassVar[int] = (1 << 32) - (1 << 16)

    def next_packet(self, now_ms: int) -> list[Action]:
        r = self.f.robot[self.i]
        if self.lies(now_ms) and r.t_key != self.T_KEY_MS:
            r.t_key = self.T_KEY_MS
            rounds.forget_checkpoint(self.f, self.i)
        return Liar.next_packet(self, now_ms)


class Interleave(Liar):
    """Poll many readings at one moment and act on them for seconds, on each as if it were new.

    The two chains fix the order of readings, and the order of messages and commands, but not the order between the
    two. When no reading is left, the robot requests audits and then polls again.
    Source: docs/spec/rebound.md (free interleaving).
    """

    STOCK: ClassVar[int] = 12
    SETTLED_MS: ClassVar[int] = 200
    _round_waits = False
    _asked_ms = 0
    _stock: tuple[bytes, ...] = ()

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        """Act on the oldest stored reading; if there is none, act on this one and store copies of it."""
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
            self.record_deviation(now_ms)
        return actions

    def round_due(self, now_ms: int) -> list[Action]:
        """Wait while readings are left that the s-node has chained and the log does not contain."""
        if self._stock:
            self._round_waits = True
            return []
        self._asked_ms = now_ms
        return super().round_due(now_ms)

    def next_packet(self, now_ms: int) -> list[Action]:
        return [] if self._stock else super().next_packet(now_ms)
