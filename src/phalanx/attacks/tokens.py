"""Attacks with tokens: forged, replayed or shared ones, stale answers, and requests that keep auditors busy.

bti/rounds.py and robot/handlers.py have the defences against those that once succeeded.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np

from phalanx.bti import log, request, trusted
from phalanx.bti.fleet import HARDENED, PENDING, PLAIN, START
from phalanx.robot.actions import Action
from phalanx.robot.adversary.liar import Liar, tokens_in
from phalanx.wire.fields import Row, get_u16, put_u16, row
from phalanx.wire.table import (
    AUDIT_FRAGMENT,
    AUDIT_TOKEN,
    BOOTED,
    HASH_BYTES,
    KEY_BYTES,
    MAC_BYTES,
    TOKEN,
    TOKEN_REQUEST,
)

from .hijack import Hijack, RefuseToAudit


class Token(NamedTuple):
    """The arguments of `anode_install_token`."""

    auditor: int
    t: int
    hckpt: bytes
    mac: bytes


class TokenForger(Hijack, ABC):
    """Base of attacks that ram, and keep offering the a-node tokens without an audit."""

    period_ms = 100

    def on_wake(self, now_ms: int) -> list[Action]:
        if self.profile != PLAIN:
            for token in self.tokens(now_ms):
                hckpt, mac = row(token.hckpt), row(token.mac)
                anode = self.f.anode[self.i]
                if trusted.anode_install_token(self.profile, anode, now_ms, token.auditor, token.t, hckpt, mac) >= 0:
                    self.gained += 1
        return []

    @abstractmethod
    def tokens(self, now_ms: int) -> list[Token]:
        """Return the tokens to offer to the a-node now."""


class ForgeTokens(TokenForger):
    """Offer tokens with guessed MACs."""

    def tokens(self, now_ms: int) -> list[Token]:
        dice, names = self.plan.chance, self.others()
        return [
            Token(names[int(dice.integers(len(names)))], now_ms, dice.bytes(HASH_BYTES), dice.bytes(MAC_BYTES))
            for _ in range(10)
        ]


class ShareTokens(TokenForger):
    """Offer tokens that it issued to other robots."""

    _issued: tuple[Token, ...] = ()

    def on_packet(self, now_ms: int, packet: bytes) -> list[Action]:
        actions = super().on_packet(now_ms, packet)
        for token in tokens_in(actions):
            fields = AUDIT_TOKEN.decode(token.packet)
            q = self.shown(int(self.w.place[0]))
            hckpt = q[request.AT_HCKPT : request.AT_HCKPT + HASH_BYTES].tobytes()
            self._issued += (Token(self.id, fields["t"], hckpt, fields["mac"]),)
        return actions

    def tokens(self, now_ms: int) -> list[Token]:
        """Return the newest ones, as they are and with other auditors' names and the current time."""
        newest = list(self._issued[-10:])
        return newest + [token._replace(auditor=rob_id, t=now_ms) for token in newest for rob_id in self.plan.ids[:3]]


class ReplayTokens(TokenForger):
    """Offer its own tokens again after they have expired."""

    _kept: frozenset[Token] = frozenset()

    def on_packet(self, now_ms: int, packet: bytes) -> list[Action]:
        actions = super().on_packet(now_ms, packet)
        f, i, r = self.f, self.i, self.f.robot[self.i]
        for which, count in ((START, r.tokens_start), (PENDING, r.tokens_pending)):
            hckpt = f.hckpt[i, which].tobytes()
            tokens = f.token[i, which, : int(count)]
            self._kept |= {Token(int(each.auditor), int(each.t), hckpt, each.mac.tobytes()) for each in tokens}
        return actions

    def tokens(self, now_ms: int) -> list[Token]:
        """Return all of them as they are, and with the current time, which their MACs do not cover."""
        kept = sorted(self._kept)
        return kept + [token._replace(t=now_ms) for token in kept]


class SelfIssue(TokenForger):
    """Have its own a-node issue a token for itself."""

    def tokens(self, now_ms: int) -> list[Token]:
        profile, anode = self.profile, self.f.anode[self.i]
        treq, mac, hckpt = row(bytes(TOKEN_REQUEST.size)), row(bytes(MAC_BYTES)), row(bytes(HASH_BYTES))
        if trusted.anode_token_request(profile, anode, now_ms, self.id, treq) < 0:
            return []
        asked = TOKEN_REQUEST.decode(treq.tobytes())
        t, top, treq_mac = asked["t"], row(asked["top"]), row(asked["mac"])
        made = trusted.anode_issue_token(profile, anode, self.id, t, top, treq_mac, hckpt, mac)
        return [Token(self.id, t, hckpt.tobytes(), mac.tobytes())] if made >= 0 else []


class Collude(Hijack):
    """Issue tokens to other compromised robots without an audit, and get theirs."""

    def asked(self, now_ms: int, packet: bytes) -> list[Action]:
        if self.profile == PLAIN or get_u16(row(packet), request.AT_SRC) not in self.plan.colluding:
            return super().asked(now_ms, packet)
        place = self.whole_request(now_ms, packet)
        return self.issue_token_unaudited(now_ms, place) if place >= 0 else []


class ZeroKey(Hijack):
    """Forge tokens that never expire, before the key is loaded. Source: docs/spec/rebound.md (zero key)."""

    @classmethod
    def before_key(cls, rob_id: int, profile: int, anode: Row, f_max: int) -> None:
        """Install tokens of f_max + 1 invented auditors, dated at the clock's end; no valid token replaces them."""
        zero, hckpt = bytes(KEY_BYTES), bytes(HASH_BYTES)
        for auditor in range(0xFFFF - f_max, 0x10000):
            t = (1 << 32) - 1
            message = TOKEN.encode(auditor=auditor, auditee=rob_id, t=t, hckpt=hckpt)
            mac = np.zeros(MAC_BYTES, np.uint8)
            trusted.lightmac(row(zero), row(message), len(message), mac)
            trusted.anode_install_token(profile, anode, 0, auditor, t, row(hckpt), mac)


class StaleAnswers(Liar):
    """Audit every other request, and answer the rest with an old token."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._issued: dict[int, bytes] = {}
        self._answered: dict[int, int] = {}
        self._repeated = b""

    def on_packet(self, now_ms: int, packet: bytes) -> list[Action]:
        actions = super().on_packet(now_ms, packet)
        self._issued.update({each.to: each.packet for each in tokens_in(actions) if each.packet != self._repeated})
        return actions

    def asked(self, now_ms: int, packet: bytes) -> list[Action]:
        """Send the old token at the first fragment of a request, and ignore the other fragments."""
        src, no = (int(get_u16(row(packet), at)) for at in (request.AT_SRC, request.AT_REQUEST))
        if src in self._issued:
            self._answered[src] = no
            self.gained += 1
            self._repeated = self._issued.pop(src)
            return self.send(now_ms, self._repeated, src)
        return [] if self._answered.get(src) == no else super().asked(now_ms, packet)


class WrongCheckpoint(Liar):
    """Issue tokens for the checkpoint at the beginning of the log, instead of the one at its end."""

    def asked(self, now_ms: int, packet: bytes) -> list[Action]:
        if self.profile == PLAIN:
            return super().asked(now_ms, packet)
        if (place := self.whole_request(now_ms, packet)) < 0:
            return []
        q = self.shown(place)
        tokens = int(q[request.AT_TOKENS])
        if tokens:
            at = request.HEAD_BYTES + tokens * request.TOKEN_BYTES
            length = int(get_u16(q, request.AT_CHECKPOINT_LEN))
            trusted.sha1(q[at : at + length], length, q[request.AT_HCKPT : request.AT_HCKPT + HASH_BYTES])
        return self.issue_token_unaudited(now_ms, place)


class Drain(RefuseToAudit):
    """Use up auditors' time with valid token requests; pass its own audits.

    The audit request around each one has an empty log and is refused, but only after an audit. The attacker audits no
    other robot, so that those need more audits from the rest.
    """

    period_ms = 20
    _made_ms = _no = 0

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.kept: dict[int, bytes] = {}
        self._sent_ms: dict[int, int] = {}

    def on_wake(self, now_ms: int) -> list[Action]:
        """Send the next request that is due; none to robots that it asks for its own audits."""
        f, i = self.f, self.i
        if self.profile == PLAIN or f.robot["request_len"][i] > 0:
            return []
        t_audit, peers = int(f.settings[0].t_audit), int(f.robot["peers"][i])
        # As lists: reading a record's field takes microseconds, and this runs often.
        for auditor, asked_ms in zip(
            f.peer_id[i, :peers].tolist(), f.peer["asked_ms"][i, :peers].tolist(), strict=True
        ):
            asked = now_ms - asked_ms < 2 * t_audit
            just_sent = now_ms - self._sent_ms.get(auditor, 0) <= t_audit // 2
            if auditor in self.plan.colluding or asked or just_sent:
                continue
            if auditor not in self.kept and not self._make(now_ms, auditor):
                continue
            self._no = (self._no + 1) & 0xFFFF
            self._sent_ms[auditor] = now_ms
            self.gained += 1
            only = AUDIT_FRAGMENT.encode(
                src=self.id, dst=auditor, request=self._no, index=0, count=1, bytes=self.kept[auditor]
            )
            return self.send(now_ms, only, auditor)
        return []

    def _make(self, now_ms: int, auditor: int) -> bool:
        """Make a valid token request within an audit request with an empty log; log the flush that it causes."""
        spare_ms = int(self.f.settings[0].t_audit) * 2 // 5
        treq = row(bytes(TOKEN_REQUEST.size))
        if now_ms - self._made_ms < spare_ms:  # its own audits need token requests too
            return False
        if trusted.anode_token_request(self.profile, self.f.anode[self.i], now_ms, auditor, treq) < 0:
            return False
        self._made_ms = now_ms
        if self.profile == HARDENED:
            log.mark(self.f, self.i, log.FLUSH_A)
        q = row(bytes(request.HEAD_BYTES + BOOTED.size))
        q[0], q[request.AT_FLAGS] = request.VERSION, 1
        put_u16(q, request.AT_AUDITEE, self.id)
        q[request.AT_T : request.AT_TOP_S] = treq
        put_u16(q, request.AT_CHECKPOINT_LEN, BOOTED.size)
        self.kept[auditor] = q.tobytes()
        return True
