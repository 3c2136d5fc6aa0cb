"""True tokens that are not what was asked for, and true requests for audits that keep auditors busy.

Holes of ours, closed in bti/rounds.py and robot/handlers.py.
"""

from __future__ import annotations

from typing import Any

from phalanx.bti import log, request, trusted
from phalanx.bti.fleet import BOUND, PLAIN
from phalanx.robot.actions import Action
from phalanx.wire.fields import get_u16, put_u16, row
from phalanx.wire.table import AUDIT_FRAGMENT, BOOTED, HASH_BYTES, TOKEN_REQUEST

from .liar import Liar, tokens_in
from .silence import RefuseToAudit


class StaleAnswers(Liar):
    """Audits every other time only, and sends the last token again between: the victim thinks that it was answered."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._issued: dict[int, bytes] = {}
        self._answered: dict[int, int] = {}
        self._repeated = b""

    def on_packet(self, now_ms: int, packet: bytes) -> list[Action]:
        actions = super().on_packet(now_ms, packet)
        self._issued.update({each.to: each.packet for each in tokens_in(actions) if each.packet != self._repeated})
        return actions

    def asked(self, now_ms: int, frame: bytes) -> list[Action]:
        """Send the old token at the first fragment of a request, and pass over the rest."""
        src, no = (int(get_u16(row(frame), at)) for at in (request.AT_SRC, request.AT_REQUEST))
        if src in self._issued:
            self._answered[src] = no
            self.gained += 1
            self._repeated = self._issued.pop(src)
            return self.send(now_ms, self._repeated, src)
        return [] if self._answered.get(src) == no else super().asked(now_ms, frame)


class WrongCheckpoint(Liar):
    """Vouches for where the log begins, as it has before, and not for the checkpoint that was to be vouched for."""

    def asked(self, now_ms: int, frame: bytes) -> list[Action]:
        """Read a request as if its claim were its start."""
        if self.profile == PLAIN:
            return super().asked(now_ms, frame)
        if (place := self.whole_request(now_ms, frame)) < 0:
            return []
        q = self.shown(place)
        tokens = int(q[request.AT_TOKENS])
        if tokens:
            at = request.HEAD_BYTES + tokens * request.TOKEN_BYTES
            length = int(get_u16(q, request.AT_CHECKPOINT_LEN))
            trusted.sha1(q[at : at + length], length, q[request.AT_HCKPT : request.AT_HCKPT + HASH_BYTES])
        return self.vouch(now_ms, place)


class Drain(RefuseToAudit):
    """Passes its own audits, and takes up the time that auditors have for others with one true token request each.

    The request around it shows no log, and is refused; but it has to be looked at. It audits nobody, so that others ask
    the more.
    """

    period_ms = 20
    _made_ms = _no = 0

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.kept: dict[int, bytes] = {}
        self._sent_ms: dict[int, int] = {}

    def on_wake(self, now_ms: int) -> list[Action]:
        """Send the next one that is due; never to those whom it asks for audits of its own."""
        f, i = self.f, self.i
        if self.profile == PLAIN or f.robot["request_len"][i] > 0:
            return []
        t_audit, peers = int(f.settings[0].t_audit), int(f.robot["peers"][i])
        # As lists: a record's field takes microseconds, and it wakes often.
        for tor, asked_ms in zip(f.peer_id[i, :peers].tolist(), f.peer["asked_ms"][i, :peers].tolist(), strict=True):
            asked = now_ms - asked_ms < 2 * t_audit
            just_sent = now_ms - self._sent_ms.get(tor, 0) <= t_audit // 2
            if tor in self.plan.accomplices or asked or just_sent:
                continue
            if tor not in self.kept and not self._make(now_ms, tor):
                continue
            self._no = (self._no + 1) & 0xFFFF
            self._sent_ms[tor] = now_ms
            self.gained += 1
            only = AUDIT_FRAGMENT.encode(src=self.id, dst=tor, request=self._no, index=0, count=1, bytes=self.kept[tor])
            return self.send(now_ms, only, tor)
        return []

    def _make(self, now_ms: int, tor: int) -> bool:
        """Make a true token request, in a request that shows an empty log since boot; its own log shows the flush."""
        spare_ms = int(self.f.settings[0].t_audit) * 2 // 5
        treq = row(bytes(TOKEN_REQUEST.size))
        if now_ms - self._made_ms < spare_ms:  # its own audits need token requests too
            return False
        if trusted.anode_token_request(self.profile, self.f.anode[self.i], now_ms, tor, treq) < 0:
            return False
        self._made_ms = now_ms
        if self.profile == BOUND:
            log.mark(self.f, self.i, log.FLUSH_A)
        q = row(bytes(request.HEAD_BYTES + BOOTED.size))
        q[0], q[request.AT_FLAGS] = request.VERSION, 1
        put_u16(q, request.AT_TEE, self.id)
        q[request.AT_T : request.AT_TOP_S] = treq
        put_u16(q, request.AT_CHECKPOINT_LEN, BOOTED.size)
        self.kept[tor] = q.tobytes()
        return True
