"""What a robot leaves out: to speak, to be audited, to audit, to live."""

from __future__ import annotations

from phalanx.robot.actions import Action
from phalanx.robot.controllers.python_controller import Act, Send

from .hijack import Hijack
from .liar import Liar


class OmitSends(Liar):
    """Broadcasts its state no more, so that nobody keeps clear of it."""

    def put_out(self, now_ms: int, output: Send | Act) -> list[Action]:
        return [] if self.lies(now_ms) and isinstance(output, Send) else super().put_out(now_ms, output)


class Unasked(Liar):
    """Asks nobody for an audit, nor shows its log; a request that is under way is broken off."""

    def round_due(self, now_ms: int) -> list[Action]:
        return []

    def next_packet(self, now_ms: int) -> list[Action]:
        return [] if self.lies(now_ms) else super().next_packet(now_ms)


class RefuseAudit(Unasked, Hijack):
    """Misbehaves, and asks nobody for an audit, nor shows its log."""


class RefuseToAudit(Liar):
    """Says that it audits, and never does: whoever asks it has lost a request."""

    def asked(self, now_ms: int, frame: bytes) -> list[Action]:
        self.gained += 1
        return []


class Crash(Unasked):
    """Its c-node is dead: the actuators go on with the last command they had."""

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        return []

    def heard(self, now_ms: int, frame: bytes) -> list[Action]:
        return []
