"""What an auditor is shown of a decode: enough to check it, too little to go on from."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.errors import PeerError
from phalanx.mission import Draft, Experience, Landmark, Position, Profile, Sensor, State
from phalanx.mission.file.canonical import AT_POSITION, Shape
from phalanx.mission.observable import APART_MAX, Cell, Offset, cell_of
from phalanx.mission.walk.claims import Claim, Unshown, match_of_claim, parse_claim, unlock
from worlds import BOTH, CONFIG, at, built, cheap, corridor, leading_to, walk, walker_for, walker_of

both = pytest.mark.parametrize("profile", BOTH)


def mark_of(one, opened):
    """H of a decoded node: what chained nodes after it need in the paper profile."""
    return one.mission.nodes[opened.node].aliases[opened.alias].mark


def decodes(mission, one):
    """(experience, claim, H of the node before) of every decode along the honest path."""
    walker, state, out, released = walker_of(one), State(), [], b""
    for i, node in enumerate(mission.nodes):
        seen = at(mission, *node.place, 1.0 + i)
        for _ in range(20):
            state, outcome = walker.step(state, seen)
            if outcome.decoded:
                out.append((seen, outcome.decoded.claim, released))
                released = mark_of(one, outcome.decoded)
                break
    return out


@both
def test_an_honest_claim_opens_its_node_and_is_shown_by_its_reading(profile):
    mission = cheap(corridor(5), profile)
    one = built(mission, profile)
    claims = decodes(mission, one)
    assert len(claims) == 5
    for seen, claim, released in claims:
        assert unlock(one.mission, claim) is not None
        assert match_of_claim(one.mission, CONFIG, claim, seen, (), released)
        assert parse_claim(claim.encode()) == claim


@both
def test_a_robot_cannot_pretend_to_have_seen_what_its_reading_does_not_show(profile):
    mission = cheap(corridor(5), profile)
    one = built(mission, profile)
    claims = decodes(mission, one)
    for i, (seen, _, released) in enumerate(claims):
        for j, (_, claim, _) in enumerate(claims):
            if abs(i - j) > 1:
                assert not match_of_claim(one.mission, CONFIG, claim, seen, (), released), (i, j)
    seen, claim, _ = claims[3]
    assert not match_of_claim(one.mission, CONFIG, claim, replace(seen, landmarks=()))


@both
def test_a_made_up_claim_opens_nothing(profile):
    mission = cheap(corridor(3), profile)
    one = built(mission, profile)
    _, claim, _ = decodes(mission, one)[1]
    other = claim.cell._replace(x=claim.cell.x + 1)
    for forged in (
        replace(claim, node=2),
        replace(claim, node=99),
        replace(claim, alias=1),
        replace(claim, node=-1),
        replace(claim, observed=claim.observed[:-1] + bytes([claim.observed[-1] ^ 1])),
    ):
        assert unlock(one.mission, forged) is None
    seen, _, _ = decodes(mission, one)[1]
    assert not match_of_claim(one.mission, CONFIG, replace(claim, cell=other), seen)
    if profile is Profile.SEALED:
        assert unlock(one.mission, replace(claim, salt=bytes(32))) is None
    # An offset is the robot's word in the sealed profile, but not more than half a cell of it.
    assert not match_of_claim(one.mission, CONFIG, replace(claim, offset=Offset(x=5000)), seen)


@both
def test_readings_and_messages_are_part_of_what_is_shown(profile):
    draft = leading_to((Landmark("doorway", 4, 0, 0.1), Sensor(b"red")), wait=("go",), within_m=3)
    one = built(cheap(draft.mission(), profile), profile)
    walker = walker_of(one)
    state, _ = walker.step(State(), Experience(0, 0, 0, 0))
    go = one.key.messages["go"]
    seen = Experience(1, 2, 0, 0, 2.0, (Landmark("doorway", 4, 0, 0.1),), sensors=(b"blue", b"red"), messages=(go,))
    state, outcome = walker.step(state, seen)
    claim = outcome.decoded.claim
    assert unlock(one.mission, claim) is not None
    assert match_of_claim(one.mission, CONFIG, claim, seen, (go,))
    assert not match_of_claim(one.mission, CONFIG, claim, replace(seen, sensors=(b"blue",)), (go,))
    assert not match_of_claim(one.mission, CONFIG, claim, replace(seen, x_m=0.5), (go,)), "it was too far away"
    if profile is Profile.PAPER:
        assert not match_of_claim(one.mission, CONFIG, claim, seen, ())


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=120), st.sampled_from(BOTH))
def test_any_bytes_are_a_claim_or_refused_and_none_is_believed(raw, profile):
    try:
        claim = parse_claim(raw)
    except PeerError:
        return
    mission = cheap(corridor(3), profile)
    one = built(mission, profile)
    seen = replace(at(mission, 4, 0, 1.0), sensors=(b"a", b"b"), messages=(b"c",))
    assert parse_claim(claim.encode()) == claim
    assert unlock(one.mission, claim) is None
    match_of_claim(one.mission, CONFIG, claim, seen, (b"c",))


def test_a_claim_says_nothing_of_what_a_node_opens():
    mission = cheap(corridor(4), Profile.SEALED)
    one = built(mission, Profile.SEALED)
    steps = [o.decoded for _, o in walk(mission, walker_of(one)) if o.decoded]
    secrets = {way.gate.share for node in steps for way in node.ways} | {one.key.gates[0].share}
    for node in steps:
        shown = b"".join(
            value for value in (getattr(node.claim, field.name) for field in fields(Claim)) if isinstance(value, bytes)
        )
        assert not [secret for secret in secrets if secret in shown]


class TestHeadingsThatAreOff:
    """A door, and a robot whose heading is 5 degrees off: what it is seen as lies elsewhere, in the bin beside."""

    TURN = math.radians(5.0)
    DOOR = Landmark("doorway", 5.5, 1.0, 0.3)
    HONEST = (0.0016, 0.0, 0.0, 0.0016, 0.0, math.radians(3.0) ** 2)

    def seen(self, spread: tuple[float, ...], door: Landmark = DOOR) -> Experience:
        cosine, sine = math.cos(self.TURN), math.sin(self.TURN)
        turned = replace(
            door,
            x_m=cosine * door.x_m + sine * door.y_m,
            y_m=cosine * door.y_m - sine * door.x_m,
            orientation_rad=door.orientation_rad - self.TURN,
        )
        return Experience(5.0, 0, 0, -self.TURN, 8.0, (turned,), spread=spread)

    def begun(self, profile, door: Landmark = DOOR):
        # Bins of 5 degrees: the door is seen in the middle of the one beside.
        coding = CodingConfig(delta_mm=100 if profile is Profile.PAPER else 400, heading_bins=72, kdf_log2_n=1, kdf_r=1)
        draft = Draft("turn", coding=coding)
        draft.node("start", Position(0, 0), start=True)
        draft.node("door", door, final=True)
        draft.way("start", "door")
        walker = walker_for(draft, profile)
        return walker, walker.step(State(), Experience(0, 0, 0, 0))[0]

    def looked(self, walker, state, seen):
        """The claim that a robot comes to, if it looks long enough."""
        claim = None
        for _ in range(40):
            state, claim, _ = walker.look(state, seen)
            if claim:
                break
        return state, claim

    @both
    def test_who_knows_it_finds_the_door_and_its_heading(self, profile):
        walker, state = self.begun(profile)
        seen = self.seen(self.HONEST)
        state, claim = self.looked(walker, state, seen)
        coding = walker.mission.header.coding
        own = cell_of(coding, claim.offset, seen.landmarks[0].x_m, seen.landmarks[0].y_m, seen.landmarks[0])
        assert (claim.cell.bin - own.bin) % (coding.heading_bins // 2) == 1, "in the next bin"
        assert abs(claim.cell.y - own.y) >= 1, "and in another cell"
        _, outcome = walker.advance(state, seen, claim)
        assert outcome.decoded.node == 1
        assert outcome.fix.heading_rad == pytest.approx(0.0, abs=math.radians(2.5))

    @both
    def test_who_is_sure_of_a_heading_that_is_wrong_claims_nothing_and_is_not_believed(self, profile):
        walker, state = self.begun(profile)
        _, claim = self.looked(walker, state, self.seen(self.HONEST))
        sure = self.seen((0.0016, 0.0, 0.0, 0.0016, 0.0, math.radians(0.7) ** 2))
        assert self.looked(walker, state, sure)[1] is None
        with pytest.raises(Unshown):
            walker.advance(state, sure, claim)


def test_an_offset_is_no_lever_beyond_half_a_bin():
    """With any offset a robot could say of any orientation that it lies in the bin that opens the node."""
    mission = cheap(corridor(3), Profile.SEALED)
    one = built(mission, Profile.SEALED)
    seen, claim, _ = decodes(mission, one)[1]
    half = one.mission.header.coding.bin_rad / 2 * 1e4
    askew = replace(seen, landmarks=tuple(replace(each, orientation_rad=1.0) for each in seen.landmarks))
    assert not match_of_claim(one.mission, CONFIG, claim, askew)
    shifted = claim.offset._replace(orientation=round(1e4 * (1.0 - seen.landmarks[0].orientation_rad)))
    assert abs(shifted.orientation) > half
    assert not match_of_claim(one.mission, CONFIG, replace(claim, offset=shifted), askew)
    assert not match_of_claim(one.mission, CONFIG, replace(claim, offset=claim.offset._replace(area=20_000)), seen)


@both
def test_how_far_a_landmark_stands_alone_is_bound(profile):
    """Who could say of a landmark that it stands alone would be believed where the compiler says that it does not."""
    mission = cheap(corridor(3), profile)
    one = built(mission, profile)
    seen, claim, _ = decodes(mission, one)[1]
    assert claim.offset.apart == 30, "nobody has said what else there is in the building"
    for apart in (0, 29, 31, APART_MAX):
        forged = replace(claim, offset=claim.offset._replace(apart=apart))
        assert unlock(one.mission, forged) is None
        walker = walker_of(one)
        state, _ = walker.step(State(), at(mission, *mission.nodes[0].place, 0.5))
        with pytest.raises(Unshown):
            walker.advance(state, seen, forged)


def test_where_a_node_has_one_alias_its_payload_says_where_it_is():
    mission = cheap(corridor(3), Profile.SEALED)
    one = built(mission, Profile.SEALED)
    walker = walker_of(one)
    state, _ = walker.step(State(), at(mission, *mission.nodes[0].place, 1.0))
    seen = at(mission, *mission.nodes[1].place, 2.0)
    state, claim, _ = walker.look(state, seen)
    assert walker.advance(state, seen, claim)[1].decoded
    for offset in (claim.offset._replace(x=claim.offset.x + 50), claim.offset._replace(y=claim.offset.y - 50)):
        with pytest.raises(Unshown):
            walker.advance(state, seen, replace(claim, offset=offset))


i16, i32 = st.integers(-(1 << 15), (1 << 15) - 1), st.integers(-(1 << 31), (1 << 31) - 1)
shapes = st.builds(
    Shape,
    st.integers(0, AT_POSITION),
    *[st.integers(0, 1)] * 3,
    *[st.integers(0, 3)] * 2,
    *[st.integers(0, 1)] * 3,
)


@settings(max_examples=300, deadline=None)
@given(
    st.integers(0, 3),
    st.integers(0, 1),
    shapes,
    st.builds(Offset, i16, i16, i16, i16, st.integers(0, APART_MAX)),
    st.builds(Cell, i32, i32, i16, i32),
    st.binary(max_size=80),
    st.binary(max_size=32),
    st.sampled_from(BOTH),
)
def test_claims_of_whatever_fields_are_refused_by_type(node, alias, shape, offset, cell, observed, salt, profile):
    mission = cheap(corridor(3), profile)
    one = built(mission, profile)
    walker = walker_of(one, MissionConfig())
    state, _ = walker.step(State(), at(mission, *mission.nodes[0].place, 1.0))
    seen = replace(at(mission, 4, 0, 2.0), sensors=(b"a", b"b"), messages=(b"c",))
    with pytest.raises(PeerError):
        walker.advance(state, seen, Claim(node, alias, shape, offset, cell, observed, salt))
