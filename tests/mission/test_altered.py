"""Altered files of a chain of nodes: a bit, a record, a header; its honest beginning decodes, and no more.

Other graphs are in test_altered_graphs.py.
"""

from __future__ import annotations

import random
import tracemalloc
from dataclasses import replace

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.errors import NotAuthentic, PeerError, TooLarge
from phalanx.mission import (
    Experience,
    Landmark,
    Profile,
    State,
    Walker,
    admit,
    check_signature,
    parse_mission,
    parse_start_key,
    public_key,
    sign,
)
from phalanx.mission.file.records import FILE_LIMIT
from phalanx.mission.refused import AlreadyStarted, MalformedMission, NotForUs, OutsideWindow, Unsigned
from worlds import BOTH, at, built, cheap, corridor, decoded_of, walk, walker_of

OPERATOR = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))


def honest(mission, one):
    return decoded_of(walk(mission, walker_of(one), steps_each=4))


def walked(mission, raw: bytes, one) -> list | None:
    """What an altered file decodes to along the honest path, or None if it is refused."""
    try:
        walker = walker_of(replace(one, mission=parse_mission(raw)))
    except PeerError:
        return None
    return decoded_of(walk(mission, walker, steps_each=4))


@pytest.mark.parametrize("first", [1, *(pytest.param(k, marks=pytest.mark.long) for k in (0, 2, 3))])
@pytest.mark.parametrize("profile", BOTH)
def test_every_byte_of_a_chain_counts(profile, first):
    mission = cheap(corridor(3), profile)
    one = built(mission, profile)
    expected = honest(mission, one)
    raw = one.mission.encode()
    for bit in (8 * byte + byte // 4 % 8 for byte in range(first, len(raw), 4)):
        altered = bytearray(raw)
        altered[bit // 8] ^= 1 << bit % 8
        got = walked(mission, bytes(altered), one)
        assert got is None or (got == expected[: len(got)] and len(got) < len(expected)), bit


@pytest.mark.parametrize("first", [0, *(pytest.param(k, marks=pytest.mark.long) for k in (1, 2))])
def test_no_bit_of_a_start_key_can_be_changed_to_any_use(first):
    """Nobody signs it, and an open start is in a file whose signature may not be looked at."""
    mission = cheap(corridor(2), Profile.SEALED)
    one = built(mission, Profile.SEALED, open_start=True)
    raw = one.mission.start
    assert decoded_of(walk(mission, Walker(one.mission), steps_each=4)) == honest(mission, one) != []
    for bit in range(first, 8 * len(raw), 3):
        altered = bytearray(raw)
        altered[bit // 8] ^= 1 << bit % 8
        try:
            walker = Walker(replace(one.mission, start=bytes(altered)))
        except PeerError:
            continue
        assert decoded_of(walk(mission, walker, steps_each=4)) == [], bit


@pytest.mark.parametrize("profile", BOTH)
def test_a_record_of_another_mission_does_not_decode(profile):
    mission = cheap(corridor(4), profile)
    one, other = built(mission, profile, 1), built(mission, profile, 2)
    nodes = [*one.mission.nodes]
    nodes[2] = other.mission.nodes[2]
    got = walked(mission, replace(one.mission, nodes=tuple(nodes)).encode(), one)
    assert [node for node, *_ in got] == [0, 1]


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=400), st.booleans())
def test_any_bytes_are_a_mission_or_refused(raw, with_magic):
    for data in (raw, b"PHXM\x01" + raw) if with_magic else (raw,):
        try:
            mission = parse_mission(data)
        except PeerError:
            continue
        assert mission.encode() == data


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=200), st.booleans())
def test_any_bytes_are_a_start_key_or_refused(raw, with_magic):
    data = b"PHXK\x01" + raw if with_magic else raw
    try:
        key = parse_start_key(data)
    except PeerError:
        return
    assert parse_start_key(key.encode()) == key


@pytest.mark.parametrize("profile", BOTH)
def test_a_file_that_ends_early_or_late_is_refused(profile):
    raw = sign(built(cheap(corridor(3), profile), profile).mission, OPERATOR).encode()
    assert parse_mission(raw).encode() == raw
    for length in range(len(raw)):
        with pytest.raises(PeerError):
            parse_mission(raw[:length])
    with pytest.raises(MalformedMission):
        parse_mission(raw + b"\x00")


@pytest.mark.parametrize("profile", BOTH)
def test_a_bomb_costs_no_more_than_its_bytes(profile):
    one = built(cheap(corridor(3), profile), profile).mission
    raw = bytearray(one.encode())
    at_count = len(one.header.encode()) - 4
    claims = [(at_count, 4), (at_count + 4 + 5, 1), (at_count + 4 + 6, 2)]
    tracemalloc.start()
    try:
        for place, size in claims:
            bomb = bytes(raw[:place]) + b"\xff" * size + bytes(raw[place + size :])
            with pytest.raises(PeerError):
                parse_mission(bomb)
        two_to_the_31 = bytes(raw[:at_count]) + (1 << 31).to_bytes(4, "little") + bytes(1 << 20)
        with pytest.raises(MalformedMission):
            parse_mission(two_to_the_31)
        assert tracemalloc.get_traced_memory()[1] < 8 << 20
    finally:
        tracemalloc.stop()
    with pytest.raises(TooLarge):
        parse_mission(bytes(FILE_LIMIT + 1))


def test_many_empty_nodes_are_parsed_or_refused_in_proportion_to_their_bytes():
    shuffled = random.Random(7).randbytes(1 << 20)
    with pytest.raises(PeerError):
        parse_mission(b"PHXM\x01\x00\x00" + shuffled)


class TestAdmission:
    def test_who_signed_counts(self):
        mission = built(corridor(2), Profile.PAPER).mission
        with pytest.raises(Unsigned):
            check_signature(mission, None)
        signed = sign(mission, OPERATOR)
        check_signature(signed, None)
        check_signature(parse_mission(signed.encode()), [public_key(OPERATOR)])
        with pytest.raises(Unsigned, match="not trusted"):
            check_signature(signed, [bytes(32)])
        with pytest.raises(NotAuthentic):
            check_signature(replace(signed, signer=bytes(32)), None)

    def test_a_mission_of_another_robot_or_day_is_refused_and_one_starts_once(self):
        mission = built(corridor(2), Profile.PAPER, robots=(3, 7), valid_from_s=100, valid_to_s=200).mission
        admit(mission, 7, 100.0, ())
        for now in (99.9, 200.0):
            with pytest.raises(OutsideWindow):
                admit(mission, 7, now, ())
        with pytest.raises(NotForUs):
            admit(mission, 8, 150.0, ())
        with pytest.raises(AlreadyStarted):
            admit(mission, 7, 150.0, [mission.header.mission_id])
        again = built(corridor(2, repeatable=True), Profile.PAPER).mission
        admit(again, 7, 150.0, [again.header.mission_id])

    def test_two_builds_are_two_missions(self):
        one, two = (built(corridor(2), Profile.PAPER, seed).mission for seed in (1, 2))
        assert one.header.mission_id != two.header.mission_id


def test_garbage_in_an_experience_does_no_harm():
    mission = corridor(3)
    walker = walker_of(built(mission, Profile.PAPER))
    state = State()
    nowhere = Experience(0.0, 1e9, -1e9, 0.0, landmarks=(Landmark("doorway", 9e5, -9e5, 3.0),))
    for seen in (nowhere, replace(at(mission, 0, 0, 1.0), messages=(b"x" * 10_000,) * 50, sensors=(b"",) * 100)):
        state, _ = walker.step(state, seen)
    assert len(state.heard) <= walker.config.messages_kept
    assert all(len(message) <= 32 for message in state.heard)
