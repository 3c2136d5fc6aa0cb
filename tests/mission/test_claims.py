"""What an auditor is shown of a decode: enough to check it, too little to go on from."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import BOTH, STRAIGHT, at, built, cheap, corridor, fork, walk, walker_of

from phalanx.errors import PeerError
from phalanx.mission import Draft, Experience, Landmark, Position, Profile, Sensor, State
from phalanx.mission.claims import Claim, allowed, opens, parse_claim, shows
from phalanx.mission.observable import Offset

both = pytest.mark.parametrize("profile", BOTH)


def decodes(mission, one):
    """(experience, claim, H of the node before) of every decode along the honest path."""
    walker, state, out, released = walker_of(one), State(), [], b""
    for i, node in enumerate(mission.nodes):
        seen = at(mission, *node.place, 1.0 + i)
        for _ in range(20):
            state, outcome = walker.step(state, seen)
            if outcome.decoded:
                out.append((seen, outcome.decoded.claim, released))
                released = outcome.decoded.released
                break
    return out


@both
def test_an_honest_claim_opens_its_node_and_is_shown_by_its_reading(profile):
    mission = cheap(corridor(5), profile)
    one = built(mission, profile)
    claims = decodes(mission, one)
    assert len(claims) == 5
    for seen, claim, released in claims:
        assert opens(one.mission, claim)
        assert shows(one.mission, STRAIGHT, claim, seen, (), released)
        assert parse_claim(claim.encode()) == claim


@both
def test_a_robot_cannot_pretend_to_have_seen_what_its_reading_does_not_show(profile):
    mission = cheap(corridor(5), profile)
    one = built(mission, profile)
    claims = decodes(mission, one)
    for i, (seen, _, released) in enumerate(claims):
        for j, (_, claim, _) in enumerate(claims):
            if abs(i - j) > 1:
                assert not shows(one.mission, STRAIGHT, claim, seen, (), released), (i, j)
    seen, claim, _ = claims[3]
    assert not shows(one.mission, STRAIGHT, claim, replace(seen, landmarks=()))


@both
def test_a_node_cannot_be_skipped(profile):
    mission = cheap(corridor(4), profile)
    one = built(mission, profile).mission
    assert [node for node in range(4) if allowed(one, (), node)] == [0]
    assert [node for node in range(4) if allowed(one, (0,), node)] == [1]
    assert [node for node in range(4) if allowed(one, (0, 1), node)] == [1, 2]
    assert not allowed(one, (0,), 4)
    assert not allowed(one, (0,), -1)
    draft = fork()
    draft.nodes[-1] = replace(draft.nodes[-1], join=True)
    joined = built(cheap(draft.mission(), profile), profile).mission
    assert not allowed(joined, (0, 1), 3)
    assert allowed(joined, (0, 1, 2), 3)


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
        assert not opens(one.mission, forged)
    seen, _, _ = decodes(mission, one)[1]
    assert not shows(one.mission, STRAIGHT, replace(claim, cell=other), seen)
    if profile is Profile.SEALED:
        assert not opens(one.mission, replace(claim, salt=bytes(32)))
    # An offset is the robot's word in the sealed profile, but not more than half a cell of it.
    assert not shows(one.mission, STRAIGHT, replace(claim, offset=Offset(x=5000)), seen)


@both
def test_readings_and_messages_are_part_of_what_is_shown(profile):
    draft = Draft("event")
    draft.node("start", Position(0, 0), start=True)
    draft.node("red", (Landmark("doorway", 4, 0, 0.1), Sensor(b"red")), wait=("go",), within_m=3, final=True)
    draft.way("start", "red")
    one = built(cheap(draft.mission(), profile), profile)
    walker = walker_of(one)
    state, _ = walker.step(State(), Experience(0, 0, 0, 0))
    go = one.key.messages["go"]
    seen = Experience(1, 2, 0, 0, 2.0, (Landmark("doorway", 4, 0, 0.1),), sensors=(b"blue", b"red"), messages=(go,))
    state, outcome = walker.step(state, seen)
    claim = outcome.decoded.claim
    assert opens(one.mission, claim)
    assert shows(one.mission, STRAIGHT, claim, seen, (go,))
    assert not shows(one.mission, STRAIGHT, claim, replace(seen, sensors=(b"blue",)), (go,))
    assert not shows(one.mission, STRAIGHT, claim, replace(seen, x_m=0.5), (go,)), "it was too far away"
    if profile is Profile.PAPER:
        assert not shows(one.mission, STRAIGHT, claim, seen, ())


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
    assert not opens(one.mission, claim)
    shows(one.mission, STRAIGHT, claim, seen, (b"c",))


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
