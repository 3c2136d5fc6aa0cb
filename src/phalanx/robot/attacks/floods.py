"""Too much: of requests, of frames, of neighbours; and talk where nobody listens."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np

from phalanx.bti import request
from phalanx.bti.fleet import BOUND, PLAIN
from phalanx.robot.actions import EVERYBODY, Action, Transmit
from phalanx.wire.table import AUDIT_FRAGMENT

from .claims import INVENTED
from .hijack import RefuseToAudit
from .liar import Liar

GHOSTS = 400


class Flood(Liar, ABC):
    """Leaves room for its own audits, which it means to pass."""

    QUIET_MS: ClassVar[tuple[int, int]] = (20, 200)  # before a round of its own, and from its beginning on
    # Whether `bound` has a limit for it, which its own audits share: then it pours when it has its tokens, until so
    # much of the round is over. In the rest the bucket fills again.
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
        shares = self.SHARES and self.profile == BOUND
        if shares:
            before_ms = round((1 - self.POURED) * self._t_audit_ms)
        quiet = (now_ms - self._round_ms + before_ms) % self._t_audit_ms < before_ms + after_ms
        if self.profile != PLAIN and (quiet or (shares and self._got[self.i] <= self._f_max)):
            return []
        return self.pour(now_ms)

    @abstractmethod
    def pour(self, now_ms: int) -> list[Action]:
        """Send more of it."""


class RequestFlood(Flood):
    """Uses up what auditors will do for others: malformed requests, in their names where an a-node lets it."""

    period_ms = 4

    POURED = 0.5  # after that it would keep its own true requests from being taken
    _turn = 0

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._asked_ms: dict[int, int] = {}

    def pour(self, now_ms: int) -> list[Action]:
        """Tell the next auditor of the next victim; under its own name only, no more than are looked at."""
        others = self.others()
        if len(others) < 2:
            return []
        auditor = others[self._turn % len(others)]
        again_ms = self._asked_ms.get(auditor, 0) + self._t_audit_ms // 2
        if self.profile == BOUND and now_ms < again_ms:
            return []
        self._asked_ms[auditor] = now_ms
        self._turn += 1
        victim = others[(self._turn + 1 + self._turn // len(others)) % len(others)]
        frame = AUDIT_FRAGMENT.encode(src=victim, dst=auditor, request=0, index=0, count=1, bytes=bytes(8))
        return self.send(now_ms, frame, auditor)


class FrameFlood(Flood):
    """As many and as long AUDIT frames as its a-node lets out, for nobody."""

    period_ms = 2

    TRIED_MS: ClassVar[int] = 30  # so long the radio tries; what comes meanwhile it throws away, and the bucket counts

    def pour(self, now_ms: int) -> list[Action]:
        """Send to all, or where airtime is counted, to nobody, so that the radio tries again and again."""
        bound = self.profile == BOUND
        if bound:
            self.period_ms = self.TRIED_MS
        nobody = max(self.plan.ids) + 1 if bound else 0
        frame = audit_frame(self.id, nobody, 0x7F, bytes(int(self.f.settings[0].frame_max) - request.AUDIT_HEAD_BYTES))
        return self.send(now_ms, frame, nobody or EVERYBODY)


class CovertTalk(Flood):
    """Talks to an accomplice in AUDIT frames, which no log shows."""

    period_ms = 2

    def pour(self, now_ms: int) -> list[Action]:
        others = self.plan.accomplices or tuple(sorted(self.seen))
        if not others:
            return []
        return self.send(now_ms, audit_frame(self.id, others[0], 0x7E, bytes(1000)), others[0])


class LogFlood(Liar):
    """Says at length what means nothing: who hears it has to log it, and to show it to auditors."""

    period_ms = 20

    def on_wake(self, now_ms: int) -> list[Action]:
        for size in (1500, 360, 150, 40):
            if actions := self.send(now_ms, b"\x60" + bytes(size), EVERYBODY):
                return actions
        return []


class LongFrames(RefuseToAudit):
    """Says what means nothing in the frames that fill others' logs most: as long as four states' airtime allows.

    A hole of ours, closed in config/bti.py.
    """

    period_ms = 10

    BYTES: ClassVar[int] = 368  # a byte more, and a full bucket is too small

    def on_wake(self, now_ms: int) -> list[Action]:
        return self.send(now_ms, b"\x60" + bytes(self.BYTES - 1), EVERYBODY)


class GhostAuditors(Liar):
    """Fills its neighbours' tables with robots that are not there: whoever asks one of them for an audit asks in vain.

    Source: docs/spec/rebound.md (ghost auditors).
    """

    period_ms = 5

    def on_wake(self, now_ms: int) -> list[Action]:
        """Claim one more ghost, far enough away to be in nobody's way."""
        name = INVENTED + int(self.plan.chance.integers(GHOSTS))
        return self.claim_motion(now_ms, name, (900.0, -900.0, 0.0, 0.0))


class Jam(Flood):
    """Somebody's transmitter, beside the robots' radios: it asks no a-node."""

    period_ms = 2

    SHARES = False

    def pour(self, now_ms: int) -> list[Action]:
        noise = bytes(int(self.f.settings[0].frame_max) - request.AUDIT_HEAD_BYTES)
        return [Transmit(audit_frame(0, 0, 0x7F, noise), EVERYBODY)]


def audit_frame(src: int, dst: int, sub: int, rest: bytes) -> bytes:
    """`AUDIT ‖ src ‖ dst ‖ sub ‖ rest`. Source: docs/spec/rebound.md."""
    head = np.zeros(request.AUDIT_HEAD_BYTES, np.uint8)
    request.audit_head(head, src, dst, sub)
    return head.tobytes() + rest
