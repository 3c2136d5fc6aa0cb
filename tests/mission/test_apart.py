"""How far a landmark stands alone: what the compiler says of it, and what a robot does with that."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.config.mission import CodingConfig, MissionConfig
from phalanx.errors import PeerError
from phalanx.mission import Draft, Experience, Landmark, Position, Reason, parse_mission, parse_start_key
from phalanx.mission.authoring.findable import ALIKE_RAD, alone, mark_lookalikes, mark_lookalikes_in
from phalanx.mission.landmarks import look_alikes_of
from phalanx.mission.observable import APART_MAX, DEFAULT_APART_M, Offset, offset_of
from phalanx.mission.walk.fix import unambiguous
from phalanx.world.building.floorplan import load_floorplan
from worlds import BOTH, at_start, built, cheap, leading_to, until_decoded

both = pytest.mark.parametrize("profile", BOTH)
DOOR = Landmark("doorway", 5.0, 0.0, 0.2)


def mission_of(*landmarks: Landmark):
    draft = Draft("apart")
    draft.node("start", Position(0, 0), start=True)
    for i, landmark in enumerate(landmarks):
        draft.node(f"n{i}", landmark)
        draft.way("start", f"n{i}")
    return draft.mission()


def aparts(mission) -> list[float]:
    return [thing.apart_m for node in mission.nodes for (thing,) in node.see if isinstance(thing, Landmark)]


@pytest.mark.parametrize(
    ("other", "apart"),
    [
        (replace(DOOR, x_m=8.0), 3.0),
        (replace(DOOR, x_m=8.0, y_m=4.0), 5.0),
        (replace(DOOR, x_m=8.0, orientation_rad=0.2 + math.pi), 3.0),
        (replace(DOOR, x_m=8.0, orientation_rad=0.2 + 0.9 * ALIKE_RAD), 3.0),
        (replace(DOOR, x_m=8.0, orientation_rad=None), 3.0),
        (replace(DOOR, x_m=8.0, orientation_rad=0.2 + 1.1 * ALIKE_RAD), math.inf),
        (Landmark("corner_convex", 8.0, 0.0, 0.2), math.inf),
        (replace(DOOR, x_m=8.0, text="lab"), math.inf),
        (replace(DOOR, x_m=5.05), math.inf),  # drawn twice
    ],
)
def test_it_is_as_far_as_the_next_thing_that_looks_the_same(other, apart):
    assert aparts(mark_lookalikes(mission_of(DOOR, other), [])) == pytest.approx([apart, apart])
    assert aparts(mark_lookalikes(mission_of(DOOR), [other])) == pytest.approx([apart]), "be it a node or not"
    untold = aparts(mark_lookalikes(mission_of(DOOR, other)))
    assert untold[0] == pytest.approx(min(apart, DEFAULT_APART_M)), (
        "who does not know the building expects more of them"
    )


def test_a_concave_corner_is_taken_for_none_of_the_other_hand():
    left, right = Landmark("concave_left", 5, 0, 0.2), Landmark("concave_right", 5.5, 0, 0.2)
    assert aparts(mark_lookalikes(mission_of(left, right), [])) == [math.inf, math.inf]


def test_of_two_that_stand_too_near_each_other_none_is_alone():
    near, far = replace(DOOR, x_m=5.4), replace(DOOR, x_m=9.0)
    assert alone([DOOR, near, far], [], 0.5) == [far]
    assert alone([DOOR, near, far], [], 0.3) == [DOOR, near, far]
    assert alone([DOOR, far], [near], 0.5) == [far], "be it surveyed or not"


def test_a_match_that_may_be_another_thing_counts_only_with_a_pose_that_certain_ones_correct():
    """A corner 8 m away, the like of which stands a metre from it, and a robot that may be turned by 3 degrees."""
    config, place = MissionConfig(), (0.05**2, 0.0, 0.0, 0.05**2, 0.0, math.radians(3) ** 2)
    far = Landmark("concave_left", 8.0, 0.0, math.pi, apart_m=1.0)
    sure = Landmark("doorway", 6.0, 2.0, 0.2, apart_m=5.0)
    seen = Experience(0.0, 0.0, 0.0, 0.0, landmarks=(far, sure), spread=place)
    assert unambiguous(config, seen, [(far, far)]) == []
    assert unambiguous(config, seen, [(far, far), (sure, sure)]) == [(far, far), (sure, sure)]
    near = replace(far, apart_m=0.3)
    assert unambiguous(config, seen, [(near, near), (sure, sure)]) == [(sure, sure)], "nor do they make it so certain"
    lost = replace(seen, spread=(*place[:-1], math.radians(60) ** 2))
    assert unambiguous(config, lost, [(sure, sure)]) == []


def test_what_the_author_knows_is_kept_where_it_is_nearer():
    near = replace(DOOR, apart_m=1.5)
    assert aparts(mark_lookalikes(mission_of(near), [replace(DOOR, x_m=8.0)])) == [1.5]
    assert aparts(mark_lookalikes(mission_of(near), [replace(DOOR, x_m=6.0)])) == [1.0]


def test_a_building_has_more_look_alikes_than_a_mission_has_nodes():
    plan = load_floorplan("office_40x40")
    one = next(thing for thing in look_alikes_of(plan) if thing.type == "doorway")
    (alone,), (among,) = aparts(mark_lookalikes(mission_of(one))), aparts(mark_lookalikes_in(plan, mission_of(one)))
    assert alone == DEFAULT_APART_M
    assert 1.0 < among < 10.0
    # Jambs are no landmarks, and are seen as corners where the doorway's other jamb is not.
    kinds = {thing.type for thing in look_alikes_of(plan)}
    assert kinds == {"doorway", "corner_convex", "concave_left", "concave_right", "room"}


@given(st.floats(0, 1e5) | st.just(math.inf))
def test_in_a_file_it_is_never_farther_than_it_is(apart_m):
    offset = offset_of(CodingConfig(), replace(DOOR, apart_m=apart_m))
    assert 0 <= offset.apart <= APART_MAX
    if apart_m < 25.4:
        assert offset.apart_m <= apart_m + 1e-9
        assert offset.apart_m > apart_m - 0.1 - 1e-9
    if offset.apart == APART_MAX:
        assert apart_m > 25.4
        assert offset.apart_m == math.inf
    assert Offset().apart_m == math.inf


@both
def test_a_door_is_not_believed_where_another_like_it_may_be_meant(profile):
    """Two doors a metre and a half from each other: who is sure of its pose knows which it sees, and no other."""
    draft = Draft("twins")
    draft.node("start", Position(0, 0), start=True)
    draft.node("door", DOOR, final=True)
    draft.node("twin", replace(DOOR, y_m=1.5))
    draft.way("start", "door")
    walker, begun = at_start(draft, profile)
    seen = Experience(1.0, 2.0, 0, 0, 5.0, (DOOR,))
    for deviation_m, well in ((0.05, True), (0.4, True), (0.7, False)):
        spread = (deviation_m**2, 0.0, 0.0, deviation_m**2, 0.0, 1e-4)
        _, outcome = until_decoded(walker, begun, replace(seen, spread=spread))
        assert (outcome.decoded is not None) is well, deviation_m
    state, outcome = walker.step(begun, replace(seen, spread=spread))
    assert (outcome.reason, outcome.fix) == (Reason.AMBIGUOUS, None)
    assert 1 not in state.opened
    # The same robot, had the compiler not said that there is a twin.
    draft.nodes.pop()
    walker, begun = at_start(draft, profile)
    assert until_decoded(walker, begun, replace(seen, spread=spread))[1].decoded


@both
def test_a_door_is_not_believed_where_another_in_sight_fits_as_well(profile):
    walker, begun = at_start(leading_to(DOOR), profile)
    seen = Experience(1.0, 2.0, 0, 0, 5.0, (DOOR, replace(DOOR, y_m=0.45)))
    _, outcome = walker.step(begun, seen)
    assert outcome.decoded is None
    assert outcome.reason is Reason.AMBIGUOUS
    for other in (replace(DOOR, y_m=0.1), replace(DOOR, y_m=6.0), Landmark("corner_convex", 5.0, 0.45, 0.2)):
        _, outcome = until_decoded(walker, begun, replace(seen, landmarks=(DOOR, other)))
        assert outcome.decoded, "the same thing twice, one far off, and one of another kind are no rivals"


@both
def test_files_and_keys_of_the_first_version_are_refused_in_one_line_that_says_what_to_do(profile):
    one = built(cheap(mission_of(DOOR), profile), profile)
    kinds = {"mission file": (parse_mission, one.mission.encode()), "start key": (parse_start_key, one.key.encode())}
    for kind, (parse, raw) in kinds.items():
        assert raw[4] == 2
        with pytest.raises(PeerError) as caught:
            parse(raw[:4] + b"\x01" + raw[5:])
        assert str(caught.value) == f"{kind} of version 1, not 2: build the mission again"
        with pytest.raises(PeerError, match=f"^not a {kind}$"):
            parse(b"PHXX" + raw[4:])
