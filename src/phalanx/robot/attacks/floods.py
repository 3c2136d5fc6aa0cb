"""Too much: of requests, of frames, of neighbours; and talk where nobody listens."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np

from phalanx.bti import request, rounds
from phalanx.bti.fleet import BOUND, PLAIN
from phalanx.robot.actions import EVERYBODY, Action, Transmit
from phalanx.wire.table import AUDIT_FRAGMENT, KIND_STATE

from .liar import MOTION, Liar
from .silence import RefuseToAudit

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
        """The moment is remembered."""
        self._round_ms = now_ms
        return super().begin_round(now_ms)

    def on_wake(self, now_ms: int) -> list[Action]:
        """More, unless its own audits are due."""
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
        """More of it."""


class RequestFlood(Flood):
    """Uses up what auditors will do for others: malformed requests, in their names where an a-node lets it."""

    period_ms = 4

    POURED = 0.5  # after that it would keep its own true requests from being taken
    _turn = 0

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._asked_ms: dict[int, int] = {}

    def pour(self, now_ms: int) -> list[Action]:
        """The next auditor hears of the next victim; under its own name only, no more than are looked at."""
        others = [rob_id for rob_id in self.plan.ids if rob_id != self.id]
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
        """One more: to all, or where airtime is counted, to nobody, so that the radio tries again and again."""
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
        """One more kilobyte."""
        others = self.plan.accomplices or tuple(sorted(self.seen))
        if not others:
            return []
        return self.send(now_ms, audit_frame(self.id, others[0], 0x7E, bytes(1000)), others[0])


class LogFlood(Liar):
    """Says at length what means nothing: who hears it has to log it, and to show it to auditors."""

    period_ms = 20

    def on_wake(self, now_ms: int) -> list[Action]:
        """The longest frame that the a-node lets out now."""
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
        """One more, when the bucket is full enough for it."""
        return self.send(now_ms, b"\x60" + bytes(self.BYTES - 1), EVERYBODY)


class SlotSquat(Liar):
    """Begins requests at every auditor and never ends them: an auditor puts only so many together at a time.

    A hole of ours, closed in bti/request.py.
    """

    period_ms = 300

    def on_wake(self, now_ms: int) -> list[Action]:
        """The same last fragment to each, once more."""
        others = [rob_id for rob_id in self.plan.ids if rob_id not in (self.id, *self.plan.accomplices)]
        actions = [action for auditor in others for action in self.send(now_ms, self._last_of_two(auditor), auditor)]
        self.gained += len(actions)
        return actions

    def _last_of_two(self, auditor: int) -> bytes:
        return AUDIT_FRAGMENT.encode(src=self.id, dst=auditor, request=0, index=1, count=2, bytes=b"\0")


class TalkOver(Liar):
    """Talks while a robot that it does not hear asks for audits: whom both are near hears neither.

    It knows the mission, so when that robot's rounds begin and when it asks again, and is silent in between. What it
    says are AUDIT frames of no meaning, which no log shows; accomplices take turns. It passes its own audits.
    A hole of ours, closed in bti/request.py.
    """

    period_ms = 1
    FIRST_MS: ClassVar[int] = 200  # the first robot's first round, in a mission's time
    LASTS_MS: ClassVar[int] = 40
    AT_ONCE: ClassVar[int] = 4  # leaves no gap that a long fragment fits into
    _first_ms = _again_ms = 0

    def on_wake(self, now_ms: int) -> list[Action]:
        """A few short frames, if the victim asks now and it is this liar's turn.

        First when the victim's round begins, and then each time that it asks again those that did not answer.
        """
        if not self._first_ms:
            s, period_ms = self.f.settings[0], int(self.f.settings[0].t_audit)
            round_ms = self.FIRST_MS + int(rounds.mixed(int(s.mission_seed) + 1, self._victim())) % period_ms
            self._first_ms = now_ms + (int(self.f.robot[self.i].t_key) + round_ms + 2 - now_ms) % period_ms
            self._again_ms = period_ms // 2 + int(s.retry) - 1
        asks_ms = (now_ms - self._first_ms) % self._again_ms
        if now_ms < self._first_ms or asks_ms >= self.LASTS_MS:
            self.period_ms = (self._first_ms - now_ms - 1) % self._again_ms + 1  # when it is asked again
            return []
        self.period_ms = 1
        turns = len(self.plan.accomplices) + 1
        if asks_ms % turns != sum(other < self.id for other in self.plan.accomplices):
            return []
        noise = audit_frame(self.id, 0, 0x7D, b"")
        actions = [action for _ in range(self.AT_ONCE) for action in self.send(now_ms, noise, EVERYBODY)]
        self.gained += len(actions)
        return actions

    def _victim(self) -> int:
        """Somebody whom it does not hear, if there is one."""
        others = [name for name in self.plan.ids if name not in (self.id, *self.plan.accomplices)]
        return min([name for name in others if name not in self.seen] or others)


class GhostAuditors(Liar):
    """Fills its neighbours' tables with robots that are not there: whoever asks one of them for an audit asks in vain.

    Source: docs/spec/rebound.md (ghost auditors).
    """

    period_ms = 5

    def on_wake(self, now_ms: int) -> list[Action]:
        """One more ghost, far enough away to be in nobody's way."""
        name = 60_000 + int(self.plan.chance.integers(GHOSTS))
        return self.send(now_ms, MOTION.pack(KIND_STATE, name, now_ms, 900.0, -900.0, 0.0, 0.0), EVERYBODY)


class Jam(Flood):
    """Somebody's transmitter, beside the robots' radios: it asks no a-node."""

    period_ms = 2

    SHARES = False

    def pour(self, now_ms: int) -> list[Action]:
        """Noise."""
        noise = bytes(int(self.f.settings[0].frame_max) - request.AUDIT_HEAD_BYTES)
        return [Transmit(audit_frame(0, 0, 0x7F, noise), EVERYBODY)]


def audit_frame(src: int, dst: int, sub: int, rest: bytes) -> bytes:
    """`AUDIT ‖ src ‖ dst ‖ sub ‖ rest`. Source: docs/spec/rebound.md."""
    head = np.zeros(request.AUDIT_HEAD_BYTES, np.uint8)
    request.audit_head(head, src, dst, sub)
    return head.tobytes() + rest
