"""For each of the auditor's refusals, a log that only it stops: chained by true nodes, of a robot that lies about little.

Whatever is not said to be wrong in a test is right: the same robot, honest at that point, gets its token.
"""

from __future__ import annotations

import hashlib
import struct

import pytest
from asking import BOOT_MS, VICTIM
from auditee import ASKED_MS, DELTA_MS, SKEW_MS, Auditee
from edited_requests import CHECKED, entry, parts, segment_at, tokens, with_segment, with_tokens

from phalanx.bti import audit, log, request, rounds
from phalanx.bti.audit import ACMD, INPUT, RECV, SEND
from phalanx.bti.fleet import PENDING
from phalanx.bti.refusal import Refusal
from phalanx.robot.adversary.liar import MOTION
from phalanx.wire.fields import row
from phalanx.wire.table import CHECKPOINT, KIND_SENSOR, KIND_STATE


@pytest.fixture
def auditee():
    return Auditee()


class TestStart:
    def test_one_auditor_counts_once(self, auditee):
        auditee.covered()
        auditor, q = auditee.asks()
        assert auditee.verdict((auditor, q)) == 0
        one, two, three, _ = tokens(q)
        assert auditee.verdict((auditor, with_tokens(q, [one, two, three, one]))) == Refusal.TOKEN_TWICE
        assert auditee.verdict((auditor, with_tokens(q, [one, one, two, three]))) == Refusal.TOKEN_TWICE
        assert auditee.verdict((auditor, with_tokens(q, [one, two, three, two]))) == Refusal.TOKEN_TWICE

    def test_f_max_tokens_are_not_enough(self, auditee):
        auditee.covered()
        auditor, q = auditee.asks()
        assert auditee.verdict((auditor, with_tokens(q, tokens(q)[:-1]))) == Refusal.TOO_FEW_TOKENS
        assert auditee.verdict((auditor, with_tokens(q, tokens(q)[::-1]))) == 0, "in any order"

    @pytest.mark.parametrize("nth", range(4))
    def test_each_token_is_looked_at(self, auditee, nth):
        auditee.covered()
        auditor, q = auditee.asks()
        shown = tokens(q)
        shown[nth] = shown[nth][:-1] + bytes([shown[nth][-1] ^ 1])
        assert auditee.verdict((auditor, with_tokens(q, shown))) == Refusal.TOKEN_INVALID

    def test_the_key_did_not_come_after_the_request_nor_after_the_first_entry(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        t_ms = int.from_bytes(q[request.AT_T :][:4], "little")
        at = segment_at(q) - 4
        for t_key in (t_ms + 1, auditee.due_ms(0) + SKEW_MS + 1):
            assert auditee.verdict((auditor, q[:at] + struct.pack("<I", t_key) + q[at + 4 :])) == Refusal.OUT_OF_ORDER

    @pytest.mark.parametrize("after_ms", [0, 1])
    def test_nor_after_the_request_of_a_robot_that_has_sensed_nothing(self, auditee, after_ms):
        """Within that it is a robot that stood idle; beyond, no reading would ever be due."""
        now_ms = BOOT_MS + 3000
        auditee.robot.t_key = now_ms + after_ms
        rounds.forget_checkpoint(auditee.fleet, VICTIM)
        assert auditee.verdict(auditee.asks(now_ms)) == (Refusal.OUT_OF_ORDER if after_ms else 0)


class TestHead:
    def test_it_is_as_long_as_it_says(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        assert auditee.verdict((auditor, q + b"\0")) == auditee.verdict((auditor, q[:-1])) == Refusal.MALFORMED

    def test_nobody_else_sends_it(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        assert auditee.judge(VICTIM + 3, auditor - 1, q)[0] == Refusal.NOT_THE_SENDER

    def test_its_s_node_signed_it(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        at = request.AT_AUTH_S
        forged = q[:at] + bytes([q[at] ^ 1]) + q[at + 1 :]
        assert auditee.verdict((auditor, forged)) == Refusal.AUTHENTICATOR_INVALID

    def test_the_checkpoint_is_the_one_that_it_claims(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        other = hashlib.sha1(q).digest()
        assert (
            auditee.verdict((auditor, q[: request.AT_HCKPT] + other + q[request.AT_HCKPT + 20 :]))
            == Refusal.CHECKPOINT_WRONG
        )


class TestEntries:
    @pytest.mark.parametrize("over_ms, refusal", [(SKEW_MS, Refusal.NONE), (SKEW_MS + 1, Refusal.OUT_OF_ORDER)])
    def test_entries_of_two_chains_are_in_the_order_of_time(self, auditee, over_ms, refusal):
        auditee.goes_on()
        sensed_ms = auditee.due_ms()
        sensed = auditee.polled(sensed_ms)
        auditee.logs(auditee.hears_of(sensed_ms + over_ms))
        auditee.logs(sensed)
        for kind, payload in auditee.thinks(sensed):
            auditee.logs(auditee.chained(kind, sensed_ms + over_ms, payload))
        assert auditee.verdict(auditee.asks()) == refusal

    @pytest.mark.parametrize("off_ms", [DELTA_MS, -DELTA_MS, DELTA_MS + 1, -DELTA_MS - 1])
    def test_an_input_comes_when_it_is_due(self, auditee, off_ms):
        auditee.goes_on()
        auditee.senses(auditee.due_ms() + off_ms)
        auditee.senses()
        assert auditee.verdict(auditee.asks()) == (Refusal.INPUT_OFF_GRID if abs(off_ms) > DELTA_MS else 0)

    def test_none_is_missing_at_the_end(self, auditee):
        auditee.goes_on()
        assert auditee.verdict(auditee.asks(auditee.due_ms() + DELTA_MS)) == 0
        auditee.robot.quota = 1
        assert auditee.verdict(auditee.asks(auditee.due_ms() + 1000)) == Refusal.INPUT_MISSING

    @pytest.mark.parametrize("past_ms", [0, 1])
    def test_none_is_later_than_the_request(self, auditee, past_ms):
        auditee.goes_on()
        auditee.asks()
        for _ in range(4):
            auditee.senses()
        sensed_ms = auditee.due_ms()
        made = auditee.between(sensed_ms - past_ms)
        sensed = auditee.polled(sensed_ms)
        auditee.logs(sensed)
        auditee.thinks(sensed)
        assert auditee.verdict(auditee.signed(*made)) == (Refusal.OUT_OF_ORDER if past_ms else 0)

    def test_audit_frames_are_not_among_them(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        segment = q[segment_at(q) :]
        forged = entry(RECV, auditee.due_ms(0), b"\x80 an AUDIT packet")
        assert auditee.verdict((auditor, with_segment(q, forged + segment))) == Refusal.AUDIT_FRAME_LOGGED

    @pytest.mark.parametrize("kind, refusal", [(RECV, Refusal.A_CHAIN), (INPUT, Refusal.S_CHAIN)])
    def test_what_is_shown_behind_the_last_flush_is_chained_too(self, auditee, kind, refusal):
        """Else it could be anything: here it is a message that never came, or a reading that nobody took."""
        auditee.goes_on()
        now_ms = auditee.due_ms() + 1
        auditor, q = auditee.asks(now_ms)
        assert auditee.verdict((auditor, q)) == 0
        motion = MOTION.pack(KIND_SENSOR if kind == INPUT else KIND_STATE, 1 if kind == INPUT else 3, 0, 1, 2, 3, 4)
        behind = entry(kind, now_ms, motion)
        assert auditee.verdict((auditor, with_segment(q, q[segment_at(q) :] + behind))) == refusal


class TestCheckpoint:
    def test_there_is_one(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        shown = parts(q[segment_at(q) :])
        without = b"".join(part for part in shown if part != CHECKED)
        twice = b"".join(part * 2 if part == CHECKED else part for part in shown)
        for segment in (without, twice):
            assert auditee.verdict((auditor, with_segment(q, segment))) == Refusal.CHECKPOINT_MISSING

    @pytest.mark.parametrize("kept", [(INPUT,), (ACMD, SEND)], ids=["s", "a"])
    def test_both_chains_were_flushed_before_it(self, auditee, kept):
        """Else entries of before it would be in nobody's segment. The claim is of the checkpoint as it stands there."""
        auditee.goes_on()
        auditor, q = auditee.asks()
        shown = [part for part in parts(q[segment_at(q) :]) if part != CHECKED]
        flush_a, flush_s = bytes([log.FLUSH_A]), bytes([log.FLUSH_S])
        assert shown[-2:] == [flush_a, flush_s]
        flushed, other = (flush_a, flush_s) if kept == (INPUT,) else (flush_s, flush_a)
        moved = with_segment(q, b"".join(shown[:-2]) + flushed + CHECKED + other)
        checkpoint = bytearray(auditee.fleet.checkpoint[VICTIM, PENDING, : int(auditee.robot.pending_len)].tobytes())
        at = CHECKPOINT.at("top_s" if kept == (INPUT,) else "top_a")
        checkpoint[at : at + 20] = bytes(20)  # of fewer entries than fill a batch nothing was hashed before
        claimed = hashlib.sha1(checkpoint).digest()
        moved = moved[: request.AT_HCKPT] + claimed + moved[request.AT_HCKPT + 20 :]
        assert auditee.verdict((auditor, moved)) == Refusal.CHECKPOINT_NOT_FLUSHED

    def test_no_output_is_owed_at_it(self, auditee):
        auditee.goes_on()
        sensed_ms = auditee.due_ms()
        sensed = auditee.polled(sensed_ms)
        auditee.logs(sensed)
        outputs = auditee.thinks(sensed)
        auditee.asks(sensed_ms + 1)
        for kind, payload in outputs:
            auditee.logs(auditee.chained(kind, sensed_ms + 2, payload))
        auditee.robot.quota = 1
        for _ in range(4):
            auditee.senses()
        assert auditee.verdict(auditee.asks()) == Refusal.OUTPUT_PENDING


class TestOutputs:
    @pytest.mark.parametrize("late_ms", [DELTA_MS, DELTA_MS + 1])
    def test_none_is_late(self, auditee, late_ms):
        auditee.goes_on()
        auditee.senses(late_ms=late_ms)
        auditee.senses()
        assert auditee.verdict(auditee.asks()) == (Refusal.OUTPUT_LATE if late_ms > DELTA_MS else 0)

    @pytest.mark.parametrize("after_ms", [DELTA_MS, DELTA_MS + 1])
    def test_none_is_missing_at_the_end(self, auditee, after_ms):
        auditee.goes_on()
        auditee.asks()
        auditee.robot.quota = 1
        for _ in range(3):
            auditee.senses()
        sensed_ms = auditee.due_ms()
        sensed = auditee.polled(sensed_ms)
        auditee.logs(sensed)
        auditee.thinks(sensed)
        assert auditee.verdict(auditee.asks(sensed_ms + after_ms)) == (
            Refusal.OUTPUT_MISSING if after_ms > DELTA_MS else 0
        )

    def test_a_command_that_was_said_to_the_radio_is_no_command(self, auditee):
        auditee.goes_on()
        sensed = auditee.polled(auditee.due_ms())
        auditee.logs(sensed)
        for _, payload in auditee.thinks(sensed):
            auditee.logs(auditee.chained(SEND, auditee.due_ms(auditee.step - 1), payload))
        assert auditee.verdict(auditee.asks()) == Refusal.OUTPUT_WRONG

    @pytest.mark.parametrize("change", [b"\x01", b"\x00\x00"], ids=["another byte", "longer"])
    def test_every_byte_of_it_counts(self, auditee, change):
        auditee.goes_on()
        sensed = auditee.polled(auditee.due_ms())
        auditee.logs(sensed)
        for kind, payload in auditee.thinks(sensed):
            wrong = payload[:-1] + bytes([payload[-1] ^ 1]) if len(change) == 1 else payload + change
            auditee.logs(auditee.chained(kind, auditee.due_ms(auditee.step - 1), wrong))
        assert auditee.verdict(auditee.asks()) == Refusal.OUTPUT_WRONG

    def test_nobody_asked_for_one_more(self, auditee):
        auditee.goes_on()
        auditee.logs(auditee.chained(ACMD, auditee.due_ms(auditee.step - 1) + 1, b"\x03 once more"))
        assert auditee.verdict(auditee.asks()) == Refusal.OUTPUT_UNCALLED


class TestSeenBefore:
    """What an auditor of the same process has seen already: it is known, and makes no other verdict of the rest."""

    def again(self, auditee, now_ms: int) -> tuple[int, bytes]:
        auditee.robot.quota = 1
        return auditee.asks(now_ms)

    def known(self, auditee) -> int:
        return int(auditee.judge.work.case[0].known)

    @pytest.mark.parametrize("start", ["boot", "checkpoint"])
    def test_who_shows_more_than_before_gets_its_token_again(self, auditee, start):
        auditee.goes_on() if start == "boot" else auditee.covered()
        auditor, q = auditee.asks()
        assert auditee.verdict((auditor, q)) == 0
        assert self.known(auditee) == 0
        for _ in range(4):
            auditee.senses()
            auditee.logs(auditee.hears_of(auditee.due_ms(auditee.step - 1) + 1))
        assert auditee.verdict(self.again(auditee, auditee.due_ms(auditee.step - 1) + ASKED_MS)) == 0
        assert self.known(auditee) == len(q)

    def test_of_a_controller_in_plain_python_what_was_replayed_is_known_as_well(self, auditee):
        auditee.covered()
        auditor, q = auditee.asks()
        assert auditee.verdict((auditor, q)) == 0
        auditee.fleet.settings[0].controller = 0
        for shown, refusal in ((q, Refusal.NONE), (with_tokens(q, tokens(q)[:-1]), Refusal.TOO_FEW_TOKENS)):
            f, w = auditee.fleet, auditee.judge.work
            assert audit.examine(f, auditor - 1, w, row(shown), len(shown), VICTIM + 1) == refusal
            assert (self.known(auditee) > 0) == (refusal == Refusal.NONE)

    def test_who_was_refused_at_a_mark_is_refused_again(self, auditee):
        """An output is owed: at the checkpoint, and then at the end."""
        auditee.goes_on()
        sensed_ms = auditee.due_ms()
        sensed = auditee.polled(sensed_ms)
        auditee.logs(sensed)
        outputs = auditee.thinks(sensed)
        owing = auditee.asks(sensed_ms + 1)
        assert auditee.verdict(owing) == auditee.verdict(owing) == Refusal.OUTPUT_PENDING
        other = Auditee()
        for _ in range(2):
            other.goes_on()
        assert other.verdict(other.asks()) == 0
        sensed_ms = other.due_ms()
        other.logs(other.polled(sensed_ms))
        owing = self.again(other, sensed_ms + DELTA_MS + 1)
        assert outputs
        assert other.verdict(owing) == other.verdict(owing) == Refusal.OUTPUT_MISSING

    @pytest.mark.parametrize("over_ms", [SKEW_MS, SKEW_MS + 1])
    def test_what_comes_next_is_no_older_than_what_was_seen(self, auditee, over_ms):
        for _ in range(2):
            auditee.goes_on()
        sensed_ms = auditee.due_ms()
        auditee.logs(auditee.hears_of(sensed_ms + over_ms))
        assert auditee.verdict(auditee.asks(sensed_ms + over_ms)) == 0
        auditee.senses(sensed_ms, late_ms=over_ms)
        asked = self.again(auditee, sensed_ms + 2 * SKEW_MS)
        assert auditee.verdict(asked) == (Refusal.OUT_OF_ORDER if over_ms > SKEW_MS else 0)
        assert self.known(auditee) > 0


def test_the_honest_robot_of_this_file_gets_its_tokens(auditee):
    auditee.goes_on()
    assert auditee.verdict(auditee.asks()) == 0
    again = Auditee()
    again.covered()
    assert again.verdict(again.asks()) == 0
