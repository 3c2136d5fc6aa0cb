"""Requests begun between the fragments of somebody else's: an auditor puts only so many together at a time."""

from __future__ import annotations

from typing import Any

from phalanx.bti import request
from phalanx.robot.actions import Action
from phalanx.robot.runtime import first_round_ms
from phalanx.wire.table import AUDIT_FRAGMENT

from .silence import RefuseToAudit


class PushOut(RefuseToAudit):
    """Begins a request at whom a victim asks, behind the first fragment of the victim's, so that it loses its place.

    An auditor takes one request of a robot each T_audit / 2, so this is the moment. The simulated radio hands a
    fragment to its addressee alone; who is near could hear it, so that is read from the victim's own memory. It
    audits nobody, and passes its own audits. A hole of ours, closed in bti/fleet.py.
    """

    period_ms = 1

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        s = self.f.settings[0]
        self._tokens, self._t_audit_ms = int(s.f_max) + 1, int(s.t_audit)
        self._body = int(s.frame_max) - request.FRAGMENT_HEAD_BYTES
        victim = max(set(self.plan.ids) - {self.id, *self.plan.accomplices}, default=self.id)
        self._round_ms = first_round_ms(int(s.mission_seed), victim, self._t_audit_ms)
        self._asks = self.f.robot[victim - 1]
        self._again_ms: dict[int, int] = {}

    def on_wake(self, now_ms: int) -> list[Action]:
        """A short fragment of its own, if there is one to come before; until the victim has its tokens."""
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
        frame = AUDIT_FRAGMENT.encode(src=self.id, dst=auditor, request=0, index=1, count=2, bytes=b"\0")
        actions = self.send(now_ms, frame, auditor)
        self.gained += len(actions)
        return actions
