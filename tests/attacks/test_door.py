"""What an auditor's radio hears: whose it is, whether it is audited, and what goes back."""

from __future__ import annotations

import numpy as np
import pytest
from asking import VICTIM
from auditee import Auditee

from phalanx.bti import request, rounds, trusted
from phalanx.bti.refusal import Refusal
from phalanx.robot import actions, handlers
from phalanx.robot.actions import Action, RetryAt, Transmit, Verdict
from phalanx.wire.fields import row
from phalanx.wire.table import AUDIT_SEEK

VICTIM_ID = VICTIM + 1
STRANGER_ID = 8
NO = 77
PASSED_OVER = handlers.NOTHING, []


class Door(Auditee):
    """The auditee's packets come to an auditor, in whose memory another's request has begun."""

    def __init__(self, **said):
        super().__init__(**said)
        self.goes_on()
        self.auditor, self.q = self.asks()
        self.now_ms = self.due_ms(self.step - 1) + 80
        self.auditor_robot = self.fleet.robot[self.auditor - 1]
        other = next(each for each in range(2, 9) if each != self.auditor)
        assert self.hears_frame(self.fragment(b"?" * self.body, src=other, count=2)) == PASSED_OVER

    @property
    def body(self) -> int:
        return self.config.packet_max_bytes - request.FRAGMENT_HEAD_BYTES

    def fragment(self, part: bytes, *, src=VICTIM_ID, dst=None, index=0, count=1, sub=request.FRAGMENT) -> bytes:
        packet = row(bytes(request.FRAGMENT_HEAD_BYTES) + part)
        request.audit_head(packet, src, self.auditor if dst is None else dst, sub)
        packet[request.AT_REQUEST] = NO
        packet[request.AT_INDEX], packet[request.AT_COUNT] = index, count
        return packet.tobytes()

    def hears_frame(
        self, packet: bytes, now_ms: int | None = None, robot: int | None = None
    ) -> tuple[int, list[Action]]:
        """What `on_packet` returns, and its actions."""
        now_ms = self.now_ms if now_ms is None else now_ms
        self.work.place[0] = -7
        at = self.auditor - 1 if robot is None else robot
        told = int(handlers.on_packet(self.fleet, at, self.work, now_ms, row(packet), len(packet)))
        return told, actions.decode(self.work)

    def hears_request(self, q: bytes, now_ms: int | None = None, **said) -> tuple[int, list[Action]]:
        """All of its fragments; what the last one leads to."""
        cut = [q[at : at + self.body] for at in range(0, len(q), self.body)]
        for k, part in enumerate(cut):
            told = self.hears_frame(self.fragment(part, index=k, count=len(cut), **said), now_ms)
            assert told == PASSED_OVER or k == len(cut) - 1
        return told

    def answers(self, q: bytes, now_ms: int | None = None) -> bytes:
        """The token that goes out to the auditee alone, behind the verdict."""
        told, (verdict, sent) = self.hears_request(q, now_ms)
        assert (told, verdict) == (handlers.NOTHING, Verdict(VICTIM_ID, Refusal.NONE))
        assert sent == Transmit(sent.packet, VICTIM_ID)
        return sent.packet

    def knows(self, rob_id: int, robot: int | None = None) -> bool:
        at = self.auditor - 1 if robot is None else robot
        return rob_id in self.fleet.peer_id[at, : int(self.fleet.robot[at].peers)]


@pytest.fixture
def door():
    return Door()


def test_who_is_found_right_is_sent_a_token_and_takes_it(door):
    packet = door.answers(door.q)
    assert door.work.place[0] == 1
    assert len(packet) == request.TOKEN_FRAME_BYTES
    assert (door.auditor_robot.audits_passed, door.auditor_robot.audits_refused, door.auditor_robot.accepted) == (
        1,
        0,
        1,
    )
    head = row(bytes(request.TOKEN_FRAME_BYTES))
    request.audit_head(head, door.auditor, VICTIM_ID, request.TOKEN)
    head[request.AT_REQUEST] = NO
    head[request.REPLY_T : request.REPLY_T + 4] = row(door.q[request.AT_T :][:4])
    assert packet[: request.REPLY_MAC] == head[: request.REPLY_MAC].tobytes()
    claimed, mac = row(door.q[request.AT_HCKPT :][:20]), row(packet[request.REPLY_MAC :])
    t_ms = int.from_bytes(door.q[request.AT_T :][:4], "little")
    assert (
        trusted.anode_check_token(door.profile, door.fleet.anode[0], door.auditor, VICTIM_ID, t_ms, claimed, mac) == 0
    )
    assert door.robot.got == 0
    assert door.hears_frame(packet, robot=VICTIM) == PASSED_OVER
    assert door.robot.got == 1


@pytest.mark.parametrize("change", [-1, 1])
def test_a_token_of_another_length_is_none(door, change):
    packet = (door.answers(door.q) + b"\0")[: request.TOKEN_FRAME_BYTES + change]
    assert door.hears_frame(packet, robot=VICTIM) == PASSED_OVER
    assert door.robot.got == 0


@pytest.mark.parametrize("sub", [request.HELLO, 9])
def test_a_token_that_is_called_something_else_is_none(door, sub):
    packet = row(door.answers(door.q))
    packet[request.AT_SUB] = sub
    assert door.hears_frame(packet.tobytes(), robot=VICTIM) == PASSED_OVER
    assert door.robot.got == 0


def test_a_token_with_another_mac_is_none(door):
    packet = bytearray(door.answers(door.q))
    packet[-1] ^= 1
    assert door.hears_frame(bytes(packet), robot=VICTIM) == PASSED_OVER


@pytest.mark.parametrize(
    "at, refusal",
    [
        (0, Refusal.MALFORMED),
        (request.AT_TREQ_MAC, Refusal.REQUEST_INVALID),
        (request.AT_AUTH_S, Refusal.AUTHENTICATOR_INVALID),
        (-1, Refusal.A_CHAIN),
    ],
)
def test_who_is_found_wrong_is_told_nothing(door, at, refusal):
    """And whoever has no true token request is not even counted as audited."""
    wrong = bytearray(door.q)
    if at < 0:
        wrong[-1] = wrong[-2] = wrong[-3]  # the same mark thrice
        refusal = Refusal.CHECKPOINT_MISSING
    else:
        wrong[at] ^= 1
    assert door.hears_request(bytes(wrong)) == (handlers.NOTHING, [Verdict(VICTIM_ID, refusal)])
    assert (door.auditor_robot.audits_passed, door.auditor_robot.audits_refused) == (0, 1)
    audited = refusal not in (Refusal.MALFORMED, Refusal.REQUEST_INVALID)
    assert door.auditor_robot.accepted == audited


def test_a_robot_that_the_replay_finds_wrong_is_told_nothing():
    door = Door()
    door.logs(door.chained(4, door.due_ms(door.step - 1) + 90, b"\x03 once more"))
    for _ in range(3):
        door.senses()
    door.robot.quota = 1
    later_ms = door.due_ms(door.step - 1) + 3000
    door.auditor, q = door.asks(door.due_ms(door.step - 1) + 60)
    wrong = Verdict(VICTIM_ID, Refusal.OUTPUT_UNCALLED)
    assert door.hears_request(q, later_ms) == (handlers.NOTHING, [wrong])


def test_one_token_request_is_audited_once(door):
    door.answers(door.q)
    for after_ms in (2000, 20_000):
        assert door.hears_request(door.q, door.now_ms + after_ms) == PASSED_OVER
    assert door.auditor_robot.accepted == 1


@pytest.mark.parametrize("ago_ms, admitted", [(0, True), (-1, False)])
def test_so_many_are_audited_in_t_val_and_no_more(door, ago_ms, admitted):
    door.fleet.taken[door.auditor - 1] = door.now_ms - door.config.t_val_ms - ago_ms
    if admitted:
        door.answers(door.q)
    else:
        assert door.hears_request(door.q) == PASSED_OVER
    assert door.auditor_robot.accepted == admitted
    assert (door.fleet.taken[door.auditor - 1] == door.now_ms).sum() == admitted
    assert (door.fleet.peer[door.auditor - 1, : int(door.auditor_robot.peers)].took_t > 0).sum() == admitted


def test_the_place_of_the_oldest_audit_is_taken(door):
    taken = door.fleet.taken[door.auditor - 1]
    door.auditor_robot.accepted = len(taken) + 2
    door.answers(door.q)
    assert np.flatnonzero(taken == door.now_ms).tolist() == [2]


def test_a_swarm_in_plain_python_replays_for_itself(door):
    door.fleet.settings[0].controller = 0
    assert door.hears_request(door.q) == (handlers.WHOLE, [])
    place = int(door.work.place[0])
    assert door.fleet.rx.rows[door.fleet.rx_info[door.auditor - 1, place].row, : len(door.q)].tobytes() == door.q
    assert door.auditor_robot.accepted == 1


class TestWhose:
    def hello(self, src: int, dst: int = 0) -> bytes:
        packet = row(bytes(request.AUDIT_HEAD_BYTES))
        request.audit_head(packet, src, dst, request.HELLO)
        return packet.tobytes()

    def test_who_says_hello_is_in_range(self, door):
        robot = STRANGER_ID if door.auditor != STRANGER_ID else 7
        assert not door.knows(robot) or door.auditor == robot
        assert door.hears_frame(self.hello(robot)) == PASSED_OVER
        assert door.knows(robot)
        at = rounds.peer_at(door.fleet, door.auditor - 1, robot)
        assert door.fleet.peer[door.auditor - 1, at].heard == door.now_ms

    def test_a_seek_is_answered_later(self, door):
        seek = AUDIT_SEEK.encode(src=STRANGER_ID, dst=0, nonce=1, since=0, share=255)
        assert door.hears_frame(seek + b"\0") == PASSED_OVER
        code, (answer,) = door.hears_frame(seek)
        assert (code, type(answer)) == (handlers.NOTHING, RetryAt)
        assert door.hears_frame(seek) == PASSED_OVER

    def test_a_frame_that_is_shorter_than_its_head_is_nobodys(self, door):
        assert door.hears_frame(self.hello(STRANGER_ID)[:-1]) == PASSED_OVER
        assert not door.knows(STRANGER_ID)

    def test_what_is_for_another_is_not_taken(self, door):
        assert door.hears_frame(self.hello(STRANGER_ID, dst=door.auditor + 1)) == PASSED_OVER
        assert not door.knows(STRANGER_ID)
        assert door.hears_request(door.q, dst=VICTIM_ID) == PASSED_OVER
        assert door.auditor_robot.accepted == 0
        assert door.hears_frame(self.hello(STRANGER_ID, dst=door.auditor)) == PASSED_OVER
        assert door.knows(STRANGER_ID)

    @pytest.mark.parametrize("own", [True, False])
    def test_nobody_hears_itself_or_robot_0(self, door, own):
        before = int(door.auditor_robot.peers)
        door.hears_frame(self.hello(door.auditor if own else 0))
        assert door.auditor_robot.peers == before
        assert door.hears_request(door.q, src=door.auditor if own else 0) == PASSED_OVER
        assert door.auditor_robot.audits_refused == 0

    def test_a_frame_of_no_sort_does_nothing_more(self, door):
        for sub in (request.HELLO, 9):
            assert door.hears_request(door.q, sub=sub) == PASSED_OVER
        assert door.auditor_robot.accepted == 0
        assert (door.fleet.rx_info[door.auditor - 1].src == VICTIM_ID).sum() == 0
