"""What is no request at all, or says more than it may: each is refused for just that, and at its bound is not."""

from __future__ import annotations

import hashlib
import struct

import pytest
from asking import VICTIM
from auditee import DELTA_MS, SKEW_MS, Auditee
from edited_requests import (
    CHECKED,
    entry,
    segment_at,
    shown_of,
    start_of,
    tokens,
    with_byte,
    with_segment,
    with_start,
    with_tokens,
)

from phalanx.bti import audit, log, request, rounds, trusted
from phalanx.bti.audit import ACMD, ENTRY_HEAD_BYTES, INPUT, RECV, SEND
from phalanx.bti.fleet import PAPER, START
from phalanx.bti.refusal import Refusal
from phalanx.robot.adversary.liar import MOTION
from phalanx.wire.fields import row
from phalanx.wire.table import KIND_STATE


@pytest.fixture
def auditee():
    return Auditee()


@pytest.fixture
def as_printed():
    return Auditee(profile=PAPER)


class TestHead:
    @pytest.mark.parametrize("at, value", [(0, 0), (0, 255), (request.AT_FLAGS, 2), (request.AT_FLAGS, 255)])
    def test_versions_and_flags_are_those_that_there_are(self, auditee, at, value):
        auditee.goes_on()
        auditor, q = auditee.asks()
        assert auditee.verdict((auditor, with_byte(q, at, value))) == Refusal.MALFORMED

    def test_whoever_has_not_knocked_is_examined_from_the_first_byte_on(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        f, w = auditee.fleet, auditee.judge.work
        assert audit.examine(f, auditor - 1, w, row(q), len(q), VICTIM + 1) == 0
        for wrong in (with_byte(q, 0, 0), with_byte(q, request.AT_AUTH_S, q[request.AT_AUTH_S] ^ 1)):
            assert audit.examine(f, auditor - 1, w, row(wrong), len(q), VICTIM + 2) in (
                Refusal.MALFORMED,
                Refusal.NOT_THE_SENDER,
            )

    def test_there_is_no_robot_0(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        nobody = q[: request.AT_AUDITEE] + b"\0\0" + q[request.AT_AUDITEE + 2 :]
        assert auditee.judge(-1, auditor - 1, nobody)[0] == Refusal.MALFORMED

    def test_a_log_from_boot_begins_with_the_time_of_the_key_and_nothing_else(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        assert auditee.verdict((auditor, with_start(q, start_of(q) + bytes(1)))) == Refusal.MALFORMED
        assert auditee.verdict((auditor, with_start(q, start_of(q)[:-1]))) == Refusal.MALFORMED
        assert auditee.verdict((auditor, with_tokens(q, [bytes(request.TOKEN_BYTES)]))) == Refusal.MALFORMED

    def test_another_log_begins_with_a_checkpoint_that_there_is_room_for(self, auditee):
        auditee.covered()
        auditor, q = auditee.asks()
        room = auditee.judge.work.state.shape[0]
        for length, refusal in (
            (rounds.CHECKPOINT_BYTES - 1, Refusal.MALFORMED),
            (rounds.CHECKPOINT_BYTES, Refusal.TOKEN_INVALID),
            (room, Refusal.TOKEN_INVALID),
            (room + 1, Refusal.MALFORMED),
        ):
            start = (start_of(q) + bytes(room + 1))[:length]
            assert auditee.verdict((auditor, with_start(q, start))) == refusal

    def test_what_the_last_audit_still_waited_for_is_not_waited_for_in_the_next(self, auditee):
        auditee.goes_on()
        auditee.senses(late_ms=DELTA_MS + 1)
        auditee.senses()
        assert auditee.verdict(auditee.asks()) == Refusal.OUTPUT_LATE
        honest = Auditee()
        honest.goes_on()
        honest.judge.work = auditee.judge.work
        assert honest.verdict(honest.asks()) == 0


class TestTokens:
    def token(self, auditee, auditor: int) -> bytes:
        """One of that robot's, for where the auditee's log begins."""
        now_ms = auditee.due_ms(auditee.step - 1) + 60
        treq = row(bytes(request.TREQ_BYTES))
        while trusted.anode_token_request(auditee.profile, auditee.fleet.anode[VICTIM], now_ms, auditor, treq) < 0:
            auditee.senses()
            now_ms = auditee.due_ms(auditee.step - 1) + 60
        log.mark(auditee.fleet, VICTIM, log.FLUSH_A)
        _, t, mac = auditee.token(auditor, bytes(2 + 2) + treq.tobytes(), START)
        return struct.pack("<HI", auditor, t) + mac.tobytes()

    def vouched(self, auditee, count: int) -> tuple[int, bytes, list[bytes]]:
        """A request, and tokens of so many robots for where its log begins."""
        auditee.covered()
        made = [self.token(auditee, auditor) for auditor in range(2, 2 + count)]
        for _ in range(4):
            auditee.senses()
        auditee.robot.quota = 1
        auditor, q = auditee.asks()
        return auditor, q, made

    def test_what_they_vouch_for_must_be_a_state_of_the_controller(self, auditee):
        auditor, q, _ = self.vouched(auditee, 0)
        start = start_of(q) + b"?"
        auditee.fleet.hckpt[VICTIM, START] = row(hashlib.sha1(start).digest())
        vouched = [self.token(auditee, auditor_of_it) for auditor_of_it in range(2, 2 + auditee.config.tokens_needed)]
        assert auditee.verdict((auditor, with_start(with_tokens(q, vouched), start))) == Refusal.STATE_MALFORMED

    def test_replay_goes_on_from_the_state_that_they_vouch_for(self, auditee):
        auditee.hears(auditee.due_ms() - 20)
        auditee.covered()
        assert int(auditee.robot.start_len) > rounds.CHECKPOINT_BYTES + 4
        assert auditee.verdict(auditee.asks()) == 0

    def test_there_are_2_f_max_1_at_most(self, auditee):
        auditor, q, made = self.vouched(auditee, 7)
        assert len(made) == 2 * auditee.config.f_max + 1
        assert auditee.verdict((auditor, with_tokens(q, made))) == 0
        assert auditee.verdict((auditor, with_tokens(q, [*made, made[0]]))) == Refusal.MALFORMED

    def test_whose_they_are_is_looked_at_with_its_whole_number(self, auditee):
        auditee.covered()
        auditor, q = auditee.asks()
        for k, token in enumerate(tokens(q)):
            shown = tokens(q)
            shown[k] = token[:1] + bytes([token[1] ^ 1]) + token[2:]
            assert auditee.verdict((auditor, with_tokens(q, shown))) == Refusal.TOKEN_INVALID
            shown[k] = token[:5] + bytes([token[5] ^ 1]) + token[6:]
            assert auditee.verdict((auditor, with_tokens(q, shown))) == Refusal.TOKEN_INVALID

    @pytest.mark.parametrize("at", [rounds.AT_DUE, rounds.AT_STEP, rounds.AT_S_TOP, rounds.AT_A_TOP, -1])
    def test_they_cover_every_part_of_the_checkpoint(self, auditee, at):
        auditee.covered()
        auditor, q = auditee.asks()
        start = bytearray(start_of(q))
        start[at] ^= 1
        assert auditee.verdict((auditor, with_start(q, bytes(start)))) == Refusal.TOKEN_INVALID


class TestAuthenticators:
    def test_as_printed_both_nodes_sign(self, as_printed):
        as_printed.goes_on()
        auditor, q = as_printed.asks()
        assert as_printed.verdict((auditor, q)) == 0
        for at in (request.AT_TOP_A, request.AT_AUTH_A, request.AT_TOP_S, request.AT_AUTH_S):
            assert as_printed.verdict((auditor, with_byte(q, at, q[at] ^ 1))) == Refusal.AUTHENTICATOR_INVALID

    @pytest.mark.parametrize("last", [19, 7])
    def test_all_bytes_of_a_top_and_of_a_mac_count(self, auditee, last):
        auditee.goes_on()
        auditor, q = auditee.asks()
        at = (request.AT_TOP_S if last == 19 else request.AT_AUTH_S) + last
        assert auditee.verdict((auditor, with_byte(q, at, q[at] ^ 1))) == Refusal.AUTHENTICATOR_INVALID

    def test_they_are_of_this_token_request(self, auditee):
        auditee.goes_on()
        _, old = auditee.asks()
        for _ in range(4):
            auditee.senses()
        auditee.robot.quota = 1
        auditor, q = auditee.asks()
        mix_hash = q[: request.AT_TOP_S] + old[request.AT_TOP_S : request.AT_TOP_S + 28] + q[request.AT_TOP_S + 28 :]
        assert auditee.verdict((auditor, q)) == 0
        assert auditee.verdict((auditor, mix_hash)) == Refusal.AUTHENTICATOR_INVALID


class TestAsPrinted:
    """Profile `paper` asks for no times, so no robot is refused for one."""

    def test_a_reading_may_come_when_it_likes(self, as_printed):
        as_printed.goes_on()
        as_printed.senses(as_printed.due_ms() + DELTA_MS + 1)
        as_printed.senses(late_ms=DELTA_MS + 1)
        assert as_printed.verdict(as_printed.asks(as_printed.due_ms() + 1000)) == 0

    def test_entries_may_be_in_any_order_of_time(self, as_printed):
        as_printed.goes_on()
        sensed_ms = as_printed.due_ms()
        sensed = as_printed.polled(sensed_ms)
        as_printed.logs(as_printed.hears_of(sensed_ms + SKEW_MS + 1))
        as_printed.logs(sensed)
        for kind, payload in as_printed.thinks(sensed):
            as_printed.logs(as_printed.chained(kind, sensed_ms + SKEW_MS + 1, payload))
        assert as_printed.verdict(as_printed.asks()) == 0

    def test_an_output_is_missing_at_once(self, as_printed):
        as_printed.goes_on()
        as_printed.asks()
        as_printed.senses()
        sensed_ms = as_printed.due_ms()
        sensed = as_printed.polled(sensed_ms)
        as_printed.logs(sensed)
        as_printed.thinks(sensed)
        as_printed.robot.quota = 1
        assert as_printed.verdict(as_printed.asks(sensed_ms)) == Refusal.OUTPUT_MISSING

    def test_whoever_owes_more_outputs_than_there_is_room_for_is_missing_one(self, as_printed):
        """Else the last one's would be forgotten: all others are shown here, late as they are."""
        room, owed = int(as_printed.judge.work.waiting.shape[0]), []
        while sum(ENTRY_HEAD_BYTES + len(payload) for outputs in owed for _, payload in outputs) <= room:
            sensed = as_printed.polled(as_printed.due_ms())
            as_printed.logs(sensed)
            owed.append(as_printed.thinks(sensed))
        as_printed.round_begins(as_printed.due_ms())
        for outputs in owed[:-1]:
            for kind, payload in outputs:
                as_printed.logs(as_printed.chained(kind, as_printed.due_ms(as_printed.step - 1), payload))
        assert as_printed.verdict(as_printed.asks()) == Refusal.OUTPUT_MISSING


class TestParts:
    def test_entries_are_of_the_four_kinds(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        segment = q[segment_at(q) :]
        for kind in (0, ACMD + 1, 0x7F):
            forged = with_segment(q, entry(kind, auditee.due_ms(0), b"\0 what?") + segment)
            assert auditee.verdict((auditor, forged)) == Refusal.ENTRY_MALFORMED

    def test_marks_are_of_the_four_kinds(self, auditee):
        auditee.goes_on()
        for mark in (0x80, 0x85, 0xC1, 0xFF):
            auditee.robot.quota = 1
            assert shown_of(auditee, lambda shown, mark=mark: [bytes([mark]), *shown]) == Refusal.ENTRY_MALFORMED
            for _ in range(3):
                auditee.senses()

    def test_entries_end_with_the_segment(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        segment, t_ms = q[segment_at(q) :], auditee.due_ms(auditee.step - 1) + 1
        behind = entry(RECV, t_ms, MOTION.pack(KIND_STATE, 3, t_ms, 1, 2, 3, 4))
        for length in range(1, len(behind)):
            assert auditee.verdict((auditor, with_segment(q, segment + behind[:length]))) == Refusal.ENTRY_MALFORMED
        assert auditee.verdict((auditor, with_segment(q, segment + behind))) == Refusal.A_CHAIN

    def test_entries_are_not_empty_and_not_longer_than_a_frame(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        segment, t_ms = q[segment_at(q) :], auditee.due_ms(auditee.step - 1) + 1
        most = auditee.config.packet_max_bytes
        for length, refusal in (
            (0, Refusal.ENTRY_MALFORMED),
            (1, Refusal.A_CHAIN),
            (most, Refusal.A_CHAIN),
            (most + 1, Refusal.ENTRY_MALFORMED),
        ):
            behind = entry(RECV, t_ms, bytes([KIND_STATE]) * length)
            assert auditee.verdict((auditor, with_segment(q, segment + behind))) == refusal

    @pytest.mark.parametrize("kind, refusal", [(RECV, True), (SEND, True), (ACMD, False), (INPUT, False)])
    def test_only_frames_can_be_audit_frames(self, auditee, kind, refusal):
        auditee.goes_on()
        auditor, q = auditee.asks()
        behind = entry(kind, auditee.due_ms(auditee.step - 1) + 1, b"\xff" * 9)
        found = auditee.verdict((auditor, with_segment(q, q[segment_at(q) :] + behind)))
        assert (found == Refusal.AUDIT_FRAME_LOGGED) == refusal

    def test_a_batch_is_full_after_so_many_entries_of_its_own_chain(self, auditee):
        """Many messages between two readings: the a-chain flushes by itself, the s-chain not."""
        auditee.goes_on()
        for k in range(3 * auditee.config.batch_size):
            auditee.logs(auditee.hears_of(auditee.due_ms(auditee.step - 1) + 10 + k))
        for _ in range(3 * auditee.config.batch_size):
            auditee.senses()
        assert auditee.verdict(auditee.asks()) == 0

    @pytest.mark.parametrize("which", [log.FLUSH_S, log.FLUSH_A])
    def test_a_flush_that_was_none_leads_to_another_top(self, auditee, which):
        auditee.goes_on()
        found = shown_of(auditee, lambda shown: [*shown[:4], bytes([which]), *shown[4:]])
        assert found == (Refusal.S_CHAIN if which == log.FLUSH_S else Refusal.A_CHAIN)

    @pytest.mark.parametrize("which", [log.FLUSH_S, log.FLUSH_A])
    def test_a_flush_that_is_not_shown_leaves_entries_unhashed(self, auditee, which):
        auditee.goes_on()
        found = shown_of(auditee, lambda shown: [part for part in shown if part not in (bytes([which]), CHECKED)])
        assert found == Refusal.CHECKPOINT_MISSING
        auditee.robot.quota = 1
        for _ in range(3):
            auditee.senses()
        found = shown_of(auditee, lambda shown: [CHECKED, *[p for p in shown if p not in (bytes([which]), CHECKED)]])
        assert found == (Refusal.S_CHAIN if which == log.FLUSH_S else Refusal.A_CHAIN)

    def test_a_head_that_is_cut_off_at_the_end_of_all_room_is_not_looked_behind(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        room = auditee.fleet.rx.rows.shape[1]
        marks = bytes([log.FLUSH_A]) * (room - len(q) - 1)
        assert auditee.verdict((auditor, with_segment(q, q[segment_at(q) :] + marks + bytes([RECV])))) == (
            Refusal.ENTRY_MALFORMED
        )

    def test_behind_a_checkpoint_a_message_may_come_long_before_the_next_reading(self, auditee):
        auditee.covered()
        auditor, q = auditee.asks()
        due_ms = int.from_bytes(start_of(q)[rounds.AT_DUE :][:4], "little")
        heard = entry(RECV, due_ms - SKEW_MS - 1, MOTION.pack(KIND_STATE, 3, 0, 1, 2, 3, 4))
        assert auditee.verdict((auditor, with_segment(q, heard + q[segment_at(q) :]))) == Refusal.A_CHAIN

    def test_a_message_of_before_the_key_was_never_passed_on(self, auditee):
        auditee.goes_on()
        auditor, q = auditee.asks()
        key_ms = int.from_bytes(start_of(q), "little")
        segment = q[segment_at(q) :]
        for early_ms, refusal in ((SKEW_MS, Refusal.A_CHAIN), (SKEW_MS + 1, Refusal.OUT_OF_ORDER)):
            heard = entry(RECV, key_ms - early_ms, MOTION.pack(KIND_STATE, 3, 0, 1, 2, 3, 4))
            assert auditee.verdict((auditor, with_segment(q, heard + segment))) == refusal

    def test_a_log_that_ends_a_little_before_the_next_reading_is_due(self, auditee):
        """Within delta of it nobody can say yet that it is missing."""
        for over_ms in (0, 1):
            fresh = Auditee()
            fresh.goes_on()
            found = fresh.verdict(fresh.asks(fresh.due_ms() + DELTA_MS + over_ms))
            assert found == (Refusal.INPUT_MISSING if over_ms else 0)
