"""Random times of a robot that seeks or answers: nobody can compute them from what it has observed."""

from __future__ import annotations

import hashlib
from itertools import pairwise

import numpy as np
import pytest
from asking import BOOT_MS, GRANT_MS, ROUND_MS, VICTIM
from seeking_robot import ASKER, Seeking, Unheard, retry_ms, seek_of

from phalanx.bti import rounds, seeking

SECRET = bytes(range(0x81, 0x89))
FIRST_MS = BOOT_MS + 2 * GRANT_MS
LATER_MS = range(FIRST_MS, FIRST_MS + 8 * ROUND_MS, ROUND_MS // 8)
SENDERS = range(2, 9)


def with_secret(robot, secret: bytes):
    """Give a robot the MAC of which it draws, for this round and all later ones."""
    robot.robot.secret[:] = np.frombuffer(secret, np.uint8)
    robot.robot.drawn_in = 1 << 40
    return robot


def answers_ms(secret: bytes, src: int = ASKER) -> list[int]:
    """Return how long the robot waits each time before it answers."""
    robot = with_secret(Seeking(), secret)
    waits_ms = []
    for now_ms in LATER_MS:
        waits_ms.append(retry_ms(robot.receives(seek_of(src), now_ms)) - now_ms)
        robot.robot.answer_at = 0
    return waits_ms


def seeks_ms(secret: bytes) -> list[int]:
    """Return the moments of a round at which the robot sends SEEK."""
    robot = with_secret(Seeking(), secret)
    robot.robot.seeks, now_ms, order_ms = 1, FIRST_MS, []
    for _ in LATER_MS:
        seeking.write_seek(robot.fleet, VICTIM, now_ms, robot.work.packet)
        order_ms.append(now_ms := int(robot.robot.seek_at))
    return order_ms


def pauses_ms(secret: bytes) -> list[int]:
    """Return the pauses before a fragment is repeated, and until the same robot may be asked again."""
    robot = Unheard()
    robot.round_begins(BOOT_MS)
    robot.sends(BOOT_MS + GRANT_MS)
    robot.seeks(BOOT_MS + GRANT_MS)
    with_secret(robot, secret)
    waits_ms = robot.pauses_ms(FIRST_MS)
    to = rounds.peer_at(robot.fleet, VICTIM, int(robot.robot.request_to))
    return [*waits_ms, int(robot.fleet.peer[VICTIM, to].asked_ms)]


def listens_ms(secret: bytes) -> list[int]:
    """Return how long it listens before its next rounds."""
    robot = with_secret(Seeking(), secret)
    return [int(seeking.listens(robot.fleet, VICTIM, now_ms, robot.work.small[1])) for now_ms in LATER_MS]


@pytest.mark.parametrize("times_ms", [answers_ms, seeks_ms, pauses_ms, listens_ms])
def test_all_times_depend_on_each_byte_of_the_mac(times_ms):
    """Before, of 32 bits of it: six answers left one candidate, and the rest of the round was known."""
    told = [times_ms(SECRET)]
    for k in range(len(SECRET)):
        other = bytearray(SECRET)
        other[k] ^= 1
        told.append(times_ms(bytes(other)))
    assert told[0] == times_ms(SECRET)
    assert len({tuple(each) for each in told}) == 1 + len(SECRET)


def test_answers_to_different_senders_do_not_tell_of_each_other():
    told = [tuple(answers_ms(SECRET, src)) for src in SENDERS]
    assert len(set(told)) == len(told)
    apart_ms = {tuple(np.subtract(one, other)) for one, other in pairwise(told)}
    assert all(len(set(each)) > len(LATER_MS) // 2 for each in apart_ms)


def test_a_number_is_a_hash_of_the_whole_mac_its_purpose_the_robot_and_the_time():
    robot, scratch = with_secret(Seeking(), SECRET), np.zeros(32, np.uint8)
    for purpose in (seeking.NONCE, seeking.ANSWER):
        drawn = seeking.draw(robot.fleet, VICTIM, purpose, 0x1234, 0x123456789A, scratch)
        hashed = SECRET + bytes([purpose]) + (0x1234).to_bytes(2, "little") + (0x123456789A).to_bytes(8, "little")
        assert drawn == int.from_bytes(hashlib.sha1(hashed).digest()[:4], "little")


def test_the_nonce_shows_no_byte_of_the_mac_in_its_place():
    shown = []
    for k in range(32):
        robot = Seeking()
        robot.senses(robot.now_ms + k)
        robot.round_due(listened=False)
        nonce, secret = int(robot.robot.nonce).to_bytes(4, "little"), bytes(robot.robot.secret)
        assert secret != bytes(8)
        shown.append(sum(nonce[n] in (secret[n], secret[n + 4]) for n in range(4)))
    assert sum(shown) < 16, "one of 128 by chance"


def test_a_robot_that_receives_a_seek_while_it_listens_keeps_its_nonce():
    """Before, it drew another one, and the answers to its own SEEK did not count."""
    robot = Seeking()
    robot.round_due(listened=False)
    nonce, secret = int(robot.robot.nonce), bytes(robot.robot.secret)
    robot.senses(robot.now_ms)
    assert retry_ms(robot.receives(seek_of(ASKER), robot.now_ms))
    robot.round_due(listened=True)
    assert retry_ms(robot.receives(seek_of(ASKER + 1), robot.now_ms))
    assert (int(robot.robot.nonce), bytes(robot.robot.secret)) == (nonce, secret)
