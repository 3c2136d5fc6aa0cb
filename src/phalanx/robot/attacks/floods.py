"""Too much: of requests, of frames, of neighbours; and talk where nobody listens."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from phalanx.bti import request
from phalanx.bti.fleet import BOUND, PLAIN
from phalanx.robot.cnode import EVERYBODY, Action, Transmit
from phalanx.wire.table import KIND_STATE

from .attack import MOTION, NOT_COVERED, Attack, Defence, Verdict
from .harm import AIRTIME, STARVED
from .silence import RefuseToAudit

LIMITED: Mapping[Defence, Verdict] = {"none": "bites", "paper": "bites", "bound": "limited"}
GHOSTS = 400


class Flood(Attack, ABC):
    """Leaves room for its own audits, which it means to pass."""

    QUIET_MS: ClassVar[tuple[int, int]] = (20, 200)  # before a round of its own, and from its beginning on
    # Whether `bound` has a limit for it, which its own audits share: then it pours when it has its tokens, until so
    # much of the round is over. In the rest the bucket fills again.
    SHARES: ClassVar[bool] = True
    POURED: ClassVar[float] = 0.8

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._round_ms = 0

    def on_round(self, now_ms: int) -> list[Action]:
        """The moment is remembered."""
        self._round_ms = now_ms
        return super().on_round(now_ms)

    def on_wake(self, now_ms: int) -> list[Action]:
        """More, unless its own audits are due."""
        s, (before_ms, after_ms) = self.f.settings[0], self.QUIET_MS
        t_audit, profile = int(s.t_audit), int(s.profile)
        shares = self.SHARES and profile == BOUND
        if shares:
            before_ms = round((1 - self.POURED) * t_audit)
        quiet = (now_ms - self._round_ms + before_ms) % t_audit < before_ms + after_ms
        waits = shares and self.f.robot[self.i].got <= s.f_max
        return [] if profile != PLAIN and (quiet or waits) else self.pour(now_ms)

    @abstractmethod
    def pour(self, now_ms: int) -> list[Action]:
        """More of it."""


class RequestFlood(Flood):
    """Uses up what auditors will do for others: malformed requests, in their names where an a-node lets it."""

    name = "request-flood"
    does = "sends auditors empty requests for audits in everybody's name, so that true ones are turned away"
    stopped_by = "nothing; in `bound` the a-node writes the source, and auditors take one a robot and T_audit / 2"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "harmless", "paper": "bites", "bound": "limited"}
    harm = STARVED
    period_ms = 4

    POURED = 0.5  # after that it would keep its own true requests from being taken

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._turn = 0
        self._asked_ms: dict[int, int] = {}

    def pour(self, now_ms: int) -> list[Action]:
        """The next auditor hears of the next victim; under its own name only, no more than are looked at."""
        others = [rob_id for rob_id in self.plan.ids if rob_id != self.id]
        if len(others) < 2:
            return []
        s, auditor = self.f.settings[0], others[self._turn % len(others)]
        again_ms = self._asked_ms.get(auditor, 0) + int(s.t_audit) // 2
        if s.profile == BOUND and now_ms < again_ms:
            return []
        self._asked_ms[auditor] = now_ms
        self._turn += 1
        victim = others[(self._turn + 1 + self._turn // len(others)) % len(others)]
        frame = audit_frame(victim, auditor, request.FRAGMENT, b"\x00\x00\x00\x01" + bytes(8))
        return self.send(now_ms, frame, auditor)


class FrameFlood(Flood):
    """As many and as long AUDIT frames as its a-node lets out, for nobody."""

    name = "frame-flood"
    does = "fills the channel with long AUDIT frames, which no log shows"
    stopped_by = "nothing ends it; in `bound` AUDIT frames draw airtime from a leaky bucket of the a-node's"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = LIMITED
    harm = AIRTIME
    bites_from = 40.0
    period_ms = 2

    TRIED_MS: ClassVar[int] = 30  # so long the radio tries; what comes meanwhile it throws away, and the bucket counts

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self._sent_ms = 0

    def pour(self, now_ms: int) -> list[Action]:
        """One more: to all, or where airtime is counted, to nobody, so that the radio tries again and again."""
        s = self.f.settings[0]
        bound = s.profile == BOUND
        if bound and now_ms < self._sent_ms + self.TRIED_MS:
            return []
        self._sent_ms = now_ms
        nobody = max(self.plan.ids) + 1 if bound else 0
        frame = audit_frame(self.id, nobody, 0x7F, bytes(int(s.frame_max) - request.AUDIT_HEAD_BYTES))
        return self.send(now_ms, frame, nobody or EVERYBODY)


class CovertTalk(Flood):
    """Talks to an accomplice in AUDIT frames, which no log shows."""

    name = "covert-talk"
    does = "sends an accomplice, or the nearest ear, whatever it likes in AUDIT frames, which no log shows"
    stopped_by = "nothing ends it; in `bound` the a-node's bucket limits how much"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = LIMITED
    harm = AIRTIME
    bites_from = 4.0
    period_ms = 2

    def pour(self, now_ms: int) -> list[Action]:
        """One more kilobyte."""
        others = self.plan.accomplices or tuple(sorted(self.seen))
        if not others:
            return []
        return self.send(now_ms, audit_frame(self.id, others[0], 0x7E, self.plan.chance.bytes(1000)), others[0])


class LogFlood(Attack):
    """Says at length what means nothing: who hears it has to log it, and to show it to auditors."""

    name = "log-flood"
    does = "broadcasts long frames of no meaning, which all others must log and show until their logs are full"
    stopped_by = "replay sends no such frame; and in `bound` the a-node's bucket for broadcasts lets few bytes out"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "harmless", "paper": "bites", "bound": "stopped"}
    harm = STARVED
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

    name = "long-frames"
    does = "audits nobody, and broadcasts the longest frames that cost the airtime of four states, to fill others' logs"
    stopped_by = "replay sends no such frame; and in `bound` logs have room for f_max robots that do so until then"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "harmless", "paper": "bites", "bound": "stopped"}
    period_ms = 10

    BYTES: ClassVar[int] = 368  # a byte more, and a full bucket is too small

    def on_wake(self, now_ms: int) -> list[Action]:
        """One more, when the bucket is full enough for it."""
        return self.send(now_ms, b"\x60" + bytes(self.BYTES - 1), EVERYBODY)


class SlotSquat(Attack):
    """Begins requests at every auditor and never ends them: an auditor puts only so many together at a time.

    A hole of ours, closed in bti/request.py.
    """

    name = "slot-squat"
    does = "begins requests for audits with everybody and never ends them, so that no others fit in"
    stopped_by = "a request that is not whole in time loses its place, and its sender none before T_audit / 2"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "harmless", "paper": "harmless", "bound": "harmless"}
    harm = STARVED
    period_ms = 300
    crowd = True

    def on_wake(self, now_ms: int) -> list[Action]:
        """The same last fragment to each, once more."""
        others = [rob_id for rob_id in self.plan.ids if rob_id not in (self.id, *self.plan.accomplices)]
        last_of_two = bytes([0, 0, 1, 2, 0])
        actions = [
            action
            for auditor in others
            for action in self.send(now_ms, audit_frame(self.id, auditor, request.FRAGMENT, last_of_two), auditor)
        ]
        self.gained += len(actions)
        return actions


class GhostAuditors(Attack):
    """Fills its neighbours' tables with robots that are not there: whoever asks one of them for an audit asks in vain.

    Source: docs/spec/rebound.md (ghost auditors).
    """

    name = "ghost-auditors"
    does = f"broadcasts states of {GHOSTS} invented robots, of which others then ask audits in vain"
    stopped_by = (
        "in `bound` auditors are chosen among those whose tokens or AUDIT frames came, never among claimed ones"
    )
    verdicts: ClassVar[Mapping[Defence, Verdict]] = {"none": "harmless", "paper": "bites", "bound": "stopped"}
    harm = STARVED
    period_ms = 5

    def on_wake(self, now_ms: int) -> list[Action]:
        """One more ghost, far enough away to be in nobody's way."""
        name = 60_000 + int(self.plan.chance.integers(GHOSTS))
        return self.send(now_ms, MOTION.pack(KIND_STATE, name, now_ms, 900.0, -900.0, 0.0, 0.0), EVERYBODY)


class Jam(Flood):
    """Somebody's transmitter, beside the robots' radios: it asks no a-node."""

    name = "jam"
    does = "a transmitter of its own, past the a-node, fills the channel"
    stopped_by = "nothing in software: radio is physics. Robots that get no tokens stop, which is safe"
    verdicts: ClassVar[Mapping[Defence, Verdict]] = NOT_COVERED
    harm = AIRTIME
    bites_from = 40.0
    period_ms = 2

    SHARES = False

    def pour(self, now_ms: int) -> list[Action]:
        """Noise."""
        del now_ms
        noise = bytes(int(self.f.settings[0].frame_max) - request.AUDIT_HEAD_BYTES)
        return [Transmit(audit_frame(0, 0, 0x7F, noise), EVERYBODY)]


def audit_frame(src: int, dst: int, sub: int, rest: bytes) -> bytes:
    """`AUDIT ‖ src ‖ dst ‖ sub ‖ rest`. Source: docs/spec/rebound.md."""
    head = np.zeros(request.AUDIT_HEAD_BYTES, np.uint8)
    request.audit_head(head, src, dst, sub)
    return head.tobytes() + rest
