"""Attacks on the radio channel: floods of requests, packets and neighbours, and jamming at chosen moments."""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_right
from typing import Any, ClassVar

from phalanx.bti import request, seeking
from phalanx.bti.fleet import HARDENED, PLAIN
from phalanx.robot.actions import EVERYBODY, Action, Transmit
from phalanx.robot.adversary.liar import Liar, is_audit
from phalanx.robot.runtime import first_round_ms
from phalanx.wire.table import AUDIT_FRAGMENT, AUDIT_HELLO, KIND_AUDIT

from .claims import INVENTED
from .hijack import RefuseToAudit

GHOSTS = 400
NOISE = 0x7D  # kind of an AUDIT packet that receivers ignore


class Flood(Liar, ABC):
    """Base of floods that pause around their own audits, which they intend to pass."""

    QUIET_MS: ClassVar[tuple[int, int]] = (20, 200)  # before its own round begins, and after
    # Whether `hardened` limits this traffic together with the robot's own audits. If so, the robot floods once it has
    # its tokens, until the fraction POURED of the round is over; then the bucket refills.
    SHARES: ClassVar[bool] = True
    POURED: ClassVar[float] = 0.8
    _round_ms = 0

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._t_audit_ms, self._f_max = int(self.f.settings[0].t_audit), int(self.f.settings[0].f_max)
        self._got = self.f.robot["got"]

    def begin_round(self, now_ms: int) -> list[Action]:
        self._round_ms = now_ms
        return super().begin_round(now_ms)

    def on_wake(self, now_ms: int) -> list[Action]:
        before_ms, after_ms = self.QUIET_MS
        self.period_ms = type(self).period_ms
        shares = self.SHARES and self.profile == HARDENED
        if shares:
            before_ms = round((1 - self.POURED) * self._t_audit_ms)
        quiet = (now_ms - self._round_ms + before_ms) % self._t_audit_ms < before_ms + after_ms
        if self.profile != PLAIN and (quiet or (shares and self._got[self.i] <= self._f_max)):
            return []
        return self.send_more(now_ms)

    @abstractmethod
    def send_more(self, now_ms: int) -> list[Action]:
        """Return the packets to send now."""


class RequestFlood(Flood):
    """Use up auditors' time with malformed requests, sent in other robots' names where the a-node allows it."""

    period_ms = 4

    POURED = 0.5  # later packets would make auditors reject its own valid requests
    _turn = 0

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._asked_ms: dict[int, int] = {}

    def send_more(self, now_ms: int) -> list[Action]:
        """Send the next auditor a request for the next victim; in `hardened` at most one per T_audit / 2."""
        others = self.others()
        if len(others) < 2:
            return []
        auditor = others[self._turn % len(others)]
        again_ms = self._asked_ms.get(auditor, 0) + self._t_audit_ms // 2
        if self.profile == HARDENED and now_ms < again_ms:
            return []
        self._asked_ms[auditor] = now_ms
        self._turn += 1
        victim = others[(self._turn + 1 + self._turn // len(others)) % len(others)]
        packet = AUDIT_FRAGMENT.encode(src=victim, dst=auditor, request=0, index=0, count=1, bytes=bytes(8))
        return self.send(now_ms, packet, auditor)


class FrameFlood(Flood):
    """Send as many and as long AUDIT packets as the a-node allows, to an address that no robot has."""

    period_ms = 2

    TRIED_MS: ClassVar[int] = 30  # the radio retries for so long and drops other packets, which the bucket counts

    def send_more(self, now_ms: int) -> list[Action]:
        """Broadcast; in `hardened`, send to an unused address, so that the radio retries."""
        hardened = self.profile == HARDENED
        if hardened:
            self.period_ms = self.TRIED_MS
        nobody = max(self.plan.ids) + 1 if hardened else 0
        packet = audit_packet(
            self.id, nobody, 0x7F, bytes(int(self.f.settings[0].packet_max) - request.AUDIT_HEAD_BYTES)
        )
        return self.send(now_ms, packet, nobody or EVERYBODY)


class CovertTalk(Flood):
    """Exchange data with a colluding robot in AUDIT packets, which are not logged."""

    period_ms = 2

    def send_more(self, now_ms: int) -> list[Action]:
        others = self.plan.colluding or tuple(sorted(self.seen))
        if not others:
            return []
        return self.send(now_ms, audit_packet(self.id, others[0], 0x7E, bytes(1000)), others[0])


class LogFlood(Liar):
    """Broadcast long meaningless packets: each receiver must log them and show them to auditors."""

    period_ms = 20

    def on_wake(self, now_ms: int) -> list[Action]:
        for size in (1500, 360, 150, 40):
            if actions := self.send(now_ms, b"\x60" + bytes(size), EVERYBODY):
                return actions
        return []


class LongFrames(RefuseToAudit):
    """Fill receivers' logs with the longest broadcasts that fit into the airtime of four states.

    This once stopped correct robots; config/bti.py has the defence.
    """

    period_ms = 10

    BYTES: ClassVar[int] = 368  # a byte more, and a full bucket is too small

    def on_wake(self, now_ms: int) -> list[Action]:
        return self.send(now_ms, b"\x60" + bytes(self.BYTES - 1), EVERYBODY)


class GhostAuditors(Liar):
    """Fill neighbours' tables with invented robots, so that they send audit requests that nobody answers.

    Source: docs/spec/rebound.md (ghost auditors).
    """

    period_ms = 5

    def on_wake(self, now_ms: int) -> list[Action]:
        """Claim the state of one more invented robot, far away from all real ones."""
        name = INVENTED + int(self.plan.chance.integers(GHOSTS))
        return self.claim_motion(now_ms, name, (900.0, -900.0, 0.0, 0.0))


class Jam(Flood):
    """Jam the channel with a transmitter that no a-node controls."""

    period_ms = 2

    SHARES = False

    def send_more(self, now_ms: int) -> list[Action]:
        noise = bytes(int(self.f.settings[0].packet_max) - request.AUDIT_HEAD_BYTES)
        return [Transmit(audit_packet(0, 0, 0x7F, noise), EVERYBODY)]


def audit_packet(src: int, dst: int, sub: int, rest: bytes) -> bytes:
    """`AUDIT ‖ src ‖ dst ‖ sub ‖ rest`. Source: docs/spec/rebound.md."""
    return AUDIT_HELLO.form.pack(KIND_AUDIT, src, dst, sub) + rest


def talk(liar: Liar, now_ms: int, packets: int, noise: bytes = b"") -> list[Action]:
    """Broadcast short AUDIT packets, which are not logged."""
    noise = noise or audit_packet(liar.id, 0, NOISE, b"")
    return liar.count([action for _ in range(packets) for action in liar.send(now_ms, noise, EVERYBODY)])


def begin_request(liar: Liar, now_ms: int, auditor: int) -> list[Action]:
    """Send the second of two fragments of a request, and never the first."""
    packet = AUDIT_FRAGMENT.encode(src=liar.id, dst=auditor, request=0, index=1, count=2, bytes=b"\0")
    return liar.count(liar.send(now_ms, packet, auditor))


class TalkOver(Liar):
    """Jam a robot that it does not hear while that robot asks for audits (hidden terminals).

    It knows the mission seed, hence when the victim's rounds and repeats begin, and is silent in between. It sends
    meaningless AUDIT packets, which are not logged; colluding robots take turns. It passes its own audits.
    This once stopped correct robots; bti/request.py has the defence.
    """

    period_ms = 1
    LASTS_MS: ClassVar[int] = 40
    AT_ONCE: ClassVar[int] = 4  # packets without a gap that a long fragment fits into
    _first_ms = _again_ms = 0

    def on_wake(self, now_ms: int) -> list[Action]:
        """Send noise if the victim asks now and it is this robot's turn.

        The victim asks when its round begins, and again for each auditor that did not answer.
        """
        if not self._first_ms:
            s, period_ms = self.f.settings[0], int(self.f.settings[0].t_audit)
            # A robot that it does not hear, if there is one.
            victim = min([name for name in self.victims() if name not in self.seen] or self.victims())
            round_ms = first_round_ms(int(s.mission_seed), victim, period_ms)
            self._first_ms = now_ms + (int(self.f.robot[self.i].t_key) + round_ms + 2 - now_ms) % period_ms
            self._again_ms = period_ms // 2 + int(s.retry) - 1
        asks_ms = (now_ms - self._first_ms) % self._again_ms
        if now_ms < self._first_ms or asks_ms >= self.LASTS_MS:
            self.period_ms = (self._first_ms - now_ms - 1) % self._again_ms + 1  # when the victim asks next
            return []
        self.period_ms = 1
        turns = len(self.plan.colluding) + 1
        if asks_ms % turns != sum(other < self.id for other in self.plan.colluding):
            return []
        return talk(self, now_ms, self.AT_ONCE)


class Mask(RefuseToAudit):
    """Jam every HELLO of honest robots and audit nobody, so that victims learn of compromised auditors only.

    The mission seed tells when rounds begin. All compromised robots send short AUDIT packets, which are not logged, at
    once: a HELLO collides wherever both are received. They also jam answers to SEEK. They pass their own audits.
    This once stopped correct robots; bti/request.py has the defence.
    """

    period_ms = 1
    AT_ANSWERS: ClassVar[int] = 8  # packets that fill the time in which others answer
    _moments: tuple[int, ...] = ()  # ms since the beginning of a round, ascending, at which to jam

    def noise(self) -> bytes:
        """Return the packet that it jams with."""
        return audit_packet(self.id, 0, NOISE, b"")

    def heard(self, now_ms: int, packet: bytes) -> list[Action]:
        """Jam the answers to SEEK."""
        asks = is_audit(packet, seeking.SEEK)
        return super().heard(now_ms, packet) + (talk(self, now_ms, self.AT_ANSWERS, self.noise()) if asks else [])

    def on_wake(self, now_ms: int) -> list[Action]:
        """Jam if a HELLO is due now; wake at the next one."""
        s, period_ms = self.f.settings[0], int(self.f.settings[0].t_audit)
        if not self._moments:
            first_ms = [first_round_ms(int(s.mission_seed), other, period_ms) for other in self.victims()]
            self._moments = tuple(sorted({at % period_ms for at in first_ms}))
        now = (now_ms - int(self.f.robot[self.i].t_key)) % period_ms
        following = bisect_right(self._moments, now)
        talks = following > 0 and self._moments[following - 1] == now
        self.period_ms = (self._moments[following % len(self._moments)] - now - 1) % period_ms + 1
        return talk(self, now_ms, 1, self.noise()) if talks else []


class SlotSquat(Liar):
    """Begin requests to every auditor and never complete them: an auditor reassembles only a few at a time.

    This once stopped correct robots; bti/request.py has the defence.
    """

    period_ms = 300

    def on_wake(self, now_ms: int) -> list[Action]:
        return [action for auditor in self.victims() for action in begin_request(self, now_ms, auditor)]


class PushOut(RefuseToAudit):
    """Push a victim's request out of an auditor's buffer: begin one of its own after the victim's first fragment.

    An auditor accepts one request of a robot per T_audit / 2. The simulated radio delivers a fragment to its addressee
    only, while a real neighbour could overhear it, so the attack reads the victim's memory. It audits nobody, and
    passes its own audits. This once stopped correct robots; bti/fleet.py has the defence.
    """

    period_ms = 1

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        s = self.f.settings[0]
        self._tokens, self._t_audit_ms = int(s.f_max) + 1, int(s.t_audit)
        self._body = int(s.packet_max) - request.FRAGMENT_HEAD_BYTES
        victim = max(self.victims(), default=self.id)
        self._round_ms = first_round_ms(int(s.mission_seed), victim, self._t_audit_ms)
        self._asks = self.f.robot[victim - 1]
        self._again_ms: dict[int, int] = {}

    def on_wake(self, now_ms: int) -> list[Action]:
        """Send a short fragment while the victim's request is incomplete, until the victim has its tokens."""
        if self._asks.got >= self._tokens:
            round_ms = int(self.f.robot[self.i].t_key) + self._round_ms
            self.period_ms = (round_ms - now_ms - 1) % self._t_audit_ms + 1
            return []
        self.period_ms = 1
        auditor = int(self._asks.request_to)
        between = 0 < int(self._asks.request_next) * self._body < int(self._asks.request_len)
        if not between or auditor == self.id or now_ms < self._again_ms.get(auditor, 0):
            return []
        self._again_ms[auditor] = now_ms + self._t_audit_ms // 2
        return begin_request(self, now_ms, auditor)
