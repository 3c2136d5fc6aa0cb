"""The sealed profile: what is stored says nothing about what is observed, except through scrypt."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.crypto import keys as scrypt_module
from phalanx.mission import (
    Action,
    BuildOptions,
    Draft,
    Landmark,
    Position,
    Profile,
    Sensor,
    State,
    Time,
    build,
)
from phalanx.mission.file import sealed
from phalanx.mission.file.canonical import shape_of
from phalanx.mission.file.records import Header, NodeRecord
from phalanx.mission.refused import MalformedMission
from phalanx.mission.walk.gate import Gate, Hint, StartKey, join_shares, parse_start_key
from phalanx.mission.walk.state import Keyring
from worlds import CHEAP, at, built, cheap, corridor, draws, until_decoded, walk, walker_of

# What each stored field of a sealed file may depend on. A new field has to be put here, and thought about.
HEADER_FIELDS = {
    "profile": "the author's choice",
    "mission_id": "random",
    "coding": "the author's choice",
    "nodes": "the public graph",
    "flags": "the author's choice",
    "valid_from_s": "the author's choice",
    "valid_to_s": "the author's choice",
    "robots": "the author's choice",
    "shapes": "absent",
}
NODE_FIELDS = {
    "flags": "the public graph",
    "timeout_s": "the author's choice",
    "reach_dm": "the author's choice",
    "sends": "the public graph",
    "aliases": "scrypt",
    "ways": "the public graph, and HMAC under the node's random secret",
    "visited": "the node's random secret",
    "payload": "sealed under the node's random secret",
    "bindings": "absent",
}


def mission_of(x: float, *, reading: bytes = b"red", turn: float = 0.3, text: str = "shelf 1", t_s: float = 50.0):
    draft = Draft("walk", coding=CHEAP)
    draft.node("start", Position(x, 0.0), start=True)
    draft.node("door", Landmark("doorway", x + 4, 1.0, turn), Landmark("qr", x + 4, 1.0, turn, None, text))
    draft.node("red", (Position(x + 8, 0.0), Sensor(reading), Time(t_s)), do=Action("pick"), final=True)
    draft.way("start", "door", direction_rad=0.0)
    draft.way("door", "red", direction_rad=0.0)
    return draft.mission()


def test_every_field_of_the_file_is_accounted_for():
    assert {field.name for field in fields(Header)} == set(HEADER_FIELDS)
    assert {field.name for field in fields(NodeRecord)} == set(NODE_FIELDS)


@settings(max_examples=40, deadline=None)
@given(
    x=st.floats(-50, 50),
    reading=st.binary(max_size=4),
    turn=st.floats(-3, 3),
    text=st.text("ab", max_size=4),
    t_s=st.floats(0, 1e6),
)
def test_no_stored_byte_depends_on_an_observation_except_through_scrypt(x, reading, turn, text, t_s):
    # scrypt is replaced by something that does not look at the observation: then two missions that differ in all that
    # is observed must be the same file, but for what is sealed under the nodes' random secrets.
    def blind(header, canonical, hint, salt):
        return scrypt_module.scrypt(b"", salt, log2_n=1, r=1, length=64)[:32], bytes(32)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sealed, "try_observation", blind)
        files = [
            build(mission, BuildOptions(), draws(5))[0].mission
            for mission in (mission_of(0.0), mission_of(x, reading=reading, turn=turn, text=text, t_s=t_s))
        ]
    one, two = files
    assert one.header == two.header
    for a, b in zip(one.nodes, two.nodes, strict=True):
        assert replace(a, payload=b"") == replace(b, payload=b"")
        # The places and offsets of what comes next are in the payload: its length does not tell them, and the rest is
        # a stream cipher's, under a key that the observation has no part in.
        assert len(a.payload) == len(b.payload)


def test_two_builds_of_one_mission_have_nothing_in_common():
    one, two = (build(mission_of(0.0), BuildOptions(), draws(seed))[0].mission for seed in (1, 2))
    for a, b in zip(one.nodes, two.nodes, strict=True):
        assert {alias.mark for alias in a.aliases}.isdisjoint({alias.mark for alias in b.aliases})
        assert a.visited != b.visited
        assert a.payload != b.payload
        assert {h for way in a.ways for h in way.hashes}.isdisjoint({h for way in b.ways for h in way.hashes})


def test_names_and_actions_are_not_in_the_file():
    raw = built(mission_of(0.0), Profile.SEALED).mission.encode()
    for word in (b"start", b"door", b"pick", b"red"):
        assert word not in raw


def test_each_alias_has_its_own_salt_and_the_messages_are_part_of_it():
    header = built(mission_of(0.0), Profile.SEALED).mission.header
    gate = bytes(32)
    salts = {
        sealed.node_salt(gate, messages, header, node, alias)
        for messages in ((), (b"a" * 32,), (b"b" * 32,), (b"a" * 32, b"b" * 32))
        for node in (0, 1)
        for alias in (0, 1)
    }
    assert len(salts) == 16
    both = (b"a" * 32, b"b" * 32)
    assert sealed.node_salt(gate, both, header, 0, 0) == sealed.node_salt(gate, both[::-1], header, 0, 0)


def test_what_a_visit_proves_says_nothing_about_the_secret():
    secret = bytes(range(32))
    proof = sealed.visited_proof(secret)
    assert proof != secret
    assert sealed.visited_hash(proof) != proof
    assert sealed.visited_proof(bytes(32)) != proof


@given(st.lists(st.binary(min_size=32, max_size=32), min_size=1, max_size=5))
def test_all_shares_make_the_gate_and_fewer_do_not(shares):
    gate = join_shares(shares)
    assert join_shares(shares[::-1]) == gate
    if len(shares) > 1 and any(shares[-1]):
        assert join_shares(shares[:-1]) != gate


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=250), st.booleans())
def test_any_bytes_are_a_payload_or_refused(raw, framed):
    # Whoever signed a mission chose its payloads: sealed is not sensible.
    data = (len(raw).to_bytes(4, "little") + raw).ljust(256, b"\x00") if framed else raw
    try:
        payload = sealed.parse_payload(data)
    except MalformedMission:
        return
    assert sealed.parse_payload(sealed.encode_payload(payload)) == payload


def test_a_start_key_comes_back_as_it_was_written():
    key = StartKey(bytes(16), {0: Gate(bytes(32), (Hint(shape_of([Position(0, 0)])),))}, {"go": bytes(32)})
    assert parse_start_key(key.encode()) == key
    with pytest.raises(MalformedMission):
        parse_start_key(key.encode()[:-1])


def test_a_robot_with_the_wrong_gate_opens_nothing():
    mission = cheap(corridor(3), Profile.SEALED)
    one = built(mission, Profile.SEALED)
    wrong = replace(one.key, gates={0: replace(one.key.gates[0], share=bytes(32))})
    assert not [o for _, o in walk(mission, walker_of(replace(one, key=wrong))) if o.decoded]


def test_slow_tries_are_made_once_and_few_at_a_time():
    mission = cheap(corridor(4), Profile.SEALED)
    walker = walker_of(built(mission, Profile.SEALED))
    places = [mission.nodes[0].place, (5.0, 30.0)]
    steps = list(walk(mission, walker, places=places, range_m=60.0))
    assert max(o.trials for _, o in steps) <= walker.config.kdf_tries
    last, _ = steps[-1]
    again = walker.step(last, at(mission, 5.0, 30.0, last.t_s + 1, range_m=60.0))[1]
    assert again.trials == 0, "all that can be tried here was tried"


def test_what_a_claim_opens_does_not_open_what_comes_next():
    """An auditor has observation and salt of a decode, so the node's payload; and no way to begin to try the next."""
    mission = cheap(corridor(4), Profile.SEALED)
    one = built(mission, Profile.SEALED)
    robot, state = walker_of(one), State()
    for node in mission.nodes[:2]:
        seen = at(mission, *node.place, 1.0 + state.left_at_m)
        state, outcome = until_decoded(robot, state, seen)
        assert outcome.decoded
    claim, header = outcome.decoded.claim, one.mission.header
    _, key = sealed.try_observation(header, claim.observed, Hint(claim.shape, claim.offset), claim.salt)
    record = one.mission.nodes[1]
    secret = sealed.open_secret(header, 1, claim.alias, key, record.aliases[claim.alias].secret)
    told = sealed.open_payload(header, 1, record, secret).ways[0].gate
    assert told.share != state.keys.gates[1, 2].share
    assert told.hints == state.keys.gates[1, 2].hints
    after = at(mission, *mission.nodes[2].place, 9.0)
    assert until_decoded(robot, state, after)[1].decoded.node == 2
    guessed = Keyring(gates={(1, 2): told})
    assert until_decoded(robot, replace(state, keys=guessed), after)[1].decoded is None
