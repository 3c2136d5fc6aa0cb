"""Requests with evidence in them, as auditors get them: whatever is done to one, the answer is a verdict with a name."""

from __future__ import annotations

import random
from collections import Counter
from functools import cache

import numpy as np

from audited import swarm
from phalanx.bti import log, request
from phalanx.bti.refusal import Refusal
from phalanx.mission import Profile
from phalanx.robot import handlers
from phalanx.robot.controllers.mission.evidence import pack_evidence, unpack_evidence
from phalanx.scenarios.scenario import Scenario
from phalanx.world.scenarios.run import Run
from shown_requests import requests_of

INPUT = 1
MARKS = (log.FLUSH_S, log.FLUSH_A, log.CHECKPOINT)


class Shown:
    """Requests of a run in which nobody lies: (auditee, auditor, head, items of the log)."""

    def __init__(self):
        self.run = swarm(Profile.PAPER)
        self.requests = [(auditee, auditor, *taken_apart(q)) for auditee, auditor, q in requests_of(self.run, 24.0)]

    def verdict(self, auditee: int, auditor: int, q: bytes) -> Refusal:
        fleet, work = self.run.world.fleet, self.run.world.work
        fleet.rx.rows[auditor] = 0xA5
        fleet.rx.rows[auditor, : len(q)] = np.frombuffer(q, np.uint8)
        fleet.rx_info[auditor, 0].row, fleet.rx_info[auditor, 0].len = auditor, len(q)
        refused = handlers.precheck_request(fleet, auditor, work, 0, auditee + 1)
        if not refused:
            refused = self.run.robots[auditor].inner._judge(0, auditee + 1)
        return Refusal(int(refused))


@cache
def shown() -> Shown:
    return Shown()


def taken_apart(q: bytes) -> tuple[bytes, list[bytes]]:
    tokens, checkpoint = q[request.AT_TOKENS], int.from_bytes(q[request.AT_CHECKPOINT_LEN :][:2], "little")
    at = request.HEAD_BYTES + tokens * request.TOKEN_BYTES + checkpoint
    end = at + int.from_bytes(q[request.AT_SEGMENT_LEN :][:4], "little")
    head, items = q[:at], []
    while at < end:
        if q[at] in MARKS:
            size = 1
        elif q[at] == log.EVIDENCE:
            size = log.EVIDENCE_HEAD_BYTES + int.from_bytes(q[at + 1 : at + 3], "little")
        else:
            size = 7 + int.from_bytes(q[at + 5 : at + 7], "little")
        items.append(q[at : at + size])
        at += size
    return head, items


def put_together(head: bytes, items: list[bytes]) -> bytes:
    segment = b"".join(items)
    at = request.AT_SEGMENT_LEN
    return head[:at] + len(segment).to_bytes(4, "little") + head[at + 4 :] + segment


def with_evidence():
    """The requests that hold some, with where it is."""
    for auditee, auditor, head, items in shown().requests:
        places = [k for k, item in enumerate(items) if item[0] == log.EVIDENCE]
        if places:
            yield auditee, auditor, head, items, places


def marked(evidence: bytes) -> bytes:
    return bytes([log.EVIDENCE]) + len(evidence).to_bytes(2, "little") + evidence


def test_as_they_were_made_all_pass():
    assert len(list(with_evidence())) > 20
    for auditee, auditor, head, items in shown().requests:
        assert shown().verdict(auditee, auditor, put_together(head, items)) is Refusal.NONE


def test_left_out_evidence_of_a_decode_leaves_outputs_that_nothing_calls_for():
    verdicts = Counter()
    for auditee, auditor, head, items, places in with_evidence():
        for k in places:
            if unpack_evidence(items[k][3:], 1080)[0]:
                verdicts[shown().verdict(auditee, auditor, put_together(head, [*items[:k], *items[k + 1 :]]))] += 1
    assert verdicts.keys() <= {Refusal.OUTPUT_WRONG, Refusal.OUTPUT_UNCALLED, Refusal.CHECKPOINT_WRONG}
    assert verdicts.total() > 10


def test_evidence_stands_behind_an_input_once_and_has_a_length():
    for auditee, auditor, head, items, places in list(with_evidence())[::5]:
        k = places[0]
        piece = items[k]
        rest = [*items[:k], *items[k + 1 :]]
        elsewhere = next(j for j, item in enumerate(rest) if item[0] not in (INPUT, *MARKS)) + 1
        forged = {
            "twice": [*items[:k], piece, *items[k:]],
            "behind a command": [*rest[:elsewhere], piece, *rest[elsewhere:]],
            "at the very beginning": [piece, *rest],
            "of no length": [*items[:k], marked(b""), *items[k + 1 :]],
            "longer than any": [*items[:k], marked(bytes(5000)), *items[k + 1 :]],
            "longer than the log": [*items[:-1], items[-1], b"\x84\xff\xff"],
            "cut within its head": [*items, b"\x84\x01"],
        }
        for way, changed in forged.items():
            assert shown().verdict(auditee, auditor, put_together(head, changed)) is Refusal.ENTRY_MALFORMED, way


def test_another_readings_evidence_is_wrong():
    pieces = [(items[k]) for _, _, _, items, places in with_evidence() for k in places]
    scans = [piece for piece in dict.fromkeys(pieces) if unpack_evidence(piece[3:], 1080)[1]]
    for auditee, auditor, head, items, places in list(with_evidence())[::5]:
        for k in places:
            for other in scans[:8]:
                if other == items[k]:
                    continue
                claims, _ = unpack_evidence(items[k][3:], 1080)
                mixed = marked(pack_evidence(claims, unpack_evidence(other[3:], 1080)[1]))
                for piece in (other, mixed):
                    q = put_together(head, [*items[:k], piece, *items[k + 1 :]])
                    assert shown().verdict(auditee, auditor, q) is Refusal.EVIDENCE_WRONG


def test_whatever_bytes_are_changed_the_verdict_has_a_name():
    dice, verdicts = random.Random(3), Counter()
    requests = list(with_evidence())
    for _ in range(600):
        auditee, auditor, head, items, places = dice.choice(requests)
        items = list(items)
        k = dice.choice(places)
        piece = bytearray(items[k])
        for _ in range(dice.randrange(1, 4)):
            piece[dice.randrange(3 if dice.random() < 0.8 else 0, len(piece))] = dice.randrange(256)
        items[k] = bytes(piece)
        verdicts[shown().verdict(auditee, auditor, put_together(head, items))] += 1
    assert Refusal.CONTROLLER_FAILED not in verdicts
    assert verdicts[Refusal.EVIDENCE_WRONG] > 300
    assert verdicts[Refusal.NONE] < 30, "only what says the same in other bytes"


def test_a_checkpoint_that_is_no_state_is_refused_as_such():
    auditee, auditor, head, items, _ = next(each for each in with_evidence() if each[2][1] == 0)
    at = request.HEAD_BYTES + head[request.AT_TOKENS] * request.TOKEN_BYTES
    run = shown().run
    inner, work = run.robots[auditor].inner, run.world.work
    controller = inner.make_controller(auditee + 1)
    state = head[at + 48 :]
    controller.decode(state)
    assert controller.encode() == state
    for k in range(len(state)):
        changed = bytearray(head)
        changed[at + 48 + k] ^= 0xFF
        assert shown().verdict(auditee, auditor, put_together(bytes(changed), items)) is Refusal.TOKEN_INVALID
    # Were it vouched for all the same.
    work.case[0].auditee, work.case[0].start_len = auditee + 1, 48 + len(state)
    work.state[48 : 48 + len(state)] = 0xFF
    q = np.frombuffer(bytearray(put_together(head, items)), np.uint8)
    assert inner._replay(q) == Refusal.STATE_MALFORMED


def test_bundled_controllers_take_no_evidence():
    made = Run(Scenario(robots=9, grid_step_m=10.0, d_m=10.0, duration_s=60.0))
    assert made.world.work.evidence.shape == (0,)
    fleet = made.world.fleet
    auditee, auditor, shown_q = next(requests_of(made, 6.0))
    head, items = taken_apart(shown_q)
    k = next(j for j, item in enumerate(items) if item[0] == INPUT) + 1

    def verdict(shown_items):
        q = np.frombuffer(bytearray(put_together(head, shown_items)), np.uint8)
        fleet.rx.rows[auditor, : len(q)] = q
        fleet.rx_info[auditor, 0].row, fleet.rx_info[auditor, 0].len = auditor, len(q)
        assert handlers.precheck_request(fleet, auditor, made.world.work, 0, auditee + 1) == 0
        return Refusal(int(handlers.audit_request(fleet, auditor, made.world.work, 0, auditee + 1)))

    assert verdict(items) is Refusal.NONE
    assert verdict([*items[:k], marked(b"x"), *items[k:]]) is Refusal.ENTRY_MALFORMED
