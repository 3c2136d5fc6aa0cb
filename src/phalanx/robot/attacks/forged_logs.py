"""Logs that show another past than the trusted nodes chained: left out, altered, moved, invented, cut off."""

from __future__ import annotations

from typing import Any

from phalanx.bti import log, request, rounds, trusted
from phalanx.bti.audit import INPUT, RECV
from phalanx.bti.fleet import PENDING, START
from phalanx.bti.log import ENTRY_HEAD_BYTES
from phalanx.robot.actions import Action
from phalanx.wire.fields import put_u32
from phalanx.wire.table import HASH_BYTES, KIND_STATE, MAC_BYTES, SENSOR

from .hijack import Hijack
from .liar import MOTION, Liar

ASIDE_M = 30.0
BELIEVED_AFTER_MS = 3000


class DropEntries(Liar):
    """Has not heard its neighbours, it says: nobody is in its way, and it drives straight to the goal."""

    def heard(self, now_ms: int, frame: bytes) -> list[Action]:
        """Pretend that what is no audit traffic never came; the a-node chains it all the same."""
        if frame[0] & request.AUDIT:
            return super().heard(now_ms, frame)
        self.chain(RECV, now_ms, frame)
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

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._held: list[tuple[int, bytes]] = []

    def heard(self, now_ms: int, frame: bytes) -> list[Action]:
        if not frame[0] & request.AUDIT:
            self._held.append((now_ms, frame))
        return super().heard(now_ms, frame)

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        while self._held and self._held[0][0] + BELIEVED_AFTER_MS <= now_ms:
            self.believe(*self._held.pop(0))
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
        tor = int(rounds.next_candidate(f, i, now_ms))
        if r.quota <= 0 or tor == 0:
            return False
        if trusted.anode_token_request(self.profile, f.anode[i], now_ms, tor, treq) < 0:
            r.quota = 0
            return False
        f.peer[i, rounds.peer_at(f, i, tor)].asked = r.round_no
        r.quota -= 1
        r.request_no = (int(r.request_no) + 1) & 0xFFFF
        r.request_to, r.request_next, r.asked_at, r.request_len = tor, 0, now_ms, len(self._kept)
        q = f.request.rows[request.row_of(f, i)]
        q[: len(self._kept)] = memoryview(self._kept)
        q[request.AT_T : request.AT_TOP_A] = treq[: rounds.TREQ_TOP]
        q[request.AT_TREQ_MAC : request.AT_TOP_S] = treq[rounds.TREQ_MAC :]
        return True
