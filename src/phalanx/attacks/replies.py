"""Attacks on audit replies: tokens that collide, and relayed HELLOs of auditors out of range."""

from __future__ import annotations

from typing import Any, ClassVar

from phalanx.bti import request, seeking
from phalanx.robot.actions import EVERYBODY, Action, Transmit
from phalanx.robot.adversary.liar import Liar, is_audit
from phalanx.robot.runtime import first_round_ms
from phalanx.wire.fields import get_u16, get_u32, row
from phalanx.wire.table import AUDIT_HELLO, AUDIT_HERE

from .channel import talk


class TalkOverReplies(Liar):
    """Jam a victim after each of its requests, so that tokens of auditors out of the attackers' range are lost.

    It knows the mission seed, hence when the victim's rounds begin, and hears whatever the victim sends. The simulated
    radio delivers a fragment to its addressee only, while a real neighbour could overhear it, so the attack reads the
    victim's memory. It passes its own audits. Source: docs/adr/0039.
    """

    period_ms = 1
    LASTS_MS: ClassVar[int] = 10
    AT_ONCE: ClassVar[int] = 3
    _victim = _round_ms = _until_ms = 0
    _sent: tuple[int, int, int] | None = None

    def heard(self, now_ms: int, packet: bytes) -> list[Action]:
        """Jam the answers to the victim's HELLO and SEEK."""
        asked = super().heard(now_ms, packet)
        if request.is_audit(row(packet), len(packet)) and get_u16(row(packet), request.AT_SRC) == self._victim:
            self._until_ms = now_ms + self.LASTS_MS
            asked += talk(self, now_ms, 2 * self.AT_ONCE)
        return asked

    def on_wake(self, now_ms: int) -> list[Action]:
        """Jam while answers to the victim are expected."""
        t_audit_ms = int(self.f.settings[0].t_audit)
        if not self._victim:
            self._victim = min((name for name in self.victims() if name in self.seen), default=min(self.victims()))
            seed = int(self.f.settings[0].mission_seed)
            self._round_ms = int(self.f.robot[self.i].t_key) + first_round_ms(seed, self._victim, t_audit_ms)
        victim = self.f.robot[self._victim - 1]
        sent = int(victim.request_no), int(victim.request_next), int(victim.repeats)
        if sent != self._sent:
            self._sent, self._until_ms = sent, max(self._until_ms, now_ms + self.LASTS_MS)
        begins = (now_ms + 1 - self._round_ms) % t_audit_ms <= self.LASTS_MS
        return talk(self, now_ms, self.AT_ONCE) if begins or now_ms < self._until_ms else []


class RelayHello(Liar):
    """Relay the HELLO of robots out of its neighbours' range, so that these send audit requests in vain (wormhole).

    A second compromised robot near the distant robots receives them. Both bypass their a-nodes with radios of their
    own: a sealed packet is valid for two seconds, wherever it is received. The mission seed tells what the second
    robot hears. With the option `both` they also relay SEEK and its answers, without loss and within 100 ms: no
    defence stops that. Source: docs/spec/sealed-radio.md; docs/adr/0039.
    """

    period_ms = 1
    GHOSTS: ClassVar[int] = 40
    ANSWERS_MS: ClassVar[int] = 100  # until the relayed answers are back
    _moments: tuple[tuple[int, int], ...] = ()

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._waiting: list[tuple[int, bytes]] = []

    def ghosts(self) -> list[int]:
        """Return the robots that it does not hear, or all robots if it hears all."""
        return [name for name in self.victims() if name not in self.seen][: self.GHOSTS] or self.victims()

    def heard(self, now_ms: int, packet: bytes) -> list[Action]:
        """Relay a SEEK, and later the answers of the distant robots."""
        is_seek = is_audit(packet, seeking.SEEK) and len(packet) == seeking.SEEK_BYTES
        if is_seek and self.plan.options.get("both"):
            src, nonce = get_u16(row(packet), request.AT_SRC), int(get_u32(row(packet), seeking.SEEK_NONCE))
            answers = [AUDIT_HERE.encode(src=name, dst=src, nonce=nonce) for name in self.ghosts()]
            self._waiting += [(now_ms + self.ANSWERS_MS + k, answer) for k, answer in enumerate(answers)]
        return super().heard(now_ms, packet)

    def on_wake(self, now_ms: int) -> list[Action]:
        """Send the HELLOs and answers that are due."""
        s, period_ms = self.f.settings[0], int(self.f.settings[0].t_audit)
        if not self._moments:
            seed = int(s.mission_seed)
            rounds = ((first_round_ms(seed, name, period_ms) % period_ms, name) for name in self.ghosts())
            self._moments = tuple(sorted(rounds))
        now = (now_ms - int(self.f.robot[self.i].t_key)) % period_ms
        due = [AUDIT_HELLO.encode(src=name, dst=0) for at_ms, name in self._moments if at_ms == now]
        due += [answer for at_ms, answer in self._waiting if at_ms <= now_ms]
        self._waiting = [each for each in self._waiting if each[0] > now_ms]
        return self.count([Transmit(packet, get_u16(row(packet), request.AT_DST) or EVERYBODY) for packet in due])
