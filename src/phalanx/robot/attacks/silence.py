"""What a robot leaves out: to speak, to be audited, to audit, to live."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from phalanx.robot.cnode import Action
from phalanx.robot.controllers.python_controller import Act, Send

from .attack import STOPPED, Attack, Defence, Verdict
from .harm import STARVED, UNEARNED
from .hijack import Hijack


class OmitSends(Attack):
    """Broadcasts its state no more, so that nobody keeps clear of it."""

    name = "omit-sends"
    does = "stops broadcasting where it is: others forget it, and do not keep clear"
    on_wheels = True
    stopped_by = "replay sends states that the log lacks"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = STOPPED
    bites_from = 0.5  # the same flock with other dice: 0.2 to 0.3 m

    def put_out(self, now_ms: int, output: Send | Act) -> list[Action]:
        """Commands only."""
        return [] if self.lies(now_ms) and isinstance(output, Send) else super().put_out(now_ms, output)


class RefuseAudit(Hijack):
    """Misbehaves, and asks nobody for an audit, nor shows its log."""

    name = "refuse-audit"
    does = "drives as it likes, and shows its log to nobody"
    stopped_by = "tokens run out by themselves: not to be audited is to be stopped"

    def round_due(self, now_ms: int) -> list[Action]:
        """No round."""
        del now_ms
        return []

    def next_frame(self, now_ms: int) -> list[Action]:
        """No request; one that is under way is broken off."""
        return [] if self.lies(now_ms) else super().next_frame(now_ms)


class RefuseToAudit(Attack):
    """Says that it audits, and never does: whoever asks it has lost a request."""

    name = "refuse-to-audit"
    does = "takes requests for audits, and answers none"
    stopped_by = "nothing has to: others are asked instead, of which P2 wants f_max + 1 correct ones in range"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "harmless", "paper": "harmless", "bound": "harmless"}
    harm = STARVED
    crowd = True

    def heard(self, now_ms: int, frame: bytes) -> list[Action]:
        """Everything but requests."""
        if self.is_request(frame):
            self.gained += 1
            return []
        return super().heard(now_ms, frame)


class Crash(Attack):
    """Its c-node is dead: the actuators go on with the last command they had."""

    name = "crash"
    does = "does nothing any more; its actuators keep doing the last thing they were told"
    on_wheels = True
    stopped_by = "replay commands and sends what the log lacks; and nobody asks for its audits"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = STOPPED
    harm = UNEARNED
    bites_from = 5.0

    def sensed(self, now_ms: int, reading: bytes) -> list[Action]:
        """Nothing."""
        del now_ms, reading
        return []

    def heard(self, now_ms: int, frame: bytes) -> list[Action]:
        """Nothing."""
        del now_ms, frame
        return []

    def round_due(self, now_ms: int) -> list[Action]:
        """Nothing."""
        del now_ms
        return []

    def next_frame(self, now_ms: int) -> list[Action]:
        """Nothing."""
        return [] if self.lies(now_ms) else super().next_frame(now_ms)
