"""A walk as bytes: what was encoded comes back, anything else is refused, and it is never longer than promised."""

from __future__ import annotations

import math
from types import MappingProxyType

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from audited import POOL, Recording, errand, everybody
from phalanx.config import BtiConfig
from phalanx.config.mission import MissionConfig
from phalanx.errors import PeerError, UsageError
from phalanx.mission import LANDMARK_TYPES, Action, Landmark, OpenWay, Phase, Profile, State
from phalanx.mission.angles import TWO_PI, wrap_rad
from phalanx.mission.file.canonical import Reader
from phalanx.mission.refused import MalformedMission
from phalanx.mission.walk.checkpoint import encode_state, parse_state, state_capacity
from phalanx.mission.walk.opening import Known
from phalanx.mission.walk.state import Keyring
from worlds import BOTH, built, cheap, fork, walk, walker_of

both = pytest.mark.parametrize("profile", BOTH)
MISSION = built(fork().mission(), Profile.PAPER).mission
SECTORS = MISSION.header.coding.sectors
metres = st.floats(-1e5, 1e5)
times = st.floats(0, 1e8)
nodes = st.integers(0, len(MISSION.nodes) - 1)
ways = st.sampled_from([(i, way.target) for i, node in enumerate(MISSION.nodes) for way in node.ways])
landmarks = st.builds(
    Landmark, st.sampled_from(LANDMARK_TYPES), metres, metres, st.none() | st.floats(-4, 4), st.none(), st.none()
)


@st.composite
def known(draw, node: int) -> Known:
    def way(target: int) -> OpenWay:
        sector = draw(st.none() | st.integers(0, SECTORS - 1))
        direction = None if sector is None else wrap_rad(sector * TWO_PI / SECTORS)
        return OpenWay(target, direction, draw(st.none() | st.sampled_from(POOL)))

    place = draw(st.none() | st.tuples(metres, metres))
    ways = tuple(way(each.target) for each in MISSION.nodes[node].ways)
    return Known(0, place, draw(st.none() | landmarks), ways)


@st.composite
def states(draw) -> State:
    opened = {node: draw(known(node)) for node in draw(st.lists(nodes, unique=True))}
    return State(
        phase=draw(st.sampled_from(Phase)),
        at=draw(st.none() | st.sampled_from(sorted(opened))) if opened else None,
        target=draw(st.none() | nodes),
        t_s=draw(st.just(-math.inf) | times),
        since_s=draw(st.none() | times),
        fixed_at_m=draw(times),
        left_at_m=draw(times),
        corrected_m=(draw(times), draw(times)),
        opened=MappingProxyType(opened),
        lengths_m=MappingProxyType(draw(st.dictionaries(ways, times))),
        blocked=draw(st.frozensets(ways)),
        round=draw(st.integers(0, 255)),
        others=draw(st.frozensets(nodes)),
        heard=tuple(draw(st.lists(st.binary(max_size=32), max_size=8))),
    )


def parsed(raw: bytes) -> State:
    reader = Reader(raw)
    state = parse_state(MISSION, reader)
    reader.end()
    return state


@settings(deadline=None, max_examples=100)
@given(states())
def test_a_state_comes_back_as_it_was(state):
    raw = encode_state(MISSION, state)
    again = parsed(raw)
    assert again == state
    assert list(again.opened) == list(state.opened), "their order decides between landmarks that are equally near"
    assert encode_state(MISSION, again) == raw


@settings(deadline=None, max_examples=150)
@given(st.binary(max_size=400))
def test_any_bytes_are_a_state_or_refused(raw):
    try:
        parsed(raw)
    except MalformedMission:
        return
    pytest.fail("by chance alone nobody comes upon a state")


@settings(deadline=None, max_examples=150)
@given(states(), st.data())
def test_a_state_with_a_byte_changed_is_another_state_or_refused(state, data):
    raw = bytearray(encode_state(MISSION, state))
    raw[data.draw(st.integers(0, len(raw) - 1))] ^= data.draw(st.integers(1, 255))
    try:
        parsed(bytes(raw))
    except PeerError:
        return


@both
def test_a_controller_takes_its_own_checkpoints_and_no_others(profile):
    recording = Recording.of(profile)
    for i, each in enumerate(recording.steps[::9]):
        controller = recording.replays(1)
        for k in range(i % 4, len(each.state), 4):  # other bytes of each; all steps' begin alike
            changed = bytearray(each.state)
            changed[k] ^= 0x80
            try:
                controller.decode(bytes(changed))
            except PeerError:
                continue
            assert controller.encode() == changed, "one state, one spelling"
        for wrong in (each.state[:-1], each.state + b"\0", b""):
            with pytest.raises(PeerError):
                controller.decode(wrong)


@both
def test_a_walk_keeps_within_the_room_that_it_is_given(profile):
    mission = cheap(fork().mission(), profile)
    one = built(mission, profile)
    room = state_capacity(one.mission, MissionConfig(), ())
    lengths = [len(encode_state(one.mission, state)) for state, _ in walk(mission, walker_of(one))]
    assert len(lengths) > 2
    assert 0 < max(lengths) <= room < 5000


@both
def test_checkpoints_have_room_for_the_largest_state_of_the_missions(profile):
    sized = everybody(errand(profile)).audits(BtiConfig(f_max=1, n_max=8))
    longest = max(len(each.state) for each in Recording.of(profile).steps)
    assert 48 + longest <= sized.checkpoint_capacity_bytes
    assert sized.request_capacity_bytes > sized.log_capacity_bytes > BtiConfig(f_max=1, n_max=8).log_capacity_bytes


def test_a_mission_too_large_to_show_is_refused_in_words():
    with pytest.raises(UsageError, match="state_bytes"):
        BtiConfig(state_bytes=70_000)
    with pytest.raises(UsageError, match="evidence"):
        BtiConfig(evidence_max_bytes=2000)
    with pytest.raises(UsageError, match="packets"):
        BtiConfig(evidence_max_bytes=2000, evidence_bytes_per_s=20_000)


def test_no_keyring_is_encoded_and_none_printed():
    keys = Keyring(proofs={1: b"p" * 32}, tried=frozenset({b"t" * 16}))
    assert encode_state(MISSION, State(keys=keys)) == encode_state(MISSION, State())
    assert "p" * 8 not in repr(State(keys=keys))


def test_an_action_of_a_way_is_kept_by_its_canonical_bytes():
    do = Action("lift", (("floor", 2),))
    source, way = next((i, node.ways) for i, node in enumerate(MISSION.nodes) if node.ways)
    state = State(opened={source: Known(0, None, None, tuple(OpenWay(each.target, None, do) for each in way))})
    assert parsed(encode_state(MISSION, state)).opened[source].ways[0].do == do
