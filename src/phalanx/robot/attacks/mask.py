"""Talk at the very moment at which others say that they are there: who does not hear of its auditors asks none."""

from __future__ import annotations

from bisect import bisect_right
from typing import ClassVar

from phalanx.bti import request
from phalanx.robot.actions import EVERYBODY, Action
from phalanx.robot.runtime import first_round_ms

from .floods import audit_frame
from .silence import RefuseToAudit


class Mask(RefuseToAudit):
    """Talks whenever an honest robot says HELLO, and audits nobody: others shall know no auditors but liars.

    Rounds begin at moments that follow from the mission. All liars talk at once, in short AUDIT frames, which no log
    shows: a HELLO is lost wherever it is heard together with them. So are answers to who asks for HELLO, if they can
    be. They pass their own audits. A hole of ours, closed in bti/request.py.
    """

    period_ms = 1
    LASTS_MS: ClassVar[int] = 1
    AT_ONCE: ClassVar[int] = 1
    AT_ANSWERS: ClassVar[int] = 8  # as many as fill the time for which others answer
    NOISE: ClassVar[int] = 0x7D
    _moments: tuple[int, ...] = ()  # ms of a round, rising, at which to talk

    def heard(self, now_ms: int, frame: bytes) -> list[Action]:
        """Who asks for HELLO shall not hear it."""
        is_audit = bool(frame[0] & request.AUDIT) and len(frame) >= request.AUDIT_HEAD_BYTES
        asks = is_audit and frame[request.AT_SUB] == request.SEEK
        return super().heard(now_ms, frame) + (self._talk(now_ms, self.AT_ANSWERS) if asks else [])

    def on_wake(self, now_ms: int) -> list[Action]:
        """A few short frames, if somebody says HELLO now; the next time when somebody does again."""
        s, period_ms = self.f.settings[0], int(self.f.settings[0].t_audit)
        if not self._moments:
            others = set(self.plan.ids) - {self.id, *self.plan.accomplices}
            first_ms = [first_round_ms(int(s.mission_seed), other, period_ms) for other in others]
            self._moments = tuple(sorted({(at + k) % period_ms for at in first_ms for k in range(self.LASTS_MS)}))
        now = (now_ms - int(self.f.robot[self.i].t_key)) % period_ms
        following = bisect_right(self._moments, now)
        talks = following > 0 and self._moments[following - 1] == now
        self.period_ms = (self._moments[following % len(self._moments)] - now - 1) % period_ms + 1
        return self._talk(now_ms, self.AT_ONCE) if talks else []

    def _talk(self, now_ms: int, frames: int) -> list[Action]:
        actions = [action for _ in range(frames) for action in self._say(now_ms, self.NOISE)]
        self.gained += len(actions)
        return actions

    def _say(self, now_ms: int, sub: int) -> list[Action]:
        return self.send(now_ms, audit_frame(self.id, 0, sub, b""), EVERYBODY)
