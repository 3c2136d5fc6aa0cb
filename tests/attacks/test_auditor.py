"""Whatever bytes an auditor is shown: a verdict, soon, and no token for another past than the trusted nodes chained."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np
import pytest
from caught import meaning, quiet_run

from phalanx.bti import request
from phalanx.bti.fleet import Fleet
from phalanx.bti.memo import Memo
from phalanx.bti.refusal import Refusal
from phalanx.robot import actions, handlers
from phalanx.robot.actions import Verdict
from phalanx.robot.adversary.liar import tokens_in

MUTATED = 10_000
# Times as long: what audits of a few microseconds differ by on a busy machine, and more.
MUCH = 10
HUGE = (0xFF, 0x7F, 0x80, 0x00, 0xFE)


@pytest.fixture(scope="module", params=["hardened", "paper"])
def caught(request):
    return quiet_run(request.param, 22)


def entries(q: bytes) -> list[tuple[int, int]]:
    """(at, length) of the segment's parts, marks among them."""
    segment = int.from_bytes(q[request.AT_SEGMENT_LEN :][:4], "little")
    at, found = len(q) - segment, []
    while at < len(q):
        size = 1 if q[at] & 0x80 else 7 + int.from_bytes(q[at + 5 : at + 7], "little")
        found.append((at, size))
        at += size
    return found


def flip_bits(q, dice):
    made = bytearray(q)
    for _ in range(int(dice.integers(1, 9))):
        made[int(dice.integers(len(made)))] ^= 1 << int(dice.integers(8))
    return bytes(made)


def flip_bits_of_the_head(q, dice):
    made = bytearray(q)
    made[int(dice.integers(request.HEAD_BYTES))] ^= 1 << int(dice.integers(8))
    return bytes(made)


def cut(q, dice):
    return q[: int(dice.integers(len(q)))]


def lengthen(q, dice):
    return q + dice.bytes(int(dice.integers(1, 3000)))


def random_bytes(q, dice):
    return dice.bytes(int(dice.integers(0, 2 * len(q))))


def random_behind_the_head(q, dice):
    return q[: request.HEAD_BYTES] + dice.bytes(len(q) - request.HEAD_BYTES)


def huge_lengths(q, dice):
    made = bytearray(q)
    places = [request.AT_TOKENS, request.AT_CHECKPOINT_LEN, request.AT_SEGMENT_LEN, request.AT_SEGMENT_LEN + 3]
    places += [at + 5 for at, size in entries(q) if size > 1] + [at + 6 for at, size in entries(q) if size > 1]
    made[places[int(dice.integers(len(places)))]] = HUGE[int(dice.integers(len(HUGE)))]
    return bytes(made)


def swap_entries(q, dice):
    parts = entries(q)
    a, b = sorted(int(k) for k in dice.choice(len(parts), 2, replace=False))
    (at, size), (bt, bize) = parts[a], parts[b]
    return q[:at] + q[bt : bt + bize] + q[at + size : bt] + q[at : at + size] + q[bt + bize :]


def drop_or_double_an_entry(q, dice):
    at, size = entries(q)[int(dice.integers(len(entries(q))))]
    again = dice.integers(2)
    made = bytearray(q[:at] + q[at : at + size] * 2 * int(again) + q[at + size :])
    segment = int.from_bytes(q[request.AT_SEGMENT_LEN :][:4], "little") + (size if again else -size)
    made[request.AT_SEGMENT_LEN : request.AT_SEGMENT_LEN + 4] = segment.to_bytes(4, "little")
    return bytes(made)


MUTATIONS = (
    flip_bits, flip_bits_of_the_head, cut, lengthen, random_bytes, random_behind_the_head, huge_lengths, swap_entries,
    drop_or_double_an_entry,
)  # fmt: skip


def mutated(caught, count: int, seed: int = 0):
    dice = np.random.default_rng(seed)
    for k in range(count):
        auditee, auditor, q = caught.requests[int(dice.integers(len(caught.requests)))]
        yield auditee, auditor, q, MUTATIONS[k % len(MUTATIONS)](q, dice)


def cost_s(caught, auditee: int, auditor: int, q: bytes) -> float:
    """Processor time of an audit, the least of five: others share the machine."""
    costs = []
    for _ in range(5):
        began = time.thread_time()
        caught.judge(auditee, auditor, q)
        costs.append(time.thread_time() - began)
    return min(costs)


def costs_less(caught, limit_s: float, *request) -> bool:
    """Return whether an audit takes less processor time than the limit; a slow one is measured again a little later."""
    for _ in range(20):
        if cost_s(caught, *request) < limit_s:
            return True
        time.sleep(0.01)
    return False


def test_unchanged_requests_pass(caught):
    assert len(caught.requests) > 30
    assert {caught.judge(*each)[0] for each in caught.requests} == {0}


def test_of_ten_thousand_mutated_requests_none_earns_a_token(caught):
    reasons = Counter()
    for auditee, auditor, q, made in mutated(caught, MUTATED):
        refused, _ = caught.judge(auditee, auditor, made)
        reasons[Refusal(refused).name] += 1
        assert refused or meaning(made) == meaning(q)
    assert reasons["NONE"] < MUTATED / 20
    assert len(reasons) >= 8, reasons


def filled(q: bytes, room: int):
    """Requests as long as there is room for, whose segments repeat one part of the true one."""
    for part in {q[at]: q[at : at + size] for at, size in entries(q)}.values():
        head = bytearray(q[: entries(q)[0][0]])
        segment = part * ((room - len(head)) // len(part))
        head[request.AT_SEGMENT_LEN : request.AT_SEGMENT_LEN + 4] = len(segment).to_bytes(4, "little")
        yield bytes(head) + segment


def test_no_byte_of_a_request_takes_much_longer_than_one_of_an_honest_request(caught):
    auditee, auditor, q = max(caught.requests, key=lambda each: len(each[2]))
    room = caught.judge.fleet.rx.rows.shape[1]
    assert room > 5 * len(q)
    most_s = MUCH * cost_s(caught, auditee, auditor, q)
    for made in filled(q, room):
        assert costs_less(caught, most_s * room / len(q), auditee, auditor, made)
    for auditee, auditor, _, made in mutated(caught, MUTATED // 10, seed=2):
        assert costs_less(caught, most_s, auditee, auditor, made)


def test_uncompiled_where_an_index_out_of_bounds_would_show_the_verdicts_are_the_same(caught, tmp_path):
    asked = [(auditee, auditor, made) for auditee, auditor, _, made in mutated(caught, 60, seed=1)]
    here = [caught.judge(*each)[0] for each in asked]
    assert len(set(here)) > 5
    assert [refused for refused, _ in caught.judge.elsewhere(asked, tmp_path)] == here


def test_another_robot_cannot_use_a_request(caught):
    auditee, auditor, q = caught.requests[0]
    assert caught.judge((auditee + 1) % 10, auditor, q)[0] == Refusal.NOT_THE_SENDER
    assert (
        caught.judge(auditee, next(i for i in range(10) if i not in (auditee, auditor)), q)[0]
        == Refusal.REQUEST_INVALID
    )


def untouched(f: Fleet, lent: set[int]) -> dict[str, bytes]:
    """All that no fragment may change: of robot 0 its log, its state and its tokens; of all others everything.

    `lent` are the rows that may be lent to robot 0.
    """
    taken_in = {"robot", "anode", "peer", "peer_id", "owed", "rx_info", "taken"}
    own = set(Fleet._fields) - {"memo", "request", "rx"}
    robots = {name: getattr(f, name)[int(name in taken_in) :].tobytes() for name in own}
    robots |= {"request": f.request.rows.tobytes(), "rx": np.delete(f.rx.rows, sorted(lent), axis=0).tobytes()}
    return robots | {name: getattr(f.memo, name).tobytes() for name in Memo._fields}


def test_fragments_of_any_bytes_do_no_harm(caught):
    """Through the radio's door: heads that make no sense, and true heads with any numbers in them.

    What they are put together in lies between the rows of other robots: nobody else's may change, nor what the robot
    has logged or holds.
    """
    f, w = caught.judge.fleet, caught.judge.work
    dice = np.random.default_rng(5)
    now = 100_000_000
    lent = {
        *f.rx.free[: f.rx.left[0]][-f.rx_info.shape[1] :].tolist(),
        *f.rx_info[0].row[f.rx_info[0].src != 0].tolist(),
    }
    before, audited = untouched(f, lent), 0
    for k in range(3000):
        length = int(dice.choice([1, 5, 6, 10, 11, 15, 20, 60, 2048]))
        packet = np.frombuffer(bytearray(dice.bytes(length)), np.uint8)
        packet[0] |= request.AUDIT
        if k % 4 and length > 10:
            request.audit_head(packet, int(dice.integers(0, 12)), 1, int(dice.integers(0, 5)))
            packet[8], packet[9] = int(dice.choice([0, 1, 5, 62, 63, 255])), int(dice.choice([0, 1, 2, 6, 63, 64, 255]))
        told = handlers.on_packet(f, 0, w, now + k * 7, packet, length)
        asked = actions.decode(w)
        assert told == handlers.NOTHING or (told < 0 and not asked)
        assert not tokens_in(asked)
        verdicts = [each for each in asked if isinstance(each, Verdict)]
        assert all(each.refusal for each in verdicts)
        audited += len(verdicts)
        assert 0 <= f.robot[0].peers <= f.peer.shape[1]
        assert (f.rx_info[0].len <= f.rx.rows.shape[1]).all()
    assert audited > 0
    after = untouched(f, lent)
    # The time of an answer to SEEK is drawn from the s-node, once a round: that flushes its chain, and marks the log.
    assert {name for name in before if before[name] != after[name]} <= {"log", "snode"}
