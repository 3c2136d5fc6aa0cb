"""Room that an audit has: for evidence behind a reading, and for outputs that the log still has to show."""

from __future__ import annotations

import pytest
from asking import VICTIM
from auditee import Auditee
from edited_requests import entry, parts, segment_at, shown_of, with_segment

from phalanx.bti import audit, log
from phalanx.bti.audit import ACMD, ENTRY_HEAD_BYTES, INPUT, SEND
from phalanx.bti.refusal import Refusal
from phalanx.config import BtiConfig
from phalanx.config.guard import GuardConfig
from phalanx.robot import handlers
from phalanx.robot.adversary.liar import MOTION
from phalanx.robot.controllers.guard_law import guard_params
from phalanx.wire import guarded
from phalanx.wire.fields import row
from phalanx.wire.table import KIND_SENSOR

EVIDENCE_MAX = 64
SHOWS = BtiConfig(evidence_max_bytes=EVIDENCE_MAX, evidence_bytes_per_s=4000)


@pytest.fixture
def auditee():
    return Auditee()


class TestRoom:
    def test_outputs_of_all_the_room_there_is_are_compared_and_one_more_is_not_taken(self, auditee):
        """No controller of ours puts out so much; another's might."""
        f, w, most = auditee.fleet, auditee.judge.work, auditee.config.packet_max_bytes
        auditee.goes_on()
        _, q = auditee.asks()
        assert audit.open_request(w, row(q), len(q), VICTIM + 1) == 0
        step, due, w.case[0].entry_t = int(w.case[0].step), int(w.case[0].due), 7
        outputs = [bytes([SEND]) + most.to_bytes(2, "little") + bytes([k]) * most for k in range(2)]
        w.out[: 2 * (3 + most)] = row(b"".join(outputs))
        assert audit.expect(f, w, 2 * (3 + most)) == audit.expect(f, w, 2 * (3 + most)) == 0
        w.out[:4] = row(bytes([SEND, 1, 0, 7]))
        assert audit.expect(f, w, 4) == Refusal.OUTPUT_MISSING
        assert (w.case[0].step, w.case[0].due) == (step + 3, due + 3 * auditee.config.t_control_ms)
        logged = row(b"".join(entry(SEND, 8, bytes([k]) * most) for k in (0, 1, 0, 1)))
        w.case[0].at, w.case[0].end, w.case[0].t = 0, len(logged), 9
        assert audit.next_event(f, w, logged) == audit.END
        assert w.case[0].waiting == 0


class TestEvidence:
    """What stands behind a reading, in no chain: of a length, in its place, once."""

    def shown(self, *behind: bytes, kind: int = INPUT, cut: int = 0) -> int:
        auditee = Auditee(config=SHOWS)
        auditee.goes_on()

        def edit(parts_shown: list[bytes]) -> list[bytes]:
            at = next(k for k, part in enumerate(parts_shown) if part[0] == kind)
            return [*parts_shown[: at + 1], *behind, *parts_shown[at + 1 :]]

        if not cut:
            return shown_of(auditee, edit)
        auditor, q = auditee.asks(auditee.due_ms() + 1)
        sensed = entry(INPUT, auditee.due_ms(), MOTION.pack(KIND_SENSOR, 1, 0, 1, 2, 3, 4))
        return auditee.verdict((auditor, with_segment(q, q[segment_at(q) :] + sensed + b"".join(behind)[:-cut])))

    @staticmethod
    def evidence(length: int) -> bytes:
        return bytes([log.EVIDENCE]) + length.to_bytes(2, "little") + bytes(length)

    @pytest.mark.parametrize("length", [1, EVIDENCE_MAX])
    def test_behind_a_reading_it_is_read(self, length):
        assert self.shown(self.evidence(length)) == 0

    @pytest.mark.parametrize("length", [0, EVIDENCE_MAX + 1])
    def test_not_empty_nor_longer_than_there_is_room_for(self, length):
        assert self.shown(self.evidence(length)) == Refusal.ENTRY_MALFORMED

    @pytest.mark.parametrize("length", [1, 5])
    def test_not_twice_nor_behind_anything_but_a_reading(self, length):
        shown = self.evidence(length)
        assert self.shown(shown, shown) == Refusal.ENTRY_MALFORMED
        assert self.shown(bytes([log.FLUSH_A]), shown) == Refusal.ENTRY_MALFORMED
        assert self.shown(shown, kind=ACMD) == Refusal.ENTRY_MALFORMED

    @pytest.mark.parametrize("cut", range(1, 8))
    def test_not_cut_off(self, cut):
        assert self.shown(self.evidence(5), cut=cut) == Refusal.ENTRY_MALFORMED

    def test_it_is_whole_at_the_very_end(self):
        """The reading before it was never chained, which is found next."""
        assert self.shown(self.evidence(5) + b"?", cut=1) == Refusal.S_CHAIN

    def test_what_lies_behind_the_request_is_none(self):
        """A reading at its very end, and in the auditor's memory what an earlier request has left there."""
        auditee = Auditee(config=SHOWS)
        f, w = auditee.fleet, auditee.judge.work
        sensed = entry(INPUT, 5, MOTION.pack(KIND_SENSOR, 1, 0, 1, 2, 3, 4))
        left = row(sensed + self.evidence(3))
        w.case[0].at, w.case[0].end, w.case[0].waiting = 0, len(sensed), 0
        assert audit.next_event(f, w, left) == INPUT
        assert (w.case[0].evidence_len, w.case[0].at) == (0, len(sensed))
        w.case[0].at, w.case[0].end = 0, len(left)
        assert audit.next_event(f, w, left) == INPUT
        assert (w.case[0].evidence_len, w.case[0].at) == (3, len(left))

    def test_the_controller_is_told_what_it_is_and_where_there_is_none(self):
        auditee = Auditee(config=SHOWS)
        auditee.goes_on()
        auditor, q = auditee.asks()
        shown = parts(q[segment_at(q) :])
        first = next(k for k, part in enumerate(shown) if part[0] == INPUT)
        said = bytes([log.EVIDENCE]) + (3).to_bytes(2, "little") + b"abc"
        made = with_segment(q, b"".join([*shown[: first + 1], said, *shown[first + 1 :]]))
        assert auditee.verdict((auditor, made)) == 0  # all of it, so that the work stands at its start again
        f, w, q_row = auditee.fleet, auditee.judge.work, row(made)
        f.memo.passed.auditee[:] = 0  # nor does anybody remember that it has passed
        assert audit.examine(f, auditor - 1, w, q_row, len(made), VICTIM + 1) == 0
        w.evidence[:] = 0
        seen, events = [], set()
        while True:
            event = audit.next_event(f, w, q_row)
            events.add(event)
            if event == INPUT:
                seen.append(w.evidence[: int(w.case[0].evidence_len)].tobytes())
                expected = shown_outputs(made, int(w.case[0].at))
                w.out[: len(expected)] = row(expected)
                assert audit.expect(f, w, len(expected)) == 0
            elif event <= audit.END:
                break
        assert events == {INPUT, log.CHECKPOINT, audit.END}
        assert seen[0] == b"abc"
        assert set(seen[1:]) == {b""}


class TestAdvice:
    """What a planner said, in no chain: it may stand anywhere, and nothing but its length is looked at."""

    @staticmethod
    def advice(said: bytes) -> bytes:
        return guarded.ADVICE.encode(bytes=said)

    def shown(self, behind: bytes) -> int:
        auditee = Auditee()
        auditee.goes_on()
        auditor, q = auditee.asks()
        return auditee.verdict((auditor, with_segment(q, q[segment_at(q) :] + behind)))

    @pytest.mark.parametrize("length, refusal", [(0, Refusal.ENTRY_MALFORMED), (1, 0), (9, 0), (300, 0)])
    def test_it_is_read_if_it_is_not_empty(self, length, refusal):
        assert self.shown(self.advice(bytes(length))) == refusal
        assert self.shown(self.advice(bytes(length)) * 2) == refusal

    @pytest.mark.parametrize("cut", range(1, 8))
    def test_not_cut_off(self, cut):
        assert self.shown(self.advice(b"\x01\x00\x01\x00\x01")[:-cut]) == Refusal.ENTRY_MALFORMED

    def test_replay_is_told_what_was_said_where_it_was_said(self):
        """And goes on behind it; it makes no mark of a log's end."""
        auditee = Auditee()
        f, w = auditee.fleet, auditee.judge.work
        sensed = entry(INPUT, 5, MOTION.pack(KIND_SENSOR, 1, 0, 1, 2, 3, 4))
        q = row(b"?" + self.advice(b"abc") + bytes([log.FLUSH_S]) + self.advice(b"de") + sensed)
        case = w.case[0]
        case.at, case.end, case.waiting, case.marked = 1, len(q), 0, 1
        for said in (b"abc", b"de"):
            assert audit.next_event(f, w, q) == log.ADVICE
            assert q[case.payload_at : case.payload_at + case.payload_len].tobytes() == said
            assert case.marked == 0
        assert audit.next_event(f, w, q) == INPUT
        assert (case.payload_len, case.at, case.marked) == (len(sensed) - ENTRY_HEAD_BYTES, len(q), 0)

    def test_a_guard_acts_on_what_it_was_told_and_not_on_what_it_was_not(self):
        """The state at the checkpoint holds the wish: who shows another has another state."""
        robots = Guards()
        assert robots.told(robots.said) == 0
        assert robots.told(robots.said[:-1] + bytes([robots.said[-1] ^ 0x40])) == Refusal.CHECKPOINT_WRONG
        assert robots.told(b"") == Refusal.CHECKPOINT_WRONG


class Guards(Auditee):
    """A robot whose planner says one thing before it asks for its first audit."""

    def __init__(self):
        super().__init__(controller="guard", params=guard_params(GuardConfig()))
        self.goes_on()
        self.said = guarded.WISH.encode(vx_mps=0.25, vy_mps=0.0)
        handlers.on_advice(self.fleet, VICTIM, row(self.said), len(self.said))
        self.auditor, self.q = self.asks()

    def told(self, said: bytes) -> int:
        """The verdict on a log in which that stands right before the checkpoint."""
        shown = guarded.ADVICE.encode(bytes=said) if said else b""
        return self.verdict((self.auditor, with_segment(self.q, self.q[segment_at(self.q) : -1] + shown + self.q[-1:])))


def shown_outputs(q: bytes, at: int) -> bytes:
    """The outputs logged from here to the next reading, as a controller would put them out."""
    made = b""
    for part in parts(q[at:]):
        if part[0] == INPUT:
            break
        if part[0] in (SEND, ACMD):
            made += part[:1] + part[5:7] + part[7:]
    return made
