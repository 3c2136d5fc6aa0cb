"""Altered files of missions with branches, joins, circles, actions, messages and chains, with a final node or without.

A robot that cannot get on may go another way than it would have gone, and even arrive there. What holds: no altered
node decodes; what decodes tells the truth, in an order in which the author's ways lead there; and it is completed only
if all was decoded that had to be.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from itertools import product

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from phalanx.errors import NotAuthentic, PeerError
from phalanx.mission import (
    Action,
    Draft,
    EncodedMission,
    Landmark,
    Mission,
    Opened,
    Phase,
    Position,
    Profile,
    Sensor,
    State,
    Walker,
    check_signature,
    parse_mission,
    public_key,
    sign,
)
from phalanx.mission.authoring.compiling import Built, direction_of, place_of
from phalanx.mission.file.records import FINAL, JOIN, START, NodeRecord
from worlds import BOTH, CHEAP, CONFIG, built, cheap, explored, fork

OPERATOR = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
# Few cells to a robot's doubt: what is altered is found out after the search, whatever its length.
WIDE = replace(CHEAP, delta_mm=2000)
SIDE = 3  # nodes stand 8 m apart in a square of so many


@st.composite
def graphs(draw: st.DrawFn) -> Mission:
    """A mission that an honest robot completes: there is a way back from everywhere, but never into a join or chain."""
    draft = Draft("any", coding=draw(st.sampled_from([CHEAP, WIDE])))
    count = draw(st.integers(3, 6))
    ends = draw(st.sampled_from([(), (count - 1,), (count - 2, count - 1)]))
    draft.node("0", Position(draw(st.floats(-0.5, 0.5)), 0.0), start=True, send=("begun",))
    shut = set()
    for i in range(1, count):
        sources = draw(st.sets(st.integers(0, i - 1), min_size=1, max_size=3))
        join, chained = len(sources) > 1 and draw(st.booleans()), draw(st.integers(0, 3)) == 0
        shut |= {i} if join or chained else set()
        draft.node(
            str(i),
            *draw(_sights(i)),
            do=draw(st.sampled_from([None, Action("pick", (("shelf", i),))])),
            final=i in ends,
            join=join,
            chained=chained,
            within_m=draw(st.sampled_from([0.0, 5.0])),
            wait=draw(st.sampled_from([(), (), ("begun",), ("go",), ("begun", "go")])),
        )
        for source in sorted(sources):
            draft.way(str(source), str(i), do=draw(st.sampled_from([None, None, Action("lift", (("floor", i),))])))
        draft.way(str(i), str(draw(st.sampled_from(sorted({0, *sources} - shut)))))
    return draft.mission()


@st.composite
def _sights(draw: st.DrawFn, i: int) -> list[tuple[Landmark | Sensor, ...]]:
    """What is seen at the i-th place, in one way or two."""
    kind = draw(st.sampled_from(["doorway", "concave_left", "qr"]))
    text = draw(st.sampled_from([None, "shelf"])) if kind == "qr" else None
    x, y = 8.0 * (i % SIDE) + draw(st.floats(-1, 1)), 8.0 * (i // SIDE) + 1.0
    one = Landmark(kind, x, y, draw(st.none() | st.floats(-3, 3)), None, text)
    read = draw(st.sampled_from([(), (Sensor(b"red"),), (Sensor(b"warm"), Sensor(b"red"))]))
    return [(one, *read), (replace(one, x_m=x + 2.5),)][: draw(st.integers(1, 2))]


def lived(mission: Mission, one: Built, raw: bytes) -> Phase | None:
    """The end of a walk by a file that may be altered, None if it is refused; what decodes on the way is judged."""
    try:
        walker = Walker(parse_mission(raw), one.key, CONFIG)
    except PeerError:
        return None
    told = tuple(one.key.messages.values())
    decoded: list[int] = []
    state = State()
    for after, outcome in explored(mission, walker, told=told):
        state = after
        if outcome.decoded is not None:
            assert is_unaltered(one.mission, walker.mission, outcome.decoded)
            assert is_true(mission, outcome.decoded)
            assert may_follow(mission, one.mission.header.profile, decoded, outcome.decoded.node)
            decoded.append(outcome.decoded.node)
    if state.phase is Phase.DONE:
        finals = {i for i, node in enumerate(mission.nodes) if node.final}
        assert finals & set(decoded) if finals else len(set(decoded)) == len(mission.nodes)
    return state.phase


def is_unaltered(ours: EncodedMission, theirs: EncodedMission, opened: Opened) -> bool:
    """Whether all that a node's bytes say was there before; of several bindings (paper) one each is looked at."""
    profile, mine, other = ours.header.profile, ours.nodes[opened.node], theirs.nodes[opened.node]
    if profile is Profile.SEALED:
        return ours.header == theirs.header and mine == other
    bound = mine.bindings[opened.alias] == other.bindings[opened.alias]
    return ours.header == theirs.header and mine.core(profile) == other.core(profile) and bound


def is_true(mission: Mission, opened: Opened) -> bool:
    """Whether what a node tells is what the author wrote: where it is, what to do, and whither from there."""
    node = mission.nodes[opened.node]
    number = {each.name: i for i, each in enumerate(mission.nodes)}
    places = [(place.x_m, place.y_m) for alias in node.see if (place := place_of(alias))]
    out = {number[way.target]: way for way in mission.ways if way.source == node.name}
    said = {way.target: way for way in opened.ways}
    half_sector = math.pi / (mission.coding or CHEAP).sectors + 1e-6

    def leads(target: int) -> bool:
        way, given = said[target], out[target]
        if way.do != given.do or (way.direction_rad is None and given.do is None):
            return False
        true = [direction_of(given, place, mission.nodes[target].place) for place in (*places, node.place)]
        return way.direction_rad is None or any(
            abs(math.remainder(way.direction_rad - direction, math.tau)) <= half_sector for direction in true
        )

    where = [(opened.place_m, (*places, node.place))]
    where += [((opened.landmark.x_m, opened.landmark.y_m), places)] if opened.landmark else []
    return (
        all(min(math.dist(told, place) for place in true) < 2e-3 for told, true in where)
        and (opened.do, len(opened.sends)) == (node.do, len(node.send))
        and said.keys() == out.keys()
        and all(map(leads, out))
    )


def may_follow(mission: Mission, profile: Profile, decoded: list[int], node: int) -> bool:
    """Whether the author's ways lead to a node from those decoded before.

    In the paper profile a join is only as good as the records before it, from which a way may have been taken away.
    """
    names = {mission.nodes[i].name for i in decoded}
    before = [way.source in names for way in mission.ways if way.target == mission.nodes[node].name]
    if mission.nodes[node].start and not decoded:
        return True
    return all(before) if mission.nodes[node].join and profile is Profile.SEALED else any(before)


def flipped(raw: bytes, bit: int) -> bytes:
    altered = bytearray(raw)
    altered[bit // 8] ^= 1 << bit % 8
    return bytes(altered)


@pytest.mark.parametrize("profile", BOTH)
@settings(max_examples=20, deadline=None)
@given(mission=graphs(), data=st.data())
def test_whatever_bit_is_changed_no_altered_node_decodes_and_nothing_false_is_told(profile, mission, data):
    one = built(mission, profile, 1)
    raw = sign(one.mission, OPERATOR).encode()
    assert lived(mission, one, raw) is Phase.DONE
    for _ in range(8):
        altered = flipped(raw, data.draw(st.integers(0, 8 * len(raw) - 1)))
        with pytest.raises(PeerError):
            check_signature(parse_mission(altered), [public_key(OPERATOR)])
        lived(mission, one, altered)


EVERY = 8
# Every eighth byte of each file, others of each; the rest when there is time.
FORKS = [
    pytest.param(profile, final, first, marks=() if first == i < 3 else pytest.mark.long)
    for i, (profile, final) in enumerate(product(BOTH, (True, False)))
    for first in range(EVERY)
]


@pytest.mark.parametrize(("profile", "final", "first"), FORKS)
def test_of_a_fork_every_byte_counts(profile, final, first):
    draft = fork()
    draft.way("end", "start")
    draft.nodes[-1] = replace(draft.nodes[-1], final=final)
    mission = replace(draft.mission(), coding=WIDE)
    one = built(mission, profile)
    raw = one.mission.encode()
    assert lived(mission, one, raw) is Phase.DONE
    bits = (8 * byte + byte // EVERY % 8 for byte in range(first, len(raw), EVERY))
    ends = Counter(lived(mission, one, flipped(raw, bit)) for bit in bits)
    # With a final node the other branch leads there; without, a node that was altered stays dark.
    assert bool(ends[Phase.DONE]) is final
    assert ends[Phase.HELD] > 0


@st.composite
def rewritten(draw: st.DrawFn, nodes: tuple[NodeRecord, ...]) -> tuple[NodeRecord, ...]:
    """The nodes of a file, with two that changed places or parts, or one with another flag, way or way's end."""
    a, b = draw(st.lists(st.integers(0, len(nodes) - 1), min_size=2, max_size=2, unique=True))
    one, two = nodes[a], nodes[b]
    turned = (*one.ways[:-1], replace(one.ways[-1], target=b))
    pairs = {
        "nodes": (two, one),
        "aliases": (replace(one, aliases=one.aliases[::-1]), two),
        "first alias": (
            replace(one, aliases=(two.aliases[0], *one.aliases[1:])),
            replace(two, aliases=(one.aliases[0], *two.aliases[1:])),
        ),
        "ways": (replace(one, ways=two.ways), replace(two, ways=one.ways)),
        "payload": (
            replace(one, payload=two.payload, bindings=two.bindings),
            replace(two, payload=one.payload, bindings=one.bindings),
        ),
        "flags": (replace(one, flags=one.flags ^ draw(st.sampled_from([START, FINAL, JOIN, START | FINAL]))), two),
        "way's end": (replace(one, ways=tuple(sorted(turned, key=lambda way: way.target))), two),
        "no way": (replace(one, ways=one.ways[:-1]), two),
    }
    out = list(nodes)
    out[a], out[b] = pairs[draw(st.sampled_from(sorted(pairs)))]
    return tuple(out)


@pytest.mark.parametrize("profile", BOTH)
@settings(max_examples=50, deadline=None)
@given(mission=graphs(), data=st.data())
def test_however_records_are_rewritten_no_altered_node_decodes_and_nothing_false_is_told(profile, mission, data):
    one = built(mission, profile, 2)
    altered = replace(sign(one.mission, OPERATOR), nodes=data.draw(rewritten(one.mission.nodes)))
    assume(altered.nodes != one.mission.nodes)
    with pytest.raises(NotAuthentic):
        check_signature(altered, [public_key(OPERATOR)])
    end = lived(mission, one, altered.encode())
    assert end is not Phase.DONE or any(node.final for node in mission.nodes)


@pytest.mark.parametrize("profile", BOTH)
def test_a_join_of_the_paper_profile_is_only_as_good_as_the_records_before_it(profile):
    """One bit turns left's way to the end aside; the hashes of the end say nothing of it, the shares of its gate do."""
    draft = fork()
    draft.nodes[-1] = replace(draft.nodes[-1], join=True)
    mission = cheap(draft.mission(), profile)
    one = built(mission, profile)
    assert lived(mission, one, one.mission.encode()) is Phase.DONE
    start, left, *others = one.mission.nodes
    assert [way.target for way in left.ways] == [0, 3]
    aside = replace(left, ways=(left.ways[0], replace(left.ways[1], target=2)))
    altered = replace(one.mission, nodes=(start, aside, *others)).encode()
    assert lived(mission, one, altered) is (Phase.DONE if profile is Profile.PAPER else Phase.HELD)
